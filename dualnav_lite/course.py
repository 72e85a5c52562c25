"""The course as students get it: notebooks with stubs, and the library whole."""

import shutil
import tempfile
from pathlib import Path

from dualnav_lite.config import ROOT, UnusableInput, write_atomic
from dualnav_lite.exercises import student_notebook

# What a release holds beside the notebooks; sources of the notebooks, tests and grading stay with the teacher.
KEPT = (
    "dualnav_lite", "stress_tests", "training", "models", "data", "docs", "kit.py", "requirements.txt",
    "requirements-bench.txt", "pyproject.toml", "README.md", "README.zh-CN.md", "CHANGELOG.md", "LICENSE",
)  # fmt: skip
LEFT_OUT = ("__pycache__", "*.nbi", "*.nbc", "results", ".ipynb_checkpoints", "config.yaml")
PAGES = ("GLOSSARY.md",)  # of notebooks/, for students as well


def write_lessons(out: str | Path, root: Path = ROOT) -> list[Path]:
    """The student's version of every lesson in a folder; a lesson that is there already is left as it is.

    Returns:
        The notebooks that were written.

    Raises:
        UnusableInput: the kit holds no notebooks, or `out` refuses.
    """
    lessons = sorted((root / "notebooks").glob("[0-9][0-9]_*.ipynb"))
    if not lessons:
        raise UnusableInput(f"{root / 'notebooks'}: holds no lessons")
    written = []
    for lesson in lessons:
        target = Path(out) / lesson.name
        if not target.exists():
            write_atomic(target, student_notebook(lesson.read_text(encoding="utf-8")))
            written.append(target)
    for page in PAGES:
        if (root / "notebooks" / page).exists():
            write_atomic(Path(out) / page, (root / "notebooks" / page).read_bytes())
    return written


def release(out: str | Path, root: Path = ROOT) -> Path:
    """The kit as a student gets it, whole or not at all.

    Args:
        out: a folder that does not exist yet, or is empty.

    Raises:
        UnusableInput: the folder holds something, lies inside what is copied, or refuses.
    """
    out = Path(out).resolve()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UnusableInput(f"{out}: is there already; name a new folder")
    if any(out.is_relative_to(root / name) for name in KEPT):
        raise UnusableInput(f"{out}: lies inside what is copied; name a folder elsewhere")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
            made = Path(folder) / out.name
            for name in KEPT:
                source = root / name
                if source.is_dir():
                    shutil.copytree(source, made / name, ignore=shutil.ignore_patterns(*LEFT_OUT))
                elif source.exists():
                    made.mkdir(exist_ok=True)
                    shutil.copy2(source, made / name)
            write_lessons(made / "notebooks", root)
            if out.exists():
                out.rmdir()
            made.rename(out)
    except OSError as error:
        raise UnusableInput(f"{out}: cannot be written: {error.strerror or error}") from None
    return out
