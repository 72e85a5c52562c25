"""A class of submissions to tables: sandboxed, resumable, one result file a submission.

A result file is written whole, by temporary file, fsync and rename, and named by everything that it depends on. Killed
at any moment and started again, nothing is lost and nothing is graded twice.
"""

import contextlib
import ctypes
import fcntl
import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from multiprocessing.connection import wait
from pathlib import Path

import dualnav_lite
from dualnav_lite.config import UnusableInput
from dualnav_lite.evaluate import code_sha256
from dualnav_lite.exercises import stub
from grading import __version__
from grading.intake import Submission, take_in
from grading.lesson import Outcome, Setting, grade_lesson
from grading.masking import masked_copy
from grading.probe import leaks, probe
from grading.rebuild import Master, Unreadable, normalised, read_master, solution_cells
from grading.rubric import Rubric
from grading.sandbox import PREFIX, Limits, SandboxError, kernel_cache
from grading.secret import Secret
from grading.tables import COLUMNS, rows_of, to_csv

PACKAGE = Path(dualnav_lite.__file__).resolve().parent
NOTEBOOKS = PACKAGE.parent / "notebooks"
PARENT_DEATH = 1  # PR_SET_PDEATHSIG


@dataclass
class Class:
    """Everything that grading a class depends on."""

    rubric: Rubric
    secret: Secret
    tier: str
    limits: Limits
    packages: Path
    masters: dict[str, Master]

    def fingerprint(self) -> str:
        """Hash of all that a result depends on besides the submission."""
        here = Path(__file__).parent
        code = [path.read_bytes() for path in sorted(here.rglob("*.py"))]
        parts = [
            *code,
            code_sha256().encode(),
            self.rubric.model_dump_json().encode(),
            self.secret.fingerprint.encode(),
            self.tier.encode(),
            json.dumps(asdict(self.limits)).encode(),
            repr(self.masters).encode(),
        ]
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()

    def wanted(self) -> frozenset[str]:
        """Names of the files that a submission may hold."""
        return frozenset(f"{name}.ipynb" for name in self.rubric.lessons) | {"manifest.json"}

    def setting(self, lesson: str) -> Setting:
        """What a lesson is graded with."""
        kernels = kernel_cache(PACKAGE)
        rules = self.rubric.lessons[lesson]
        return Setting(self.masters[lesson], rules, self.packages, kernels, self.secret, self.tier, self.limits)


@contextlib.contextmanager
def prepared(rubric: Rubric, secret: Secret, tier: str, limits: Limits, notebooks: Path = NOTEBOOKS):
    """A `Class` with its masked copy of the library, which is taken away afterwards.

    Raises:
        UnusableInput: a lesson's notebook is missing or lacks an exercise of the rubric.
    """
    masters = {}
    for name, lesson in rubric.lessons.items():
        try:
            masters[name] = read_master(notebooks / f"{name}.ipynb", stub)
        except (OSError, Unreadable):
            raise UnusableInput(
                f"the rubric names lesson '{name}', but notebooks/{name}.ipynb cannot be read"
            ) from None
        missing = sorted(set(lesson.exercises) - set(masters[name].solutions))
        if missing:
            raise UnusableInput(f"the rubric names exercise '{missing[0]}', which {name}.ipynb does not hold")
    mask = {symbol: exercise for lesson in rubric.lessons.values() for symbol, exercise in lesson.mask.items()}
    folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}-"))
    try:
        packages = masked_copy(PACKAGE, mask, folder / "packages")
        yield Class(rubric, secret, tier, limits, packages, masters)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_whole(path: Path, content: bytes) -> None:
    """A file that is there whole or not at all, also after a loss of power."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def grade_one(room: Class, submission: Submission) -> dict:
    """The content of a submission's result file, but for times."""
    outcomes: dict[str, Outcome] = {}
    prints: dict[str, str] = {}
    library: dict[str, str] = {}
    for name, lesson in room.rubric.lessons.items():
        sources: dict[str, str] = {}
        problem = submission.rejected
        content = submission.files.get(f"{name}.ipynb")
        if not problem:
            try:
                sources = solution_cells(content, tuple(lesson.exercises)) if content is not None else {}
                problem = "" if content is not None else "no_notebook"
            except Unreadable as error:
                problem = str(error)
        if problem:
            outcomes |= {exercise: Outcome(0.0, "not_run", problem) for exercise in lesson.exercises}
            continue
        found, _ = grade_lesson(room.setting(name), sources)
        outcomes |= found
        for exercise, source in sources.items():
            if found[exercise].reason not in ("not_done", "cell_missing") and not source.startswith("\0"):
                prints[exercise] = _print(source)
                library[exercise] = _print(room.masters[name].solutions[exercise])
    return {
        "assignment": room.rubric.assignment,
        "student_id": submission.student_id,
        "folder": submission.folder,
        "submission_sha256": submission.sha256,
        "outcomes": {exercise: asdict(outcome) for exercise, outcome in outcomes.items()},
        "prints": prints,
        "library_prints": library,
        "tier": room.tier,
        "grader_version": __version__,
    }


def _print(source: str) -> str:
    return hashlib.sha256(normalised(source).encode("utf-8", "replace")).hexdigest()[:16]


def self_check(room: Class) -> None:
    """Before anybody is graded: the sandbox denies what it must, the reference gets everything, the stubs nothing.

    Raises:
        UnusableInput: one of them does not hold.
    """
    if room.tier != "UNSANDBOXED":
        try:
            open_doors = leaks(room.tier, probe(room.tier))
        except SandboxError as error:
            raise UnusableInput(f"nothing is graded: {error}") from None
        if open_doors:
            raise UnusableInput(f"nothing is graded: the sandbox lets through {', '.join(open_doors)}")
    for name in room.rubric.lessons:
        setting = room.setting(name)
        for exercise, outcome in grade_lesson(setting, setting.master.solutions)[0].items():
            if outcome.status != "passed":
                raise UnusableInput(f"nothing is graded: the reference of '{exercise}' gets {outcome.reason}")
        for exercise, outcome in grade_lesson(setting, setting.master.stubs)[0].items():
            if outcome.share:
                raise UnusableInput(f"nothing is graded: the untouched stub of '{exercise}' gets points")


def result_path(out: Path, fingerprint: str, submission: Submission) -> Path:
    """Where a submission's result stands; the name tells nobody's name."""
    student = hashlib.sha256(submission.student_id.encode("utf-8")).hexdigest()[:16]
    made_of = f"{fingerprint}\0{submission.sha256}\0{submission.rejected}"
    return out / "results" / f"{student}.{hashlib.sha256(made_of.encode()).hexdigest()[:24]}.json"


def read_result(path: Path) -> dict | None:
    """A result file; None where there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


@contextlib.contextmanager
def locked(out: Path):
    """The only grader in a folder.

    Raises:
        UnusableInput: another one works there.
    """
    out.mkdir(parents=True, exist_ok=True)
    with open(out / ".lock", "w", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UnusableInput(f"{out}: another grader works in this folder") from None
        yield


def sweep() -> None:
    """Take away the folders that graders left behind when they were killed."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*-*"):
        owner = path.name.removeprefix(PREFIX).split("-")[0]
        with contextlib.suppress(OSError):
            if owner.isdigit() and not os.path.exists(f"/proc/{owner}") and path.stat().st_uid == os.geteuid():
                shutil.rmtree(path, ignore_errors=True)


def _work(pipe, room: Class, parent: int) -> None:
    """A worker process: grades what it is sent, one at a time; ends with its parent."""
    ctypes.CDLL(None).prctl(PARENT_DEATH, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent gets it too and ends us
    while (task := pipe.recv()) is not None:
        submission, path = task
        start = time.time()
        result = grade_one(room, submission)
        if any(outcome["status"] == "ungraded" for outcome in result["outcomes"].values()):
            pipe.send("ungraded")  # nothing is kept, so the next run tries again
            continue
        times = {"student_id": submission.student_id, "started": round(start), "seconds": round(time.time() - start, 1)}
        write_whole(path.with_suffix(".times"), json.dumps(times).encode("utf-8"))
        write_whole(path, json.dumps(result, ensure_ascii=False, indent=1, sort_keys=True).encode("utf-8"))
        pipe.send("done")


def _run_workers(room: Class, todo: list[tuple[Submission, Path]], jobs: int, say) -> int:
    """Grade a list with some workers; how many stayed ungraded. A worker that dies costs its submission one retry."""
    context = multiprocessing.get_context("fork")
    waiting, again, lost, done = list(todo), [], 0, 0
    busy: dict = {}
    idle: list = []

    def hire():
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, room, os.getpid()), daemon=True)
        process.start()
        theirs.close()
        return ours, process

    try:
        while waiting or busy or again:
            if not waiting and not busy:
                waiting, again = again, []
            while waiting and len(busy) < jobs:
                pipe, process = idle.pop() if idle else hire()
                task = waiting.pop(0)
                mark = task[1].with_suffix(".attempt")
                second = mark.exists()
                write_whole(mark, b"")
                pipe.send(task)
                busy[pipe] = process, task, second
            for pipe in wait(list(busy)):
                process, task, second = busy.pop(pipe)
                try:
                    answer = pipe.recv()
                    idle.append((pipe, process))
                except EOFError:
                    process.join()
                    answer = "died"
                if answer == "died" and not second:
                    again.append(task)
                    continue
                done += answer == "done"
                lost += answer != "done"
                if answer == "done":
                    task[1].with_suffix(".attempt").unlink(missing_ok=True)
                say(f"{done + lost} of {len(todo)} submissions")
    finally:
        for pipe, process in [*idle, *((pipe, one[0]) for pipe, one in busy.items())]:
            process.kill()
            process.join()
            pipe.close()
    return lost


def grade_class(
    folder: Path,
    out: Path,
    room: Class,
    *,
    jobs: int = 1,
    shard: tuple[int, int] = (1, 1),
    only: str = "",
    overrides: dict | None = None,
    late: dict[str, float] | None = None,
    say=lambda text: print(text, file=sys.stderr),
) -> tuple[list[dict], int]:
    """Rows of the table, which is written too, and how many submissions stayed ungraded.

    Args:
        folder: submissions.
        out: folder of results and tables.
        room: what to grade with, from `prepared`.
        jobs: worker processes; shard: (k, n) takes every n-th submission from the k-th.
        only: grade this student anew, whatever is there; the others as they are.

    Raises:
        UnusableInput: nothing can be graded.
    """
    sweep()
    submissions = take_in(folder, room.wanted())[shard[0] - 1 :: shard[1]]
    if only and only not in {one.student_id for one in submissions}:
        raise UnusableInput("--only names a student who is not in the folder")
    fingerprint = room.fingerprint()
    paths = {one.student_id: result_path(out, fingerprint, one) for one in submissions}
    with locked(out):
        for leftover in (out / "results").glob(".*.tmp"):
            leftover.unlink()
        if only:
            paths[only].unlink(missing_ok=True)
        todo = [(one, paths[one.student_id]) for one in submissions if read_result(paths[one.student_id]) is None]
        todo.sort(key=lambda task: task[1].with_suffix(".attempt").exists())  # in flight when we were killed: last
        if todo:
            self_check(room)
        lost = _run_workers(room, todo, jobs, say) if todo else 0
        results = [_result_or_ungraded(room, one, paths[one.student_id]) for one in submissions]
        rows = write_tables(out, results, room.rubric, overrides or {}, late or {}, room.tier)
        made_of = {
            "fingerprint": fingerprint,
            "tier": room.tier,
            "results": sorted(path.name for path in paths.values()),
        }
        write_whole(out / "run.json", json.dumps(made_of, indent=1).encode("utf-8"))
    return rows, lost


def _result_or_ungraded(room: Class, submission: Submission, path: Path) -> dict:
    """A submission's result; where there is none, a row that says so and no points."""
    found = read_result(path)
    if found is not None:
        return found
    nothing = asdict(Outcome(0.0, "ungraded", "sandbox_failed"))
    return {
        "assignment": room.rubric.assignment,
        "student_id": submission.student_id,
        "folder": submission.folder,
        "submission_sha256": submission.sha256,
        "outcomes": dict.fromkeys(room.rubric.points(), nothing),
        "prints": {},
        "library_prints": {},
        "tier": room.tier,
        "grader_version": __version__,
    }


def write_tables(out: Path, results: list[dict], rubric: Rubric, overrides, late, tier: str) -> list[dict]:
    """`grades.csv` (with UNSANDBOXED in its name where nothing protected us) and `grade_times.csv`."""
    rows = rows_of(results, rubric, overrides, late)
    name = "grades.UNSANDBOXED.csv" if tier == "UNSANDBOXED" else "grades.csv"
    write_whole(out / name, to_csv(COLUMNS, rows))
    times = [found for path in sorted((out / "results").glob("*.times")) if (found := read_result(path))]
    times.sort(key=lambda one: (one["student_id"], one["started"]))
    write_whole(out / "grade_times.csv", to_csv(("student_id", "started", "seconds"), times))
    return rows


def merge(folders: list[Path], out: Path, rubric: Rubric, overrides, late) -> list[dict]:
    """Tables of shards that were graded apart, as if they had been graded together.

    Raises:
        UnusableInput: a folder holds no finished run, or the runs were not made with the same grader, key and tier.
    """
    runs = [read_result(folder / "run.json") for folder in folders]
    if not runs or None in runs:
        raise UnusableInput("merge: a folder holds no finished run (run.json)")
    if len({run["fingerprint"] for run in runs}) > 1:
        raise UnusableInput("merge: the shards were graded with different graders, rubrics, keys or tiers")
    results = []
    with locked(out):
        for folder, run in zip(folders, runs, strict=True):
            for name in run["results"]:
                found = read_result(folder / "results" / name)
                if found is None:
                    raise UnusableInput(f"merge: {folder} has a submission that stayed ungraded; run it again")
                results.append(found)
        return write_tables(out, results, rubric, overrides, late, runs[0]["tier"])
