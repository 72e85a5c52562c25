"""A student's own check and pack: public checks, some runs of the scenarios, the folder that `grade` takes."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from dualnav_lite import __version__
from dualnav_lite.check import LESSONS
from dualnav_lite.check.verdict import LANGUAGES, Text, language_of
from dualnav_lite.chunks import sha256
from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.evaluate import evaluate
from dualnav_lite.metrics import repeat_range
from dualnav_lite.parts import POLICY, arms_with_parts, export_parts
from dualnav_lite.survival import survival

SCHEMA = 1
STUDENT = re.compile(r"[A-Za-z0-9._-]{1,64}")
SCENARIOS = ("navigation", "pop_up", "crowd_crossing", "low_light", "comms_dropout")
FIRST_SEED = 1_060_000  # tuning seeds that no lesson uses
WEIGHTS = (".onnx", ".pth")
PASS = Text("{lesson}: {passed} of {n} exercises pass{rest}", "{lesson}：{n} 个练习中 {passed} 个通过{rest}")
REST = Text("; not yet: {ids}", "；尚未通过：{ids}")
NO_WEIGHTS = Text(
    f"no weights/{POLICY}: lesson 11 makes one; the scenarios are left out",
    f"没有 weights/{POLICY}：第 11 课会生成它；跳过场景测试",
)
DRIVES = Text(
    "your policy drives: {n} runs of each of {scenarios} scenarios, in rooms that no lesson uses",
    "你的策略开始跑：{scenarios} 个场景，每个 {n} 次，房间是各课都没有用过的",
)
SURVIVED = Text("{scenario}: survived {survived} of {n}", "{scenario}：{n} 次中存活 {survived} 次")
RANGE = Text(
    "  of {n} runs in other rooms expect {least} to {most}; the true rate is within {low:.0%} to {high:.0%} (95 %)",
    "  换一批房间再跑 {n} 次，预计存活 {least} 到 {most} 次；真实存活率在 {low:.0%} 到 {high:.0%} 之间（95 %）",
)
MEANS = Text(
    "  on average {clearance:.2f} m least clearance and {energy:.0f} J",
    "  平均最小间隙 {clearance:.2f} m，平均能耗 {energy:.0f} J",
)
LIBRARY = Text(
    "none of your functions passes yet: the library's drive with it",
    "你的函数还没有一个通过：改用库里的函数一起跑",
)
HAND_IN = Text("hand in this folder: {folder}", "请提交这个文件夹：{folder}")


def pack(
    notebooks: str | Path, student: str, out: str | Path, say: Callable[[str], None] = print, lang: str | None = None
) -> Path:
    """Write the submission folder from a folder with the lessons.

    The manifest repeats what stands beside it (`schema`, `student_id`, `kit_version`, `files` with their SHA-256,
    `checks` by exercise). It is a claim: grading trusts none of it and takes code from solution cells alone.

    Args:
        notebooks: folder with `NN_*.ipynb`, and `weights/` where lesson 11 was run.
        student: id, of letters, digits, dot, - and _.
        out: folder that does not exist yet, or holds an earlier submission.
        say: where lines for people go.
        lang: as in `check`.

    Returns:
        The folder.

    Raises:
        UnusableInput: an id that is none, no lesson, an `out` that holds something else.
    """
    notebooks, out, k = Path(notebooks), Path(out), LANGUAGES.index(language_of(lang, notebooks))
    if not STUDENT.fullmatch(student):
        raise UnusableInput(f"a student id is 1 to 64 letters, digits, '.', '-' or '_', got '{student}'")
    if out.exists() and any(out.iterdir()) and not (out / "manifest.json").exists():
        raise UnusableInput(f"{out}: holds something that is no submission; name another folder")
    lessons = [path for path in sorted(notebooks.glob("[0-9][0-9]_*.ipynb")) if path.stem in LESSONS]
    parts = export_parts(notebooks, out.with_name(out.name + "_parts"))
    for lesson in LESSONS:
        ids = [one for one in parts.values() if one.lesson == lesson]
        missing = ", ".join(one.exercise for one in ids if not one.is_yours)
        rest, passed = REST[k].format(ids=missing) if missing else "", sum(one.is_yours for one in ids)
        say(PASS[k].format(lesson=lesson, passed=passed, n=len(ids), rest=rest))
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


def try_out(
    notebooks: str | Path,
    out: str | Path,
    episodes: int,
    say: Callable[[str], None] = print,
    *,
    jobs: int = 1,
    lang: str | None = None,
    scenarios: Sequence[str] = SCENARIOS,
) -> None:
    """Drive the student's policy through the scenarios and say how many of as many runs to expect in other rooms.

    Without weights there is nothing to drive, and it says so.

    Args:
        notebooks, out, say, lang: as in `pack`, which has run before.
        episodes: of each scenario.
        jobs: worker processes.
        scenarios: ids.
    """
    k = LANGUAGES.index(language_of(lang, notebooks))
    if not (Path(notebooks) / "weights" / POLICY).exists():
        say(NO_WEIGHTS[k])
        return
    folder = Path(out).with_name(Path(out).name + "_parts")
    if any(folder.glob("*.py")):
        arms = arms_with_parts(folder)
    else:
        say(LIBRARY[k])
        arms = [str((Path(notebooks) / "weights" / POLICY).resolve())]
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    say(DRIVES[k].format(n=episodes, scenarios=len(scenarios)))
    table = survival(evaluate(arms, list(scenarios), seeds, folder / "results", jobs=jobs))
    for row in table.set_index("scenario").loc[list(scenarios)].itertuples():
        least, most = repeat_range(row.survived, row.episodes, row.episodes)
        say(SURVIVED[k].format(scenario=row.Index, survived=row.survived, n=row.episodes))
        say(RANGE[k].format(n=row.episodes, least=least, most=most, low=row.wilson_low, high=row.wilson_high))
        say(MEANS[k].format(clearance=row.mean_min_clearance_m, energy=row.mean_energy_j))
