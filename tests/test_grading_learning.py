"""The learning task: the scorer's loop tells an update that learns from one that does not, whatever it answers."""

from pathlib import Path

import numpy as np
import pytest

from grading.adapters import ADAPTERS
from grading.feedback import WORDS, _todo, reason_text
from grading.job import Limits
from grading.lesson import grade_lesson
from grading.room import prepared
from grading.rubric import load_rubric
from grading.secret import Secret
from grading.tasks import Marks, learning, task_of
from tests.test_attacks import works

FILES = sorted((Path(__file__).parent / "mutants" / "learning").glob("*.py"))
LIBRARY = "from dualnav_lite.ppo import update"


def marks_of(ask, seed=0) -> Marks:
    marks = Marks()
    task_of("learning")(np.random.default_rng(seed), ask, marks)
    return marks


def student(source, change=lambda arrays: arrays):
    """What asks a student's update, run here by the sandbox's adapter."""
    names, kept = {}, {}
    exec(source, names)
    return lambda arrays: ("", change(ADAPTERS["learning"](names, arrays, kept)))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_update_that_does_not_learn_fails_and_every_one_that_does_passes(path):
    source = path.read_text(encoding="utf-8")
    marks = marks_of(student(source), seed=3)
    is_right = source.startswith("# right")
    assert (marks.passed, marks.share, marks.reason == "") == (is_right, float(is_right), is_right)
    told = marks.detail["learning"]
    assert told["last"] > 0.85 if is_right else told["last"] < 0.1
    if not is_right:
        assert source.partition("\n")[0].removeprefix("# hint: ") in reason_text(marks.reason, "en")


@pytest.mark.slow
def test_the_librarys_update_passes_with_every_key():
    found = [marks_of(student(LIBRARY), seed).detail["learning"]["last"] for seed in range(20)]
    assert min(found) > learning.NEEDED + learning.MARGIN


@pytest.mark.parametrize("push", [-1.0, 0.0, 1.0])
def test_who_always_pushes_the_same_way_gains_nothing(push):
    def ask(arrays):
        if "advantages" in arrays or "seed" in arrays:
            return "", {}
        rows = np.ones((len(arrays["observations"]), 1), np.float32)
        return "", {"actions": push * rows, "log_probs": rows[:, 0], "values": rows}

    marks = marks_of(ask)
    assert (marks.share, marks.reason) == (0.0, "does_not_learn")
    assert marks.detail["learning"]["last"] < 0.2


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda arrays: arrays and arrays | {"actions": np.full((16, 1), np.nan)}, "not_finite"),
        (lambda arrays: arrays and arrays | {"actions": np.zeros((16, 2))}, "wrong_shape"),
        (lambda arrays: arrays and arrays | {"actions": np.zeros((16, 1), np.int64)}, "wrong_type"),
        (lambda arrays: arrays | {"score": np.ones(1)}, "wrong_type"),
    ],
)
def test_an_answer_that_is_none_has_a_reason(change, reason):
    marks = marks_of(student(LIBRARY, change))
    assert (marks.share, marks.passed, marks.reason) == (0.0, False, reason)


def test_too_close_to_tell_is_tried_again_and_the_mean_decides(monkeypatch):
    told = iter([(0.0, 0.65), (0.0, 0.8), (0.0, 0.68), (0.0, 0.95), (0.0, 0.1)])
    monkeypatch.setattr(learning, "trial", lambda rng, ask: next(told))
    found = [marks_of(None) for _ in range(3)]
    assert [marks.passed for marks in found] == [True, True, False]
    assert [marks.detail["learning"]["last"] for marks in found] == [0.71, 0.95, 0.1]


def test_a_student_reads_how_far_it_came_and_how_far_it_must_come():
    detail = {"learning": {"first": -0.02, "last": 0.14, "needed": 0.7, "aim": 0.8}}
    row = {"reason_code": "does_not_learn", "status": "failed"}
    for language in ("en", "zh"):
        text = _todo(row, {"detail": detail, "source": "update:student"}, WORDS[language], language)
        assert all(number in text for number in ("-2%", "14%", "70%", "80%"))
        assert "<code>update</code>" in text


@pytest.mark.slow
def test_it_is_asked_of_the_cell_of_update_with_the_teachers_parts_where_others_are_wrong():
    works("A")
    rubric = load_rubric()
    rubric = rubric.model_copy(update={"lessons": {"10_ppo": rubric.lessons["10_ppo"]}, "policy": None, "total": 19.0})
    with prepared(rubric, Secret(b"k" * 32, "learning"), "A", Limits()) as room:
        setting = room.setting("10_ppo")
        right = setting.master.solutions
        wrong = {"policy_loss": right["policy_loss"].replace("return -", "return ")}
        uncut = right["update"].replace("torch.nn.utils.clip_grad_norm_", "len or ")
        found, _ = grade_lesson(setting, right | wrong | {"update": uncut})
        absent, _ = grade_lesson(setting, {name: source for name, source in right.items() if name != "update"})
    assert {name: one.status for name, one in found.items()} == {
        "policy_loss": "failed",
        "value_loss": "passed",
        "update": "partial",
        "learning": "passed",
    }
    assert found["learning"].source == "policy_loss:reference+value_loss:student+update:student"
    assert (absent["learning"].status, absent["learning"].reason) == ("not_run", "cell_missing")
