"""Attacks on the grader as real submissions, with the ending that each must have: `python -m grading.attacks`.

`resources.yaml`, `doors.yaml`, `answers.yaml` and `files.yaml` are the table; `submissions` makes folders of it,
`canaries` stand where nothing may reach, `run` grades all of it as one class and compares.
"""
