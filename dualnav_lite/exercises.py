"""Exercise cells of a notebook: nbgrader's blocks, and the student's version with stubs in place of solutions."""

import re

import nbformat

from dualnav_lite.config import UnusableInput

BEGIN, END = "### BEGIN SOLUTION", "### END SOLUTION"
IDENTIFIER = re.compile(r"[a-z][a-z0-9_]*")
SCHEMA = {"schema_version": 3, "task": False}  # nbgrader's, whose preprocessors read these blocks


def exercise_block(metadata, source: str, identity: str) -> dict:
    """nbgrader's block of a cell that is tagged `solution`, `check` or `given`; empty for any other.

    Args:
        metadata: what the source says of the cell: grade_id, points, tags.
        source: of the cell.
        identity: the cell's id.

    Raises:
        UnusableInput: a solution without an exercise id or without a pair of markers, a check without points.
    """
    tags = metadata.get("tags", [])
    name, points = metadata.get("grade_id"), metadata.get("points")
    if "solution" in tags and not (name and IDENTIFIER.fullmatch(name)):
        raise UnusableInput(f"a cell tagged 'solution' needs a grade_id of small letters, digits and _, got '{name}'")
    if "solution" in tags and not _spans(source):
        raise UnusableInput(f"exercise '{name}': needs '{BEGIN}' and, after it, '{END}', on lines of their own")
    if "check" in tags and not (name and name.endswith("_check") and isinstance(points, int) and points >= 0):
        raise UnusableInput(f"a cell tagged 'check' needs grade_id=\"..._check\" and points, got '{name}', {points}")
    if "solution" in tags:
        return {"grade": False, "grade_id": name, "locked": False, "solution": True} | SCHEMA
    if "check" in tags:
        return {"grade": True, "grade_id": name, "locked": True, "points": points, "solution": False} | SCHEMA
    if "given" in tags:
        return {"grade": False, "grade_id": identity, "locked": True, "solution": False} | SCHEMA
    return {}


def _spans(source: str) -> list[tuple[int, int]]:
    """First and last line of each solution, markers included; empty where the markers do not pair."""
    marks = [(k, line.strip()) for k, line in enumerate(source.splitlines()) if line.strip() in (BEGIN, END)]
    if len(marks) % 2 or any(mark != (BEGIN, END)[k % 2] for k, (_, mark) in enumerate(marks)):
        return []
    numbers = [number for number, _ in marks]
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def stub(source: str, exercise: str) -> str:
    """A solution cell as a student gets it: each solution is one line that raises.

    >>> print(stub("def f(x):\\n    ### BEGIN SOLUTION\\n    return x\\n    ### END SOLUTION", "f"))
    def f(x):
        raise NotImplementedError("exercise f")
    """
    lines = source.splitlines()
    for first, last in reversed(_spans(source)):
        margin = lines[first][: len(lines[first]) - len(lines[first].lstrip())]
        lines[first : last + 1] = [f'{margin}raise NotImplementedError("exercise {exercise}")']
    return "\n".join(lines)


def student_notebook(text: str) -> str:
    """The student's version of a notebook: the same cells, with stubs in place of solutions; outputs dropped."""
    notebook = nbformat.reads(text, as_version=4)
    notebook.metadata.pop("made_from", None)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
            if "solution" in cell.metadata.get("tags", []):
                cell.source = stub(cell.source, cell.id)
    return nbformat.writes(notebook) + "\n"
