"""Grading: untrusted submissions in, tables out. No byte of a submission is ever read as a verdict.

A score is a function of hidden inputs, reply bytes and deadlines alone. `dualnav_lite` never imports this package.
"""

__version__ = "1"
