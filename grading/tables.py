"""The tables, derived from the result files alone: sorted, the same bytes each time, inert in a spreadsheet."""

import csv
import io
from collections import Counter
from pathlib import Path

from dualnav_lite.config import UnusableInput
from grading.rubric import Rubric

COLUMNS = (
    "assignment",
    "student_id",
    "submission_sha256",
    "exercise",
    "points",
    "max_points",
    "status",
    "reason_code",
    "component_source",
    "similarity",
    "tier",
    "grader_version",
)
# Also in full width, which a spreadsheet that is set to Chinese or Japanese takes for the same.
SURVIVAL = (
    "student_id",
    "scenario",
    "episodes",
    "survived",
    "low",
    "high",
    "threshold",
    "decision",
    "collisions",
    "timeouts",
    "flat_batteries",
    "errors",
)
PARETO = ("student_id", "scenario", "preference", "episodes", "safe_dist_m", "energy_j_per_goal")
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")


def defused(value: str) -> str:
    """A cell that no spreadsheet computes; numbers stay numbers.

    >>> defused("=1+1")
    "'=1+1"
    >>> defused("-2.5")
    '-2.5'
    """
    if value.startswith(FORMULA) or value.lstrip().startswith(FORMULA):
        try:
            float(value)
        except ValueError:
            return "'" + value
    return value


def to_csv(columns, rows) -> bytes:
    """A table with every cell quoted and defused."""
    text = io.StringIO()
    writer = csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([defused(str(row[name])) for name in columns])
    return text.getvalue().encode("utf-8")


def read_csv(path: Path, columns: tuple[str, ...]) -> list[dict[str, str]]:
    """Rows of a table that a person wrote.

    Raises:
        UnusableInput: it cannot be read, lacks a column, or has a line that ends before one of them.
    """
    try:
        reader = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8-sig")))
        rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UnusableInput(f"{path}: cannot be read: {' '.join(str(error).split())[:120]}") from None
    for name in columns:
        if name not in (reader.fieldnames or ()):
            raise UnusableInput(f"{path}: lacks the column '{name}'")
        for k, row in enumerate(rows, 2):
            if row[name] is None:
                raise UnusableInput(f"{path.name}, line {k}: has no '{name}'")
    return rows


def number(value: float) -> str:
    """Points with at most two digits behind the point."""
    return f"{round(value + 0.0, 2):g}"


def similarities(results: list[dict]) -> dict[tuple[str, str], str]:
    """What each student's cell equals once names and layout are taken away: the library's, or classmates'."""
    counts = Counter((name, print_) for one in results for name, print_ in one["prints"].items())
    found = {}
    for one in results:
        for name, print_ in one["prints"].items():
            words = ["library"] if print_ == one["library_prints"].get(name) else []
            others = counts[name, print_] - 1
            found[one["student_id"], name] = "+".join([*words, *([f"classmates:{others}"] if others else [])])
    return found


def rows_of(results: list[dict], rubric: Rubric, overrides: dict, late: dict[str, float]) -> list[dict]:
    """Rows of `grades.csv`.

    Args:
        results: contents of the result files.
        rubric: points.
        overrides: (points, reason) by (student, exercise).
        late: share of the points that delay costs, by student.
    """
    rows, similar = [], similarities(results)
    for one in sorted(results, key=lambda result: result["student_id"]):
        student = one["student_id"]
        for exercise, most in rubric.points().items():
            outcome = one["outcomes"][exercise]
            status, reason = outcome["status"], outcome["reason"]
            points = most * outcome["share"] * (1.0 - late.get(student, 0.0))
            if (student, exercise) in overrides:
                points, reason = overrides[student, exercise]
                status = "manual"
            rows.append(
                {
                    "assignment": rubric.assignment,
                    "student_id": student,
                    "submission_sha256": one["submission_sha256"],
                    "exercise": exercise,
                    "points": "" if status == "ungraded" else number(points),
                    "max_points": number(most),
                    "status": status,
                    "reason_code": reason,
                    "component_source": outcome["source"],
                    "similarity": similar.get((student, exercise), ""),
                    "tier": one["tier"],
                    "grader_version": one["grader_version"],
                }
            )
    return rows


def policy_tables(results: list[dict]) -> dict[str, tuple[tuple[str, ...], list[dict]]]:
    """Columns and rows of `survival.csv` and `pareto.csv`."""
    found: dict[str, tuple[tuple[str, ...], list[dict]]] = {"survival": (SURVIVAL, []), "pareto": (PARETO, [])}
    for one in sorted(results, key=lambda result: result["student_id"]):
        for exercise, name in (("survival", "survival"), ("hypervolume", "pareto")):
            for line in one["outcomes"].get(exercise, {}).get("detail", {}).get(name, []):
                cells = {key: "" if value is None else value for key, value in line.items()}
                found[name][1].append({"student_id": one["student_id"]} | cells)
    return found


def read_overrides(path: Path | None, rubric: Rubric) -> dict[tuple[str, str], tuple[float, str]]:
    """(points, reason) by (student, exercise) from `student_id,exercise,points,reason`; every line needs a reason.

    Raises:
        UnusableInput: an unknown exercise, points out of range, no reason, or a line that stands twice.
    """
    found: dict[tuple[str, str], tuple[float, str]] = {}
    most = rubric.points()
    for k, row in enumerate(read_csv(path, ("student_id", "exercise", "points", "reason")) if path else [], 2):
        key = row["student_id"], row["exercise"]
        try:
            points = float(row["points"])
        except ValueError:
            points = -1.0
        if row["exercise"] not in most or not 0.0 <= points <= most[row["exercise"]]:
            raise UnusableInput(f"{path.name}, line {k}: exercise or points that the rubric does not know")
        if not row["reason"].strip() or key in found:
            raise UnusableInput(f"{path.name}, line {k}: no reason is given, or the line stands twice")
        found[key] = points, row["reason"].strip()
    return found
