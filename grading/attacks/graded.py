"""Attacks graded as one class, by the same calls as any class, and their endings compared with the table's."""

import csv
import hashlib
import io
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from grading.attacks.canaries import Canaries
from grading.attacks.submissions import hand_in
from grading.attacks.table import EXERCISES, Attack
from grading.folders import own_prefix
from grading.grade import grade_class
from grading.intake import MOODLE, is_plain
from grading.job import Limits
from grading.room import NOTEBOOKS, PACKAGE, prepared
from grading.rubric import Policy, Rubric, Survival, load_rubric
from grading.secret import Secret
from grading.tables import FORMULA

LESSON = "07_rewards"
SECONDS = 6.0  # of the attacked function: what hangs costs this
# Small, so that whoever takes more than his share is stopped before this machine notices.
LIMITS = Limits(memory_mb=900, disk_mb=96, files=5_000, cells_s=15.0)


@dataclass
class Ending:
    """How one attack ended: by exercise "status reason", and whether that is right."""

    attack: Attack
    found: dict[str, str]
    right: bool


def attacked_rubric() -> Rubric:
    """The rubric's lesson with the attacked exercise and the one beside it, and a short time for the former."""
    rubric = load_rubric()
    lesson = rubric.lessons[LESSON]
    exercises = {name: one for name, one in lesson.exercises.items() if name in EXERCISES}
    exercises["goal"] = exercises["goal"].model_copy(update={"seconds": SECONDS})
    mask = {symbol: name if name in EXERCISES else "goal" for symbol, name in lesson.mask.items()}
    policy = Policy(survival=Survival(points=1.0, thresholds={"navigation": 0.65}, first=20, most=20), seconds=30.0)
    lesson = lesson.model_copy(update={"exercises": exercises, "mask": mask})
    total = 1.0 + sum(exercise.points for exercise in exercises.values())
    return rubric.model_copy(update={"lessons": {LESSON: lesson}, "policy": policy, "total": total})


def student_of(folder: str) -> str:
    """What the grader calls whoever hands in a folder of this name."""
    moodle = MOODLE.fullmatch(folder)
    if moodle:
        return moodle["id"]
    return folder if is_plain(folder) else f"unnamed-{hashlib.sha256(os.fsencode(folder)).hexdigest()[:12]}"


def is_inert(table: bytes) -> bool:
    """Whether no cell of a table is computed by a spreadsheet or sent to a terminal as a command."""
    cells = [cell for row in csv.reader(io.StringIO(table.decode("utf-8"))) for cell in row]
    return not any(cell.startswith(FORMULA) or not cell.isprintable() for cell in cells)


def run_all(attacks: list[Attack], tier: str, say=lambda text: None, jobs: int = 1) -> tuple[list[Ending], list[str]]:
    """Endings in the order of the attacks, and what else is wrong: canaries reached, work lost, a table that computes.

    Args:
        attacks: of the table.
        tier: from `choose_tier`.
        say: called with lines about the progress.
        jobs: sandboxes side by side.
    """
    notebook = NOTEBOOKS / f"{LESSON}.ipynb"
    with tempfile.TemporaryDirectory(prefix=f"{own_prefix()}attacks-") as place:
        room, out = Path(place) / "class", Path(place) / "out"
        with Canaries(room, out, PACKAGE.parent) as canaries:
            by_folder = {hand_in(one, room, notebook, canaries.places).name: one for one in attacks}
            (room / "honest").mkdir()
            (room / "honest" / notebook.name).write_bytes(notebook.read_bytes())
            with prepared(attacked_rubric(), Secret(b"attack" * 8, "attacks"), tier, LIMITS) as prepared_room:
                rows, lost = grade_class(room, out, prepared_room, jobs=jobs, say=say)
            wrong = canaries.touched()
            if lost:
                wrong.append(f"{lost} submissions were lost")
            if not is_inert((out / "grades.csv").read_bytes()):
                wrong.append("grades.csv is not inert")
            found = {
                (row["student_id"], row["exercise"]): f"{row['status']} {row['reason_code']}".strip() for row in rows
            }
    if any(found["honest", exercise] != "passed" for exercise in EXERCISES[:2]):
        wrong.append("the honest submission lost points")
    endings = []
    for folder, attack in by_folder.items():
        ended = {exercise: found[student_of(folder), exercise] for exercise in EXERCISES}
        right = all(ended[exercise] in expected for exercise, expected in attack.endings(tier).items())
        endings.append(Ending(attack, ended, right))
    return endings, wrong
