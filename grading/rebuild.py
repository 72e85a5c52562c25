"""The notebook that is run: given cells of the master, solution cells of the submission, one serve cell.

Of a submission only the type and the source of the asked exercises' cells are taken. Its outputs, metadata, kernel,
language, parameters, tags and all other cells never reach papermill.
"""

import ast
import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

MOST_NOTEBOOK = 20 * 1024 * 1024
MOST_PARTS = 1_000_000  # lists and dicts in it, of 60 bytes and more each in memory
MOST_SOURCE = 50_000  # ten times any solution; Python's parser takes the square of it for some texts
MOST_CELLS = 5_000
KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
# The paths are looked up inside, since they differ between tiers. The first cell says that the kernel runs: what goes
# wrong before is our fault, what goes wrong between the two is the student's.
START = """import os as _os, sys as _sys
_sys.path.insert(0, _os.environ["GRADING_FOLDER"])
import serve as _grading_serve
_grading_connection = _grading_serve.greet(_os.environ["GRADING_SOCKET"])
"""
SERVE = """_grading_serve.run(globals(), _grading_connection, _os.environ["GRADING_EXECUTED"])
"""


class Unreadable(ValueError):
    """A notebook that is none; its text is a reason code."""


@dataclass(frozen=True)
class Master:
    """What the teacher's notebook of a lesson gives.

    Attributes:
        order: cells that are run, as ("given", source) or ("solution", exercise).
        solutions: reference source by exercise.
        stubs: what a student was given, by exercise.
    """

    order: tuple[tuple[str, str], ...]
    solutions: dict[str, str]
    stubs: dict[str, str]


def text_of(source) -> str | None:
    """A cell's source as a string; None where it is no text, too long, or holds NUL or half of a character."""
    if isinstance(source, list) and all(isinstance(line, str) for line in source):
        source = "".join(source)
    if not isinstance(source, str) or len(source) > MOST_SOURCE or "\0" in source:  # a NUL marks our own reasons
        return None
    try:
        source.encode("utf-8")
    except UnicodeEncodeError:
        return None
    return source


def cells_in(content: bytes) -> list[dict]:
    """Cells of a notebook file.

    Raises:
        Unreadable: `too_large`, `not_a_notebook`.
    """
    if len(content) > MOST_NOTEBOOK or content.count(b"[") + content.count(b"{") > MOST_PARTS:
        raise Unreadable("too_large")
    try:
        found = json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError, UnicodeDecodeError):
        raise Unreadable("not_a_notebook") from None
    cells = found.get("cells") if isinstance(found, dict) else None
    if not isinstance(cells, list) or len(cells) > MOST_CELLS:
        raise Unreadable("not_a_notebook")
    return [cell for cell in cells if isinstance(cell, dict)]


def solution_cells(content: bytes, exercises: tuple[str, ...]) -> dict[str, str]:
    """Source of each exercise's cell, or a reason code behind a NUL where there is none that can be used.

    A cell is found by its id, which is the exercise's; where an editor dropped the ids, by nbgrader's `grade_id`.
    """
    cells = [cell for cell in cells_in(content) if cell.get("cell_type") == "code"]
    found = {}
    for exercise in exercises:
        matches = [cell for cell in cells if cell.get("id") == exercise]
        if not matches:
            matches = [cell for cell in cells if _grade_id(cell) == exercise]
        if not matches:
            found[exercise] = "\0cell_missing"
        elif len(matches) > 1:
            found[exercise] = "\0cell_twice"
        else:
            text = text_of(matches[0].get("source"))
            found[exercise] = "\0cell_is_no_text" if text is None else text
    return found


def _grade_id(cell: dict):
    metadata = cell.get("metadata")
    block = metadata.get("nbgrader") if isinstance(metadata, dict) else None
    return block.get("grade_id") if isinstance(block, dict) else None


def read_master(path: Path, stub) -> Master:
    """The teacher's notebook of a lesson.

    Args:
        path: `notebooks/NN_name.ipynb`.
        stub: function of (source, exercise) that makes the student's version of a cell.
    """
    order, solutions, stubs = [], {}, {}
    for cell in cells_in(path.read_bytes()):
        tags = cell.get("metadata", {}).get("tags", [])
        source = text_of(cell.get("source", "")) or ""
        if cell.get("cell_type") != "code":
            continue
        if "given" in tags:
            order.append(("given", source))
        elif "solution" in tags:
            exercise = cell["id"]
            order.append(("solution", exercise))
            solutions[exercise], stubs[exercise] = source, stub(source, exercise)
    return Master(tuple(order), solutions, stubs)


def rebuilt(master: Master, sources: dict[str, str], lent: Collection[str] = ()) -> bytes:
    """The notebook that papermill gets.

    Args:
        master: of the lesson.
        sources: cell by exercise; exercises that are missing are left out.
        lent: exercises whose reference is given, after the cell where there is one.
    """
    texts = {"start": START}
    for k, (kind, value) in enumerate(master.order):
        if kind == "given":
            texts[f"given-{k}"] = value
            continue
        if value in sources:
            texts[f"solution-{k}"] = sources[value]
        if value in lent:
            texts[f"lent-{k}"] = master.solutions[value]
    texts["serve"] = SERVE
    cells = [
        {"cell_type": "code", "execution_count": None, "id": name, "metadata": {}, "outputs": [], "source": text}
        for name, text in texts.items()
    ]
    return json.dumps({"cells": cells, "metadata": KERNEL, "nbformat": 4, "nbformat_minor": 5}).encode("utf-8")


def normalised(source: str) -> str:
    """A cell without comments, docstrings, blank space and the names of its own variables, to see copies.

    Falls back to the text without blank space where it is no Python.
    """
    try:
        tree = ast.parse(source)
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list) and len(body) > 1 and _is_docstring(body[0]):
                del body[0]
        names: dict[str, str] = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.arg):
                node.annotation = None
            if isinstance(node, ast.FunctionDef):
                node.returns = None
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.setdefault(node.id, f"v{len(names)}")
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and node.id in names:
                node.id = names[node.id]
        return ast.dump(tree, annotate_fields=False)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return "".join(source.split())


def names_of(source: str) -> dict[str, str]:
    """Names that a cell binds in the notebook, with what is imported as each, empty for its own; none in no Python."""
    names: dict[str, str] = {}
    try:
        for node in ast.parse(source).body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                names[node.name] = ""
                continue
            for one in ast.walk(node):
                if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store):
                    names[one.id] = ""
                elif isinstance(one, ast.Import | ast.ImportFrom):
                    for alias in one.names:
                        whole = alias.name if alias.asname else alias.name.partition(".")[0]
                        names[alias.asname or whole] = f"{getattr(one, 'module', '')}.{whole}"
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return {}
    return names


def _is_docstring(node) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
