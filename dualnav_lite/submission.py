"""A student's own check and pack: public checks, a short run of the scenarios, the folder that `grade` takes."""

import json
import re
from collections.abc import Callable
from pathlib import Path

from dualnav_lite import __version__
from dualnav_lite.check import LESSONS
from dualnav_lite.chunks import sha256
from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.evaluate import evaluate
from dualnav_lite.parts import POLICY, arms_with_parts, export_parts
from dualnav_lite.survival import survival

SCHEMA = 1
STUDENT = re.compile(r"[A-Za-z0-9._-]{1,64}")
SCENARIOS = ("navigation", "pop_up", "crowd_crossing", "low_light", "comms_dropout")
FIRST_SEED = 1_060_000  # tuning seeds that no lesson uses
WEIGHTS = (".onnx", ".pth")


def pack(notebooks: str | Path, student: str, out: str | Path, say: Callable[[str], None] = print) -> Path:
    """Write the submission folder from a folder with the lessons.

    The manifest repeats what stands beside it (`schema`, `student_id`, `kit_version`, `files` with their SHA-256,
    `checks` by exercise). It is a claim: grading trusts none of it and takes code from solution cells alone.

    Args:
        notebooks: folder with `NN_*.ipynb`, and `weights/` where lesson 11 was run.
        student: id, of letters, digits, dot, - and _.
        out: folder that does not exist yet, or holds an earlier submission.
        say: where lines for people go.

    Returns:
        The folder.

    Raises:
        UnusableInput: an id that is none, no lesson, an `out` that holds something else.
    """
    notebooks, out = Path(notebooks), Path(out)
    if not STUDENT.fullmatch(student):
        raise UnusableInput(f"a student id is 1 to 64 letters, digits, '.', '-' or '_', got '{student}'")
    if out.exists() and any(out.iterdir()) and not (out / "manifest.json").exists():
        raise UnusableInput(f"{out}: holds something that is no submission; name another folder")
    lessons = [path for path in sorted(notebooks.glob("[0-9][0-9]_*.ipynb")) if path.stem in LESSONS]
    parts = export_parts(notebooks, out.with_name(out.name + "_parts"))
    for lesson in LESSONS:
        ids = [one for one in parts.values() if one.lesson == lesson]
        say(f"{lesson}: {sum(one.is_yours for one in ids)} of {len(ids)} exercises pass")
    weights = [path for path in sorted((notebooks / "weights").glob("*")) if path.suffix in WEIGHTS]
    files = {path.name: path for path in lessons} | {f"weights/{path.name}": path for path in weights}
    for old in [*out.glob("*.ipynb"), *(out / "weights").glob("*")]:
        old.unlink()
    digests = {}
    for name, path in files.items():
        content = path.read_bytes()
        write_atomic(out / name, content)
        digests[name] = sha256(content)
    checks = {name: one.state for name, one in parts.items()}
    manifest = {"schema": SCHEMA, "student_id": student, "kit_version": __version__, "files": digests, "checks": checks}
    write_atomic(out / "manifest.json", json.dumps(manifest, indent=1) + "\n")
    return out


def try_out(notebooks: str | Path, out: str | Path, episodes: int, say: Callable[[str], None] = print) -> None:
    """Drive the student's policy through the short scenarios and say what range a longer run would find.

    Without weights there is nothing to drive, and it says so.
    """
    if not (Path(notebooks) / "weights" / POLICY).exists():
        say(f"no weights/{POLICY}: lesson 11 makes one; the scenarios are left out")
        return
    folder = Path(out).with_name(Path(out).name + "_parts")
    try:
        arms = arms_with_parts(folder)
    except UnusableInput:
        arms = [str((Path(notebooks) / "weights" / POLICY).resolve())]
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    say(f"your policy drives: {episodes} runs of each of {len(SCENARIOS)} scenarios")
    table = survival(evaluate(arms, list(SCENARIOS), seeds, folder / "results"))
    for row in table.itertuples():
        say(f"{row.scenario}: survived {row.survived} of {row.episodes}")
        say(f"  a longer run finds {row.wilson_low:.0%} to {row.wilson_high:.0%} (95 %)")
        say(f"  least clearance {row.mean_min_clearance_m:.2f} m, energy {row.mean_energy_j:.0f} J, means")
