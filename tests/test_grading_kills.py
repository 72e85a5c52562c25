"""A grader that is killed at any moment and started again: nothing is lost, nothing twice, nothing left running."""

import multiprocessing
import os
import signal
import tempfile
import time
from pathlib import Path

import pytest

from grading.example.graded import example_rubric
from grading.example.policies import constant_policy
from grading.folders import PREFIX, began
from grading.grade import grade_class
from grading.job import Limits
from grading.room import NOTEBOOKS, prepared
from grading.secret import Secret
from tests.test_attacks import works

LESSON = "09_rollout_and_gae"
GIVE_UP_S = 300.0


def rubric_of(has_lesson: bool):
    """The example's, with two short drives; with or without a lesson."""
    rubric = example_rubric()
    survival = rubric.policy.survival.model_copy(update={"first": 2, "most": 2})
    policy = rubric.policy.model_copy(update={"survival": survival, "hypervolume": None})
    lessons = {LESSON: rubric.lessons[LESSON]} if has_lesson else {}
    total = survival.points + (4 if has_lesson else 0)
    return rubric.model_copy(update={"lessons": lessons, "policy": policy, "total": total})


def class_of_twelve(folder: Path) -> Path:
    """Two who drive, two whose weights are none, two notebooks, one with a link, and who handed in nothing."""
    for k in range(12):
        (folder / f"s{k:02}" / "weights").mkdir(parents=True)
        weights = folder / f"s{k:02}" / "weights" / "ppo_actor.onnx"
        if k in (0, 8):
            weights.write_bytes(constant_policy(0.5, 0.1 * k))
        elif k in (4, 11):
            weights.write_bytes(b"no network" * k)
        elif k in (2, 6):
            (folder / f"s{k:02}" / f"{LESSON}.ipynb").write_bytes((NOTEBOOKS / f"{LESSON}.ipynb").read_bytes())
        elif k == 3:
            weights.symlink_to("/etc/hostname")
    return folder


def grade(folder: Path, out: Path, temporary: Path, has_lesson: bool) -> None:
    """The class graded by this process, with its temporary folders in a place of their own."""
    tempfile.tempdir = str(temporary)
    with prepared(rubric_of(has_lesson), Secret(b"k" * 32, "killed"), "A", Limits()) as room:
        grade_class(folder, out, room, say=lambda text: None)


def started(*arguments):
    process = multiprocessing.get_context("fork").Process(target=grade, args=arguments)
    process.start()
    return process


def results(out: Path) -> dict[str, int]:
    """Result files by name, and when each was written."""
    return {path.name: path.stat().st_mtime_ns for path in (out / "results").glob("[!.]*.json")}


def below(pid: int) -> dict[int, str]:
    """A process and all below it, with when each was started."""
    parents = {}
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            try:
                fields = Path(entry.path, "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            except OSError:
                continue
            parents[int(entry.name)] = int(fields[1])
    family = {pid}
    while more := {child for child, parent in parents.items() if parent in family} - family:
        family |= more
    return {one: began(one) for one in family}


def kill_at(moment: int, delay_s: float, process, out: Path) -> None:
    """Kill a grader some time after it has written a number of results; all that it had started ends with it."""
    give_up = time.monotonic() + GIVE_UP_S
    while process.is_alive() and len(results(out)) < moment and time.monotonic() < give_up:
        time.sleep(0.005)
    time.sleep(delay_s)
    family = below(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    give_up = time.monotonic() + GIVE_UP_S
    while any(begin and began(pid) == begin for pid, begin in family.items()):
        assert time.monotonic() < give_up, "something is left running"
        time.sleep(0.02)


def tables(out: Path) -> dict[str, bytes]:
    """Bytes of all that depends on the submissions alone."""
    return {name: (out / name).read_bytes() for name in ("grades.csv", "survival.csv", "feedback.zip", "run.json")}


def killed_and_completed(tmp_path, moments, has_lesson):
    """One class graded in peace, another time killed at each moment (results, seconds later) and then completed."""
    works("A")
    folder = class_of_twelve(tmp_path / "class")
    temporary = tmp_path / "t"
    temporary.mkdir()
    peace = started(folder, tmp_path / "peace", temporary, has_lesson)
    peace.join()
    assert peace.exitcode == 0
    assert len(results(tmp_path / "peace")) == 12
    out, kept = tmp_path / "out", {}
    for moment, delay_s in moments:
        kill_at(moment, delay_s, started(folder, out, temporary, has_lesson), out)
        now = results(out)
        assert {name: now.get(name) for name in kept} == kept  # nothing is lost and nothing graded twice
        kept = now
    last = started(folder, out, temporary, has_lesson)
    last.join()
    assert last.exitcode == 0
    assert {name: results(out)[name] for name in kept} == kept
    assert tables(out) == tables(tmp_path / "peace")
    assert list(temporary.glob(f"{PREFIX}*")) == []
    assert [path.name for path in (out / "results").iterdir() if path.suffix not in (".json", ".times")] == []


def test_a_grader_killed_at_three_moments_loses_nothing(tmp_path):
    killed_and_completed(tmp_path, [(0, 0.3), (4, 0.1), (8, 0.3)], has_lesson=False)


@pytest.mark.slow
def test_a_grader_killed_at_thirty_moments_loses_nothing(tmp_path):
    for run in range(3):
        (tmp_path / str(run)).mkdir()
        moments = [(k, 0.13 * ((7 * k + 3 * run) % 10)) for k in range(10)]
        killed_and_completed(tmp_path / str(run), moments, has_lesson=True)
