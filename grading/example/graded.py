"""The example class graded, and its table compared with the expected one."""

import csv
import io
import shutil
from pathlib import Path

from dualnav_lite.config import UnusableInput
from dualnav_lite.exercises import stub
from grading.example.students import hand_in, many
from grading.grade import grade_class
from grading.job import Limits
from grading.late import late_shares
from grading.rebuild import read_master
from grading.room import NOTEBOOKS, Room, prepared
from grading.rubric import Rubric, load_rubric
from grading.secret import Secret
from grading.store import write_whole
from grading.tables import COLUMNS, to_csv
from grading.tiers import choose_tier

HERE = Path(__file__).resolve().parent
KEY = b"the key of the example is no secret"
DUE = "2026-03-02T23:59:00"
NOT_COMPARED = ("tier", "grader_version")  # of the machine and of the kit's age


def compared(table: bytes) -> list[dict[str, str]]:
    """Rows of a `grades.csv` without what differs from one machine to the next."""
    rows = list(csv.DictReader(io.StringIO(table.decode("utf-8"))))
    return [{name: value for name, value in row.items() if name not in NOT_COMPARED} for row in rows]


def differences(table: bytes) -> list[str]:
    """A line for each row in which a `grades.csv` is not the expected one."""
    found, right = compared(table), compared((HERE / "grades.csv").read_bytes())
    key = ("student_id", "exercise")
    by_key = {tuple(row[name] for name in key): row for row in found}
    lines = []
    for row in right:
        got = by_key.pop(tuple(row[name] for name in key), {})
        wrong = [f"{name} '{got.get(name)}', not '{row[name]}'" for name in row if got.get(name) != row[name]]
        if wrong:
            lines.append(f"{' '.join(row[name] for name in key)}: {'; '.join(wrong)}")
    lines += [f"{' '.join(one)}: is not expected" for one in by_key]
    return lines or ([] if found == right else ["the rows stand in another order"])


def example_rubric(lesson: str = "") -> Rubric:
    """The rubric of the example, or what is left of it for one lesson alone."""
    rubric = load_rubric(HERE / "rubric.yaml")
    if not lesson:
        return rubric
    left = {"lessons": {lesson: rubric.lessons[lesson]}, "policy": None}
    total = sum(one.points for one in rubric.lessons[lesson].exercises.values())
    return rubric.model_copy(update=left | {"total": total})


def grade_example(
    out: Path,
    *,
    folder: Path = HERE / "class",
    rubric: Rubric | None = None,
    tier: str = "",
    update: bool = False,
    **how,
) -> bytes:
    """The class graded into a folder; its `grades.csv`.

    Args:
        out: folder of results and tables.
        folder: another class; rubric: another one.
        tier: the best that works if empty.
        update: make the class anew first, and its table the expected one afterwards.
        how: `jobs`, `cluster`, `shard`, `say` of `grade_class`.
    """
    rubric = rubric or example_rubric()
    late = late_shares(HERE / "times.csv", DUE, rubric.late)
    with prepared(rubric, Secret(KEY, rubric.assignment), choose_tier(wanted=tier), Limits()) as room:
        if update:
            renew(room)
        grade_class(folder, out, room, late=late, **how)
    table = (out / "grades.csv").read_bytes()
    if update:
        rows = [row | dict.fromkeys(NOT_COMPARED, "") for row in compared(table)]
        write_whole(HERE / "grades.csv", to_csv(COLUMNS, rows))
    return table


def renew(room: Room) -> None:
    """Write the class anew from the teacher's notebooks."""
    shutil.rmtree(HERE / "class", ignore_errors=True)
    hand_in(room.rubric, room.masters, HERE / "class")


def hand_in_many(count: int, folder: Path) -> Path:
    """Write the submissions of a class of any size; the rubric to grade it with.

    Raises:
        UnusableInput: the folder is there already.
    """
    if folder.exists():
        raise UnusableInput(f"{folder}: is there already; name a new folder")
    path = HERE / "many.yaml"
    rubric = load_rubric(path)
    masters = {lesson: read_master(NOTEBOOKS / f"{lesson}.ipynb", stub) for lesson in rubric.lessons}
    hand_in(rubric, masters, folder, many(count))
    return path
