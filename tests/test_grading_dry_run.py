"""What an instructor relies on before a release: whatever is broken, the dry run says so."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dualnav_lite.check import rewards as checks
from dualnav_lite.exercises import stub
from grading import dry_run as dry
from grading import self_check
from grading.adapters import ADAPTERS
from grading.example.graded import example_rubric
from grading.job import Limits
from grading.lesson import Outcome, grade_lesson, untouched
from grading.rebuild import read_master
from grading.room import NOTEBOOKS, prepared
from grading.rubric import load_rubric
from grading.secret import Secret
from grading.tasks import Marks, Question, task_of
from tests.test_attacks import works

MUTANTS = Path(__file__).parent / "mutants"
LESSON = "07_rewards"


def graded_here(setting, sources):
    """As `grade_lesson`, for solutions of our own: in this process, without a sandbox."""
    outcomes, names = {}, {}
    for kind, value in setting.master.order:
        if kind == "given":
            exec(value, names)
    for exercise, rule in setting.lesson.exercises.items():
        cell = rule.of or exercise
        source = sources.get(cell, setting.master.stubs[cell])
        if untouched(source, setting.master.stubs[cell]):
            outcomes[exercise] = Outcome(0.0, "not_run", "not_done")
            continue
        exec(source, names)
        kept: dict = {}

        def ask(arrays, exercise=exercise, kept=kept):
            try:
                return "", ADAPTERS[exercise](names, arrays, kept)
            except Exception as error:
                return f"raised_{type(error).__name__}", {}

        marks = Marks()
        task_of(exercise)(np.random.default_rng(3), ask, marks)
        outcomes[exercise] = Outcome(marks.share, "passed" if marks.passed else "partial", marks.reason)
    return outcomes, {}


@pytest.fixture
def room(monkeypatch):
    """One lesson, judged without sandboxes, policies and attacks."""
    rubric = example_rubric(LESSON)
    lesson = rubric.lessons[LESSON]
    few = {name: lesson.exercises[name] for name in ("safe", "goal")}
    mask = {symbol: name for symbol, name in lesson.mask.items() if name in few}
    rubric = rubric.model_copy(update={"lessons": {LESSON: lesson.model_copy(update={"exercises": few, "mask": mask})}})
    monkeypatch.setattr(dry, "grade_lesson", graded_here)
    monkeypatch.setattr(self_check, "grade_lesson", graded_here)
    monkeypatch.setattr(self_check, "probe", lambda tier: {})
    monkeypatch.setattr(dry, "_attacks", lambda room, say: [])
    with prepared(rubric, Secret(b"k" * 32, "dry"), "A", Limits()) as made:
        yield made


@pytest.fixture
def mutants(tmp_path):
    for name in ("safe", "goal"):
        shutil.copytree(MUTANTS / name, tmp_path / name)
    return tmp_path


def problems(room, mutants):
    return dry.dry_run(room, lambda text: None, mutants)


def test_with_nothing_broken_nothing_stands_against_it(room, mutants):
    assert problems(room, mutants) == []


def test_a_broken_reference_is_told(room, mutants):
    master = room.masters[LESSON]
    wrong = master.solutions["goal"].replace("gamma * potential_after", "potential_after")
    room.masters[LESSON] = replace(master, solutions=master.solutions | {"goal": wrong})
    assert problems(room, mutants) == [
        "nothing is graded: the reference of 'goal' gets gamma_before_the_next_potential"
    ]


def test_a_broken_check_is_told(room, mutants, monkeypatch):
    monkeypatch.setitem(checks.CHECKS, "safe", [])
    found = problems(room, mutants)
    wrong = [path for path in (mutants / "safe").glob("*.py") if not path.read_text(encoding="utf-8").startswith("# r")]
    assert len(found) == len(wrong)
    assert all("lets pass" in line for line in found)


def test_a_broken_scorer_is_told(room, mutants, monkeypatch):
    monkeypatch.setattr(Question, "judge", lambda self, answer: "")
    found = problems(room, mutants)
    assert "safe: mutant 'not_squared' passes" in found
    assert not any("right solution" in line for line in found)


def test_a_mutant_that_is_no_mistake_is_told(room, mutants):
    right = (mutants / "safe" / "right_with_where.py").read_text(encoding="utf-8")
    (mutants / "safe" / "not_squared.py").write_text(right.replace("# right", "# hint: the square"), encoding="utf-8")
    found = problems(room, mutants)
    assert "safe: mutant 'not_squared' passes" in found
    assert any("lets pass mutant 'not_squared'" in line for line in found)


def test_a_right_solution_that_is_none_is_told(room, mutants):
    text = (mutants / "safe" / "not_squared.py").read_text(encoding="utf-8")
    (mutants / "safe" / "right_with_where.py").write_text("# right\n" + text, encoding="utf-8")
    found = problems(room, mutants)
    assert "safe: the check refuses the right solution 'right_with_where'" in found
    assert any(line.startswith("safe: right solution 'right_with_where' gets") for line in found)


def test_too_few_mutants_are_told(room, mutants):
    for path in (mutants / "goal").glob("[!r]*.py"):
        path.unlink()
    assert problems(room, mutants) == ["goal: has 0 mutants, needs 3"]


def test_a_further_task_is_tried_on_its_cell_and_its_hint_stands_in_the_feedback(monkeypatch):
    monkeypatch.setattr(dry, "grade_lesson", graded_here)
    lesson = load_rubric().lessons["10_ppo"]
    setting = SimpleNamespace(lesson=lesson, master=read_master(NOTEBOOKS / "10_ppo.ipynb", stub))
    room = SimpleNamespace(setting=lambda name: setting)
    texts = {path.stem: path.read_text(encoding="utf-8") for path in (MUTANTS / "learning").glob("*.py")}
    few = {"no_step": texts["no_step"]}
    few["right_in_one_loop"] = (MUTANTS / "update" / "right_in_one_loop.py").read_text(encoding="utf-8")
    few["slow"] = texts["no_step"].replace("is not learned", "is learned slowly")
    few["right"] = texts["climbs_down"].replace("# hint: is not learned", "# right")
    assert dry._tried(room, "10_ppo", "learning", few) == [
        "feedback gives no fitting hint to mutant 'slow'",
        "right solution 'right' gets does_not_learn",
    ]


def test_a_part_that_raises_costs_its_own_points_and_no_more():
    works("A")
    rubric = example_rubric(LESSON)
    with prepared(rubric, Secret(b"k" * 32, "raises"), "A", Limits()) as made:
        setting = made.setting(LESSON)
        cells = setting.master.solutions | {"goal": "def goal(*given):\n    raise RuntimeError"}
        outcomes, _ = grade_lesson(setting, cells)
    assert {name: one.status for name, one in outcomes.items()} == {
        "safe": "passed",
        "goal": "failed",
        "reward_terms": "passed",
        "reward_weights": "passed",
    }
    assert outcomes["goal"].share == 0.0
    assert outcomes["goal"].reason == "raised_RuntimeError"
    assert outcomes["reward_terms"].source == "safe:student+goal:reference+reward_terms:student"


def test_two_right_cells_with_helpers_or_imports_of_one_name_are_both_right():
    works("A")
    rubric = example_rubric(LESSON)
    with prepared(rubric, Secret(b"k" * 32, "helpers"), "A", Limits()) as made:
        setting = made.setting(LESSON)
        solutions = setting.master.solutions
        helper = "def _missing(*given):\n    return {}\n\n"
        cells = solutions | {
            "safe": helper.format("np.maximum(0.3 - np.maximum(given[0], 0.0), 0.0)")
            + "def safe(clearance):\n    return -10.0 * _missing(np.asarray(clearance, float)) ** 2",
            "goal": "from numpy import where, asarray as array\n\n\ndef goal(before, after, reached, gamma):\n"
            "    return gamma * where(reached, 0.0, -10.0 * array(after)) + 10.0 * array(before)",
            "reward_weights": helper.format("'taken'") + "from array import array\n\n\n" + solutions["reward_weights"],
        }
        outcomes, _ = grade_lesson(setting, cells)
    assert {one.status for one in outcomes.values()} == {"passed"}


def test_right_parts_whose_imports_and_helpers_stand_in_a_wrong_ones_cell_are_right():
    """In a notebook the first cell that needs an import holds it, whether its own function is right or not."""
    works("A")
    rubric = example_rubric(LESSON)
    with prepared(rubric, Secret(b"k" * 32, "imports"), "A", Limits()) as made:
        setting = made.setting(LESSON)
        terms = setting.master.solutions["reward_terms"]
        weights = setting.master.solutions["reward_weights"]
        cells = {
            "safe": "import math\n\n\ndef safe(clearance):\n    return 0.0 * clearance\n\n\nassert safe(0.1) < 0",
            "goal": "import os\n\n\ndef goal(*given):\n    os._exit(0)",
            "reward_terms": terms.replace("(t: Transition)", "(t: Transition, most=math.inf)"),
            "reward_weights": weights.replace("(preference, ", "(preference: os.PathLike, "),
        }
        outcomes, _ = grade_lesson(setting, cells)
    assert terms != cells["reward_terms"]
    assert weights != cells["reward_weights"]
    found = {name: (one.status, one.reason) for name, one in outcomes.items()}
    assert found == {
        "safe": ("failed", "close_costs_the_square"),
        "goal": ("error", "kernel_ended"),
        "reward_terms": ("passed", ""),
        "reward_weights": ("passed", ""),
    }
    assert outcomes["reward_terms"].source == "safe:reference+goal:reference+reward_terms:student"


@pytest.mark.slow
def test_in_the_sandbox_the_reference_of_every_lesson_gets_everything():
    works("A")
    rubric = load_rubric()
    with prepared(rubric, Secret(b"k" * 32, "dry"), "A", Limits()) as made:
        self_check.self_check(made)


@pytest.mark.slow
def test_in_the_sandbox_too_every_mutant_of_two_lessons_fails_and_every_right_way_passes(monkeypatch):
    works("A")
    monkeypatch.setattr(dry, "_attacks", lambda room, say: [])  # they have tests of their own
    rubric = example_rubric()
    total = sum(one.points for lesson in rubric.lessons.values() for one in lesson.exercises.values())
    rubric = rubric.model_copy(update={"policy": None, "total": total})
    with prepared(rubric, Secret(b"k" * 32, "dry"), "A", Limits()) as made:
        assert dry.dry_run(made, lambda text: None) == []
