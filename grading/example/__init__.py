"""A small class to try the grader on: made from the teacher's notebooks, so it never falls behind them."""

from grading.example.policies import standing_still

__all__ = ["standing_still"]
