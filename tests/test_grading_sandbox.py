"""What holds around a sandbox: it ends with its grader, has a core of its own, and hides every copy of the kit."""

import collections
import contextlib
import errno
import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from dualnav_lite.config import UnusableInput
from grading import cluster, shown, watchdog
from grading.attacks.graded import LESSON, attacked_rubric
from grading.cores import on_a_core, take_core
from grading.grade import grade_class
from grading.intake import Submission
from grading.job import Job, Limits
from grading.lesson import Outcome, _Run, grade_lesson
from grading.masking import tainted_kernels
from grading.plain import remove
from grading.room import NOTEBOOKS, PACKAGE, prepared
from grading.rubric import load_rubric
from grading.sandbox import Sandbox
from grading.secret import Secret
from grading.store import locked, read_result
from tests.test_attacks import works

ROOT = Path(__file__).resolve().parents[1]
# Inside: a process that is never the same for long, beside the one that is asked.
RESTLESS = b"""
import os, sys, time
if os.fork() == 0:
    while True:
        if os.fork():
            os._exit(0)
        try:
            os.setsid()
        except OSError:
            pass
        time.sleep(0.001)
"""
SERVING = b"""
import os, sys
sys.path.insert(0, os.environ["GRADING_FOLDER"])
import serve
serve.run({}, serve.greet(os.environ["GRADING_SOCKET"]))
"""
GRADER = f"""
import sys, time
from grading.intake import Submission
from grading.job import Job
from grading.sandbox import Sandbox
sandbox = Sandbox(Job(brought={{"restless.py": {RESTLESS + SERVING!r}}}, program="restless.py"), sys.argv[1])
sandbox.accept(60, 1 << 20)
print(sandbox._first, sandbox.folder, flush=True)
time.sleep(1000)
"""


@pytest.mark.parametrize("tier", ["A", "B"])
def test_a_grader_that_is_killed_leaves_no_process(tier, tmp_path):
    works(tier)
    variables = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    grader = subprocess.Popen([sys.executable, "-c", GRADER, tier], stdout=subprocess.PIPE, text=True, env=variables)
    first = int(grader.stdout.readline().split()[0])
    assert watchdog.members(first, 0)
    grader.kill()
    grader.wait()
    grader.stdout.close()
    deadline = time.monotonic() + 60
    while watchdog.members(first, 0) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert watchdog.members(first, 0) == []


@pytest.mark.parametrize("tier", ["A", "B"])
def test_where_memory_runs_out_the_kernel_ends_a_sandbox_first(tier):
    works(tier)
    with Sandbox(Job(brought={"run.py": SERVING}, program="run.py"), tier) as sandbox:
        sandbox.accept(60, 1 << 20)
        members = watchdog.members(sandbox._first, 0)
        marks = {Path(f"/proc/{pid}/oom_score_adj").read_text(encoding="utf-8").strip() for pid in members}
    assert members
    assert marks == {"1000"}


def test_each_sandbox_has_a_core_of_its_own():
    before = os.sched_getaffinity(0)
    slots = [take_core() for _ in range(len(before) + 1)]  # one more than there are: at least one may run anywhere
    taken = [core for slot, core in slots if slot]
    assert len(set(taken)) == len(taken) <= len(before)
    assert (None, -1) in slots
    if taken:
        with on_a_core(slots[0][0], taken[0]):
            assert os.sched_getaffinity(0) == {taken[0]}
    assert os.sched_getaffinity(0) == before
    for slot, _ in slots:
        if slot:
            slot.close()


def test_nobody_inside_leaves_his_core():
    works("A")
    source = b"""
import os, sys
sys.path.insert(0, os.environ["GRADING_FOLDER"])
import socket, numpy, wire
os.sched_setaffinity(0, range(os.cpu_count()))
client = socket.socket(socket.AF_UNIX)
client.connect(os.environ["GRADING_SOCKET"])
wire.Connection(client).send(wire.pack("hello", 0, "", {"cores": numpy.array(sorted(os.sched_getaffinity(0)))}))
"""
    with Sandbox(Job(brought={"run.py": source}, program="run.py"), "A") as sandbox:
        _, arrays = sandbox.accept(60, 1 << 20)
        expected = [sandbox._core] if sandbox._slot else sorted(os.sched_getaffinity(0))
    assert arrays["cores"].tolist() == expected


@pytest.mark.parametrize("tier", ["A", "B"])
def test_an_environment_behind_links_grades_as_well(tier, tmp_path, monkeypatch):
    works(tier)
    (tmp_path / "between").symlink_to(sys.prefix)
    link = tmp_path / ".venv"
    link.symlink_to("between")
    monkeypatch.setattr(sys, "executable", str(link / Path(sys.executable).relative_to(sys.prefix)))
    monkeypatch.setattr(sys, "prefix", str(link))
    source = SERVING.replace(b"import os, sys", b"import os, sys, numpy")
    with Sandbox(Job(brought={"run.py": source}, program="run.py"), tier) as sandbox:
        sandbox.accept(60, 1 << 20)


def test_installed_copies_of_the_kit_are_hidden_and_nothing_of_the_graders_is_shown(tmp_path, monkeypatch):
    within = Path("lib") / "python3.11" / "site-packages" / "dualnav_lite"
    installed = [tmp_path / within, tmp_path / "envs" / "other" / within]  # the second as conda has them
    for path in installed:
        path.mkdir(parents=True)
    monkeypatch.setattr(shown, "system_folders", lambda: [str(tmp_path)])
    assert {str(path) for path in installed} <= set(shown.hidden_copies())
    with pytest.raises(UnusableInput, match="submissions can read"):
        shown.refuse_shown(tmp_path / "key")
    monkeypatch.undo()
    (tmp_path / "link").symlink_to(tmp_path / "envs" / "other")
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "link"))
    assert str(installed[1]) in shown.hidden_copies()  # where it is mounted: a link leads there
    assert {str(tmp_path / "link"), str(tmp_path / "envs" / "other")} <= set(shown.system_folders())
    monkeypatch.undo()
    shown.refuse_shown(tmp_path, PACKAGE.parent)


def test_compiled_kernels_that_hold_what_is_asked_stay_outside(tmp_path):
    (tmp_path / "kernels").mkdir()
    texts = {
        "grid": "",
        "paths": "from dualnav_lite.kernels.grid import cell",
        "routes": "from . import paths",
        "hash": "",
    }
    for name, text in (texts | {"hash": ""}).items():
        (tmp_path / "kernels" / f"{name}.py").write_text(text, encoding="utf-8")
    assert tainted_kernels(tmp_path, ["rewards:hinge", "kernels.grid:cell"]) == {"grid", "paths", "routes"}
    assert tainted_kernels(PACKAGE, ["rewards:hinge", "rollout:gae"]) == set()
    assert tainted_kernels(PACKAGE, load_rubric().mask()) == {"encode"}
    with prepared(load_rubric(), Secret(b"k" * 32, "kernels"), "A", Limits()) as room:
        shown_ones = {path.name.partition(".")[0] for path in room.kernels.iterdir()} if room.kernels else set()
    assert "encode" not in shown_ones


def test_folders_however_deep_are_counted_or_told_and_taken_away(tmp_path):
    """Deeper than a path may be long, where Python's own functions give up or recurse too far."""
    top = tmp_path / "top"
    top.mkdir()
    (top / "file").write_bytes(b"x" * 100_000)
    assert watchdog.files_below(top)[0] >= 100_000
    here = os.open(top, os.O_RDONLY)
    for _ in range(1_200):
        os.mkdir("d" * 20, 0o700, dir_fd=here)
        deeper = os.open("d" * 20, os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = deeper
    os.close(here)
    with pytest.raises(watchdog.Hidden):
        watchdog.files_below(top)
    remove(top)
    assert not top.exists()


def test_a_watchdog_that_cannot_see_kills():
    killed: list[bool] = []
    guard = watchdog.Watchdog(os.getpid(), None, lambda: killed.append(True), None, 0)  # without limits it fails
    guard.start()
    guard.join(30)
    assert killed == [True]
    assert guard.reason == "unseen"


def test_two_graders_in_one_folder_are_one_too_many(tmp_path):
    with locked(tmp_path), pytest.raises(UnusableInput, match="another grader"), locked(tmp_path):
        pass


def test_a_disk_that_knows_no_locks_is_not_taken_for_another_grader(tmp_path, monkeypatch):
    def refused(file, how):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refused)
    with pytest.raises(UnusableInput, match="cannot be locked: No locks available"), locked(tmp_path):
        pass


@pytest.mark.slow
def test_a_submission_that_kills_the_grader_is_tried_last_and_costs_nobody_else(tmp_path, monkeypatch):
    works("A")
    notes = tmp_path / "tried"

    def killed_by(room, submission):
        with open(notes, "a", encoding="utf-8") as file:
            file.write(submission.student_id + "\n")
        if submission.student_id == "killer":
            os.kill(os.getpid(), signal.SIGKILL)
        return grade_one(room, submission)

    from grading import submission as graded

    grade_one = graded.grade_one
    monkeypatch.setattr(graded, "grade_one", killed_by)
    master = (NOTEBOOKS / f"{LESSON}.ipynb").read_bytes()
    for name in ("before", "killer", "later"):
        (tmp_path / "class" / name).mkdir(parents=True)
        (tmp_path / "class" / name / f"{LESSON}.ipynb").write_bytes(master)
    with prepared(attacked_rubric(), Secret(b"k" * 32, "killer"), "A", Limits()) as room:
        rows, lost = grade_class(tmp_path / "class", tmp_path / "out", room, say=lambda text: None)
    tried = notes.read_text(encoding="utf-8").split()
    assert tried == ["before", "killer", "later", "killer"]
    assert lost == 1
    status = {(row["student_id"], row["exercise"]): row["status"] for row in rows}
    assert status["before", "goal"] == status["later", "goal"] == "passed"
    assert status["killer", "goal"] == "ungraded"


def test_a_worker_grades_a_few_and_then_a_fresh_one_goes_on(tmp_path, monkeypatch):
    from grading import crew

    def graded(room, submission):
        return {"student_id": submission.student_id, "worker": os.getpid()}, {"student_id": submission.student_id}

    monkeypatch.setattr(crew, "grade_timed", graded)
    monkeypatch.setattr(crew, "MOST_A_WORKER", 2)
    todo = [(Submission(f"s{k}", ""), tmp_path / "results" / f"s{k}.json") for k in range(7)]
    assert crew.run_workers(None, todo, 2, lambda text: None) == 0
    workers = collections.Counter(read_result(path)["worker"] for _, path in todo)
    assert sum(workers.values()) == 7
    assert max(workers.values()) <= 2


def test_a_full_disk_stops_all_workers_with_one_line(tmp_path, monkeypatch):
    from grading import crew

    def full(path, result, times):
        raise UnusableInput("s0.json: cannot be written: No space left on device")

    monkeypatch.setattr(crew, "grade_timed", lambda room, submission: ({}, {}))
    monkeypatch.setattr(crew, "write_result", full)
    todo = [(Submission(f"s{k}", ""), tmp_path / "results" / f"s{k}.json") for k in range(7)]
    with pytest.raises(UnusableInput, match="No space left"):
        crew.run_workers(None, todo, 2, lambda text: None)
    assert len(list((tmp_path / "results").glob("*.attempt"))) <= 2


def test_a_kernel_that_does_not_start_in_time_is_nobodys_zero():
    works("A")
    limits = Limits(start_s=0.05)
    with prepared(attacked_rubric(), Secret(b"k" * 32, "late"), "A", limits) as room:
        setting = room.setting(LESSON)
        outcomes, _ = grade_lesson(setting, setting.master.solutions)
    assert {(one.status, one.reason) for one in outcomes.values()} == {("ungraded", "sandbox_failed")}


def test_a_submission_that_the_grader_cannot_follow_ends_nobody_elses_grading_on_a_cluster(monkeypatch):
    def raises(room, submission):
        raise ValueError(submission.student_id)

    monkeypatch.setattr(cluster, "_room", lambda *given: None)
    monkeypatch.setattr(cluster, "grade_timed", raises)
    task = (Submission("anna", ""), Path("anna.json"))
    assert cluster.grade_there(None, None, "A", None, "", task) == (task[1], None, "grading raised ValueError")


def test_a_part_that_ends_the_sandbox_is_tried_once_more_also_where_it_is_the_only_one(monkeypatch):
    endings = [Outcome(0.0, "timeout", "took_too_long"), Outcome(1.0, "passed")]
    session = contextlib.nullcontext(object())
    monkeypatch.setattr(_Run, "_session", lambda self, cells, lent=(): session)
    monkeypatch.setattr(_Run, "_ask", lambda self, *given: (one := endings.pop(0), one.status != "passed"))
    lesson = load_rubric().lessons["09_rollout_and_gae"]
    run = _Run(SimpleNamespace(lesson=lesson), {"gae": ""}, outcomes := {})
    run.together()
    assert outcomes == {}
    run.one_by_one()
    assert outcomes["gae"].status == "passed"
