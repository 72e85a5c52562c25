"""Points into a table that was exported from Moodle, Canvas, Gradescope or nbgrader: joined by id, the rest kept."""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dualnav_lite.config import UnusableInput
from grading.tables import COLUMNS, defused, number, read_csv


@dataclass(frozen=True)
class Form:
    """How a system's own table is filled.

    Attributes:
        ids: columns of which one holds the students' ids: the one with most of them, since numbers of other columns may
            be somebody else's.
        points: column that takes the points; empty where the caller names it.
        skip: rows above the first student, below the header.
        id_of: from a cell to an id.
    """

    ids: tuple[str, ...]
    points: str
    skip: int = 0
    id_of: Callable[[str], str] = str.strip


FORMS = {
    # "Participant 1234" of the grading worksheet is the 1234 in the folder names of the bulk download.
    "moodle": Form(("Identifier",), "Grade", id_of=lambda cell: cell.strip().rpartition(" ")[2]),
    "canvas": Form(("SIS User ID", "SIS Login ID", "ID"), "", skip=1),  # below the header: "Points Possible"
    "gradescope": Form(("SID", "Email"), "Total Score"),
    "nbgrader": Form(("student_id",), "score"),
}


def totals(rows: list[dict]) -> dict[str, str]:
    """Points by student; a student with an ungraded exercise is left out, so that nobody gets a zero by mistake."""
    found: dict[str, float] = {}
    ungraded = {row["student_id"] for row in rows if row["status"] == "ungraded"}
    for row in rows:
        if row["student_id"] not in ungraded:
            found[row["student_id"]] = found.get(row["student_id"], 0.0) + float(row["points"])
    return {student: number(points) for student, points in found.items()}


def fill(system: str, template: bytes, points: dict[str, str], column: str = "") -> tuple[bytes, list[str]]:
    """The table with points in it, and the students who are in no row of it.

    Args:
        system: a key of `FORMS`.
        template: exported there; header, rows, other columns and byte order mark are kept.
        points: by student id.
        column: that takes the points; Canvas needs it, as its name holds the assignment's.

    Raises:
        UnusableInput: no such system, or the template lacks a column.
    """
    if system not in FORMS:
        raise UnusableInput(f"unknown system '{system}'; known: {', '.join(FORMS)}")
    form, mark = FORMS[system], b"\xef\xbb\xbf" if template.startswith(b"\xef\xbb\xbf") else b""
    try:
        lines = list(csv.reader(io.StringIO(template.decode("utf-8-sig"), newline="")))
    except (UnicodeDecodeError, csv.Error) as error:
        raise UnusableInput(f"the template cannot be read: {' '.join(str(error).split())[:120]}") from None
    header = lines[0] if lines else []
    wanted = column or form.points
    ids = [header.index(name) for name in form.ids if name in header]
    if not ids:
        raise UnusableInput(f"the template has none of the columns {', '.join(form.ids)}; is it {system}'s own?")
    if wanted not in header:
        raise UnusableInput(f"the template has no column '{wanted}'; name the one that takes the points by --column")
    place, missing = header.index(wanted), set(points)
    students = [line for line in lines[1 + form.skip :] if len(line) == len(header)]
    named = max(ids, key=lambda k: len(points.keys() & {defused(form.id_of(line[k])) for line in students}))
    for line in students:
        mine = defused(form.id_of(line[named]))  # as it stands in grades.csv
        if mine in points:
            line[place] = points[mine]
            missing.discard(mine)
    text = io.StringIO(newline="")
    writer = csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\r\n" if b"\r\n" in template else "\n")
    writer.writerows([defused(cell) for cell in line] for line in lines)
    return mark + text.getvalue().encode("utf-8"), sorted(missing)


def gradescope_results(rows: list[dict], say: Callable[[dict], str]) -> dict[str, dict]:
    """Gradescope's `results.json` by student; `say` gives a row's line of feedback.

    An ungraded exercise is left out of the tests, and a student without any graded one has no file.
    """
    found: dict[str, dict] = {}
    for row in rows:
        if row["status"] == "ungraded":
            continue
        one = found.setdefault(row["student_id"], {"output_format": "text", "visibility": "visible", "tests": []})
        score = {"score": float(row["points"]), "max_score": float(row["max_points"])}
        one["tests"].append(score | {"name": row["exercise"], "output_format": "text", "output": say(row)})
    return found


def read_rows(out: Path) -> list[dict]:
    """Rows of the grades in an output folder.

    Raises:
        UnusableInput: there are none, or a spreadsheet has spoilt them.
    """
    for name in ("grades.csv", "grades.UNSANDBOXED.csv"):
        if (out / name).exists():
            rows = read_csv(out / name, COLUMNS)
            for k, row in enumerate(rows, 2):
                try:
                    float(row["points"]), float(row["max_points"])
                except ValueError:
                    if row["status"] != "ungraded":
                        raise UnusableInput(f"{name}, line {k}: the points are no number") from None
            return rows
    raise UnusableInput(f"{out}: holds no grades.csv; grade first")


def results_json(content: dict) -> bytes:
    """Text of a `results.json`."""
    return (json.dumps(content, ensure_ascii=False, indent=1) + "\n").encode("utf-8")
