"""A student's parts: taken from the solution cells of the notebooks, used where they pass, the library's elsewhere."""

import contextlib
import io
import json
import sys
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cloudpickle

from dualnav_lite.check import LESSONS, judge, lesson_of, reference
from dualnav_lite.check.verdict import NotDone, Text, language_of
from dualnav_lite.chunks import PARTS_MARK, sha256
from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.notebooks import opened

SUMMARY = "parts.json"
POLICY = "ppo_actor.onnx"  # what lesson 11 exports into `weights/`
IN_WORLDS = ("encode_state", "reward_terms")  # the parts that a world can be made with
STAND_IN_IMPORT = "from dualnav_lite.check import reference"
STAND_IN = '{id} = reference("{id}")  # the library\'s, for the functions that call it'
STATES = {
    "passed": Text("passed", "通过"),
    "wrong": Text("not right yet", "还不对"),
    "not done": Text("not done yet", "尚未完成"),
    "no notebook": Text("no notebook here", "此处没有笔记本"),
}
YOURS = Text("{id}: yours", "{id}：使用你的实现")
LIBRARY = Text("{id}: the library's ({state})", "{id}：使用库的实现（{state}）")
EXPORTED = Text("{n} of your parts: {folder}", "你的部件共 {n} 个：{folder}")


@dataclass(frozen=True)
class Part:
    """The function that stands for an exercise.

    Attributes:
        exercise, lesson: ids.
        state: a key of `STATES`.
        function: the student's where it passed, else the library's.
    """

    exercise: str
    lesson: str
    state: str
    function: Callable

    @property
    def is_yours(self) -> bool:
        """Whether the student's function is used."""
        return self.state == "passed"


def cells_of(path: Path) -> list[tuple[str, str]]:
    """(exercise or "", source) of the given and solution cells of a notebook, in order.

    Raises:
        UnusableInput: no notebook can be read from the file.
    """
    kept = []
    for cell in opened(path).cells:
        tags = cell.metadata.get("tags", [])
        if cell.cell_type == "code" and ("given" in tags or "solution" in tags):
            kept.append((cell.get("id", "") if "solution" in tags else "", cell.source))
    return kept


def _run(cells: list[tuple[str, str]], name: str) -> dict:
    """Names that the cells define; a cell that raises defines nothing, and no cell prints."""
    module = types.ModuleType(name)
    sys.modules[name] = module
    cloudpickle.register_pickle_by_value(module)  # processes of `ParallelVectorEnv` cannot import it
    for exercise, source in cells:
        with contextlib.suppress(Exception), contextlib.redirect_stdout(io.StringIO()):
            exec(compile(source, f"{name}.{exercise or 'given'}", "exec"), module.__dict__)
    return module.__dict__


def lesson_parts(lesson: str, cells: list[tuple[str, str]] | None) -> dict[str, Part]:
    """The part of each exercise of a lesson; cells None means that there is no notebook.

    A function that calls one of an earlier exercise gets the library's where that one does not pass.
    """
    found = _run(cells, f"parts_of_{lesson}") if cells else {}
    parts = {}
    for exercise in LESSONS[lesson]:
        mine = found.get(exercise)
        if mine is None:
            state = "not done" if cells else "no notebook"
        else:
            wrong = judge(exercise, mine)
            state = "passed" if wrong is None else "not done" if isinstance(wrong, NotDone) else "wrong"
        parts[exercise] = Part(exercise, lesson, state, mine if state == "passed" else reference(exercise))
        found[exercise] = parts[exercise].function
    return parts


def parts_in(folder: str | Path = ".", lessons=None) -> dict[str, Part]:
    """The parts of all lessons, or of some, from the notebooks in a folder."""
    found: dict[str, Part] = {}
    for lesson in lessons or LESSONS:
        path = Path(folder) / f"{lesson}.ipynb"
        found |= lesson_parts(lesson, cells_of(path) if path.exists() else None)
    return found


def has_lessons(folder: str | Path) -> bool:
    """Whether a folder holds a notebook of a lesson with exercises."""
    return any((Path(folder) / f"{lesson}.ipynb").exists() for lesson in LESSONS)


def _line(part: Part, language: str) -> str:
    text, state = (YOURS if part.is_yours else LIBRARY), STATES[part.state]
    k = ("en", "zh").index(language)
    return text[k].format(id=part.exercise, state=state[k])


def part(exercise: str, folder: str | Path = ".", lang: str | None = None) -> Callable:
    """The function of an earlier lesson's exercise: yours if it passes, else the library's; prints which.

    It reads the saved notebook of that lesson in the folder, so save it first.
    """
    lesson = lesson_of(exercise)
    found = parts_in(folder, [lesson])[exercise]
    print(_line(found, language_of(lang)))
    return found.function


def status(folder: str | Path = ".", lang: str | None = None, export: str | Path | None = None) -> None:
    """Print whose part is used for each exercise, and keep it in `parts.json` of the folder.

    Args:
        folder: with the notebooks.
        lang: as in `check`.
        export: another folder, which gets what is yours (`export_parts`); nothing where there is no lesson.
    """
    language = language_of(lang, folder)
    found = export_parts(folder, export) if export and has_lessons(folder) else parts_in(folder)
    for lesson in LESSONS:
        print(lesson)
        for one in found.values():
            if one.lesson == lesson:
                print("  " + _line(one, language))
    write_atomic(Path(folder) / SUMMARY, _summary(found))
    if export:
        count = sum(one.is_yours for one in found.values())
        print(EXPORTED[("en", "zh").index(language)].format(n=count, folder=export))


def _summary(parts: dict[str, Part]) -> str:
    rows = {
        one.exercise: {"lesson": one.lesson, "state": one.state, "is_yours": one.is_yours} for one in parts.values()
    }
    return json.dumps(rows, indent=1) + "\n"


def export_parts(notebooks: str | Path, out: str | Path) -> dict[str, Part]:
    """Write what passes as `<lesson>.py` (given cells, then the student's functions), the policy, and `parts.json`.

    Args:
        notebooks: folder with the lessons' notebooks.
        out: folder that `load_parts` and `stress --parts` take.

    Raises:
        UnusableInput: no lesson lies in the folder, or `out` refuses.
    """
    if not has_lessons(notebooks):
        raise UnusableInput(f"{notebooks}: no lesson of the course lies there")
    found: dict[str, Part] = {}
    for lesson in LESSONS:
        path = Path(notebooks) / f"{lesson}.ipynb"
        cells = cells_of(path) if path.exists() else None
        found |= lesson_parts(lesson, cells)
        kept = [STAND_IN_IMPORT]
        for exercise, source in cells or []:
            is_kept = not exercise or found[exercise].is_yours
            kept.append(source if is_kept else STAND_IN.format(id=exercise))
        if any(found[exercise].is_yours for exercise in LESSONS[lesson]):
            write_atomic(Path(out) / f"{lesson}.py", "\n\n\n".join(kept) + "\n")
    policy = Path(notebooks) / "weights" / POLICY
    if policy.exists():
        write_atomic(Path(out) / POLICY, policy.read_bytes())
    write_atomic(Path(out) / SUMMARY, _summary(found))
    return found


def load_parts(folder: str | Path, lessons: Sequence[str] = tuple(LESSONS)) -> dict[str, Callable]:
    """The student's functions that an export holds and that pass here too, by exercise.

    Args:
        folder: made by `export_parts`.
        lessons: to look into; every function of theirs is checked, which takes ten seconds for all of them.

    Raises:
        UnusableInput: the folder is no export, or nothing that it holds passes in these lessons or could in others.
    """
    if not (Path(folder) / SUMMARY).exists():
        raise UnusableInput(f"{folder}: no {SUMMARY}; make the folder by `python kit.py status --export FOLDER`")
    summary = _read_summary(Path(folder) / SUMMARY)
    found: dict[str, Callable] = {}
    for lesson in lessons:
        path = Path(folder) / f"{lesson}.py"
        if path.exists():
            parts = lesson_parts(lesson, [("", path.read_text(encoding="utf-8"))])
            found |= {name: one.function for name, one in parts.items() if one.is_yours and name in summary}
    if not found and summary <= {exercise for lesson in lessons for exercise in LESSONS[lesson]}:
        raise UnusableInput(f"{folder}: none of its parts passes its check")
    return found


def _read_summary(path: Path) -> set[str]:
    """Exercises whose function an export says to be the student's."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        return {name for name, row in rows.items() if row["is_yours"]}
    except (ValueError, AttributeError, TypeError, KeyError):
        raise UnusableInput(f"{path}: not what an export writes; make the folder again") from None


def fingerprint_of(folder: str | Path) -> str:
    """One hash of the functions in an export, so that rows of other parts are never taken for these."""
    content = [path.read_text(encoding="utf-8") for path in sorted(Path(folder).glob("*.py"))]
    return sha256("\n".join(content))


def arms_with_parts(folder: str | Path, arms: Sequence[str] = ()) -> list[str]:
    """Arm ids that drive in worlds with the student's parts: of some arms, else of the student's policy.

    The policy is `ppo_actor.onnx` of the folder (lesson 11); where there is none, the shipped one.

    Args:
        folder: made by `export_parts`, or the notebooks themselves: what passes now is exported to `parts` beside them.
        arms: ids.
    """
    folder = Path(folder).resolve()
    if has_lessons(folder):
        export_parts(folder, folder / "parts")
        folder = folder / "parts"
    load_parts(folder)  # a folder that is none ends here, not in a notebook
    policy = folder / POLICY
    return [f"{arm}{PARTS_MARK}{folder}" for arm in arms or [str(policy) if policy.exists() else "ppo"]]
