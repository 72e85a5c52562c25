"""What delay costs, from times of submission and a due time."""

from datetime import datetime
from pathlib import Path

from dualnav_lite.config import UnusableInput
from grading.rubric import Late
from grading.tables import read_csv

DAY_S = 86_400


def late_shares(times: Path | None, due: str, rule: Late) -> dict[str, float]:
    """Share of the points that delay costs, by student; a begun day counts as one.

    Args:
        times: CSV with `student_id, submitted` (ISO time); due: ISO time. Both or neither.

    Raises:
        UnusableInput: one without the other, no ISO time, a zone in one alone, a student twice.
    """
    if bool(times) != bool(due):
        raise UnusableInput("--times and --due go together")
    found: dict[str, float] = {}
    for k, row in enumerate(read_csv(times, ("student_id", "submitted")) if times else [], 2):
        try:
            seconds = (datetime.fromisoformat(row["submitted"]) - datetime.fromisoformat(due)).total_seconds()
        except (ValueError, TypeError):
            raise UnusableInput(f"line {k} of the times, or --due: no ISO time, or a zone in one alone") from None
        if row["student_id"] in found:
            raise UnusableInput(f"line {k} of the times: this student stands there twice; keep the last attempt")
        days = max(0, -int(-seconds // DAY_S))
        found[row["student_id"]] = min(rule.most, days * rule.per_day)
    return found
