"""A small class to try the grader on, with the table that it must come out as: `python -m grading example`.

`class/` is handed in, `rubric.yaml` says what for, `times.csv` when, `grades.csv` what comes out. `students` makes the
class, `graded` grades it. Nothing of it depends on the weights that the kit ships.
"""

from grading.example.graded import HERE, differences, grade_example, hand_in_many
from grading.example.policies import standing_still

__all__ = ["HERE", "differences", "grade_example", "hand_in_many", "standing_still"]
