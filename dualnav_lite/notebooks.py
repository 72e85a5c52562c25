"""Notebooks: made from percent scripts byte for byte, and taken back into them; `execution` runs them.

`notebooks/src/NN_name.py` is edited, `notebooks/NN_name.ipynb` is made from it and committed without outputs; the same
in `stress_tests/`.
"""

import hashlib
import json
import re
from collections import Counter
from pathlib import Path

import jupytext
import nbformat

from dualnav_lite.config import ROOT, UnusableInput, write_atomic
from dualnav_lite.exercises import exercise_block

FOLDERS = ("notebooks", "stress_tests")
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
CELL_METADATA = ("grade_id", "points", "tags")  # what a source may say of a cell; JupyterLab's own marks stay out


def _slug(text: str) -> str:
    """Letters and digits of a heading, joined by hyphens: `## 2. See it` gives `2-see-it`."""
    return "-".join(re.findall(r"[a-z0-9]+", text.lower()))[:48]


def _named_cells(cells) -> list:
    """The cells with what a source may say alone, and their ids: grade_id, or section and ordinal."""
    named: list = []
    headings, section, seen = 0, "top", Counter[str]()
    for cell in cells:
        heading = re.match(r"#+\s+(.+)", cell.source) if cell.cell_type == "markdown" else None
        if heading:
            headings += 1
            section = _slug(heading[1]) or f"section-{headings}"
        seen[section] += 1
        metadata = _said_of(cell)
        new = getattr(nbformat.v4, f"new_{cell.cell_type}_cell")
        identity = metadata.get("grade_id", f"{section}-{seen[section]}")
        if not re.fullmatch(r"[A-Za-z0-9_-]+", identity):
            raise UnusableInput(f"a grade_id is made of letters, digits, - and _, got '{identity}'")
        named.append(new(source=cell.source.strip("\n"), metadata=metadata, id=identity))
    return named


def _said_of(cell) -> dict:
    """What a source says of a cell; in a notebook nbgrader's block holds a part of it."""
    block = cell.metadata.get("nbgrader", {})
    if "given" in cell.metadata.get("tags", []):
        block = {}  # its grade_id is the cell's id
    everything = {**block, **cell.metadata}
    return {key: everything[key] for key in CELL_METADATA if everything.get(key) not in (None, "", [])}


def _with_blocks(cells) -> list:
    """The cells as a notebook holds them: exercise id and points stand in nbgrader's block."""
    for cell in cells:
        block = exercise_block(cell.metadata, cell.source, cell.id)
        if block:
            cell.metadata = {"nbgrader": block} | {k: v for k, v in cell.metadata.items() if k == "tags"}
    return cells


def _fingerprint(cells) -> str:
    """Hash of what a reader would call the content; blank lines around cells and outputs do not count."""
    content = [(cell.cell_type, cell.source, cell.metadata) for cell in _named_cells(cells)]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode("utf-8")).hexdigest()


def to_notebook(source: str) -> str:
    """Text of the notebook that a percent script makes, without outputs; the same bytes each time.

    Raises:
        UnusableInput: two cells would have the same id, or a grade_id is not letters, digits, `-` and `_`.
    """
    cells = _named_cells(jupytext.reads(source, fmt="py:percent").cells)
    made_from = {"made_from": _fingerprint(cells)}  # tells later which side was edited since
    ids = Counter(cell.id for cell in cells)
    repeated = [name for name, count in ids.items() if count > 1]
    if repeated:
        raise UnusableInput(
            f"cell id '{repeated[0]}' stands for {ids[repeated[0]]} cells; give one a grade_id of its own"
        )
    notebook = nbformat.v4.new_notebook(cells=_with_blocks(cells), metadata=METADATA | made_from)
    notebook.nbformat_minor = 5
    try:
        return nbformat.writes(notebook) + "\n"
    except nbformat.ValidationError as error:
        raise UnusableInput(f"not a valid notebook: {error.message}") from None


def to_source(cells) -> str:
    """Percent script of a notebook's cells, outputs and execution counts dropped: `to_notebook` turned round."""
    plain = nbformat.v4.new_notebook(
        cells=_named_cells(cells), metadata={"jupytext": {"notebook_metadata_filter": "-all"}}
    )
    return jupytext.writes(plain, fmt="py:percent")


def pairs(root: Path = ROOT) -> list[tuple[Path, Path]]:
    """Every (source, notebook) in the folders, by name; one of the two may not exist yet."""
    found = []
    for folder in FOLDERS:
        sources = {path.stem for path in (root / folder / "src").glob("*.py")}
        notebooks = {path.stem for path in (root / folder).glob("*.ipynb")}
        for stem in sorted(sources | notebooks):
            found.append((root / folder / "src" / f"{stem}.py", root / folder / f"{stem}.ipynb"))
    return found


def rebuild(root: Path = ROOT, check: bool = False) -> list[Path]:
    """Notebooks that were not what their source makes; they are written anew unless it is only a check.

    Raises:
        UnusableInput: a notebook has no source, a source makes no valid notebook, or an edit would be lost.
    """
    changed = []
    for source, notebook in pairs(root):
        if not source.exists():
            raise UnusableInput(f"{notebook.name}: its source src/{source.name} is missing")
        try:
            text = to_notebook(source.read_text(encoding="utf-8"))
        except UnusableInput as error:
            raise UnusableInput(f"src/{source.name}: {error}") from None
        if not notebook.exists() or notebook.read_bytes() != text.encode("utf-8"):
            changed.append(notebook)
            if not check:
                if notebook.exists() and _is_edited(found := opened(notebook), found.cells):
                    name = notebook.stem
                    raise UnusableInput(
                        f"{name}.ipynb was edited: take it back (--take-back {name}) or delete it first"
                    )
                write_atomic(notebook, text)
    return changed


def opened(path: Path):
    """The notebook in a file; `UnusableInput` where there is none."""
    try:
        return nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)
    except (OSError, ValueError, AttributeError, nbformat.ValidationError) as error:
        raise UnusableInput(f"{path.name}: not a notebook that can be read: {error}") from None


def _is_edited(notebook, cells) -> bool:
    """Whether these cells are others than the ones that the notebook was made from."""
    return notebook.metadata.get("made_from") not in (None, _fingerprint(cells))


def take_back(name: str, root: Path = ROOT) -> Path:
    """Bring an edit made in JupyterLab into the source; returns the source.

    Args:
        name: the notebook's name or the start of it, such as `00`.

    Raises:
        UnusableInput: no notebook starts like this, or more than one; it cannot be read; the source was edited as well.
    """
    stem = Path(name).stem
    matches = [pair for pair in pairs(root) if pair[1].exists() and pair[1].stem.startswith(stem)]
    exact = [pair for pair in matches if pair[1].stem == stem]
    if len(exact or matches) != 1:
        known = ", ".join(pair[1].stem for pair in matches or pairs(root))
        raise UnusableInput(f"'{name}' names {'several notebooks' if matches else 'no notebook'}: {known}")
    source, path = (exact or matches)[0]
    notebook = opened(path)
    if source.exists():
        cells = jupytext.reads(source.read_text(encoding="utf-8"), fmt="py:percent").cells
        if _is_edited(notebook, cells):
            raise UnusableInput(
                f"src/{source.name} was edited since {path.name} was made: rebuild, or join them by hand"
            )
    text = to_source(notebook.cells)
    built = to_notebook(text)
    write_atomic(source, text)
    write_atomic(path, built)
    return source
