"""Attacks on the grader as real submissions, with the ending that each must have: `python -m grading.attacks`.

`resources.yaml`, `doors.yaml`, `answers.yaml` and `files.yaml` are the table; `submissions` makes folders of it,
`canaries` stand where nothing may reach, `graded` grades all of it as one class and compares.
"""

from grading.attacks.graded import run_all
from grading.attacks.table import read_table


def run(room) -> list[str]:
    """A line about each attack that does not end as it must in the tier of a room, and about each canary reached."""
    endings, wrong = run_all(list(read_table().values()), room.tier)
    return [f"{one.attack.name}: {', '.join(one.found.values())}" for one in endings if not one.right] + wrong
