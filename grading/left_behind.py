"""What must not lie in a folder that is given to students: solutions, scorers, tests, keys."""

import json
from pathlib import Path

from grading.rebuild import normalised, read_master
from grading.secret import LEAST_BYTES

FORBIDDEN = ("grading", "tests", "notebooks/src", ".git", ".github", ".ci")
MARKERS = ("### BEGIN SOLUTION", "### END SOLUTION")


def left_behind(folder: Path, notebooks: Path, stub, key: bytes = b"") -> list[str]:
    """Lines about what should not be in a released folder.

    Args:
        folder: the student version.
        notebooks: of the teacher, with the solutions.
        stub: function of (source, exercise) that makes the student's version of a cell.
        key: the secret, where there is one.
    """
    found = [f"{name} is in it" for name in FORBIDDEN if (folder / name).exists()]
    lessons = sorted(notebooks.glob("[0-9][0-9]_*.ipynb"))
    for lesson in lessons:
        theirs = folder / "notebooks" / lesson.name
        if not theirs.is_file():
            found.append(f"{lesson.name} is not in it")
            continue
        master = read_master(lesson, stub)
        answers = {normalised(source) for source in master.solutions.values()}
        for cell in json.loads(theirs.read_text(encoding="utf-8"))["cells"]:
            source = "".join(cell["source"])
            if cell["cell_type"] == "code" and (cell["outputs"] or cell["execution_count"]):
                found.append(f"{lesson.name}: cell {cell['id']} has been run")
            if any(marker in source for marker in MARKERS) or normalised(source) in answers:
                found.append(f"{lesson.name}: cell {cell['id']} holds a solution")
    secret = key.strip()
    if len(secret) >= LEAST_BYTES:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and not path.is_symlink() and secret in path.read_bytes():
                found.append(f"{path.relative_to(folder)} holds the key")
    return found
