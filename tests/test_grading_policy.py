"""The policy task: hidden worlds on the scorer's side, commands from the other; who passes is decided by intervals."""

import contextlib
import itertools
import socket
from types import SimpleNamespace

import numpy as np
import pytest

from dualnav_lite import pareto
from dualnav_lite.config import UnusableInput
from dualnav_lite.drivers import MODEL_FOLDER
from grading import policy as graded
from grading import wire
from grading.adapters import ADAPTERS
from grading.job import Limits
from grading.lesson import Outcome
from grading.policy import Drives, PolicyEnded, RemotePolicy, judge_hypervolume, judge_survival
from grading.rubric import RUBRIC, Hypervolume, Policy, Rubric, Survival, load_rubric
from grading.secret import Secret
from grading.tasks import hypervolume, survival

RULE = Survival(points=6, thresholds={"navigation": 0.6}, first=20, most=80)
BOX = Hypervolume(
    points=2,
    scenario="navigation",
    preferences=(0.0, 1.0),
    reference={"safe_dist_m": 0.0, "energy_j_per_goal": 500.0},
    ideal={"safe_dist_m": 0.5, "energy_j_per_goal": 100.0},
    threshold=0.2,
    seeds=2,
)


def asks(answer):
    """A caller whose replies a function of the call's arrays gives."""
    return SimpleNamespace(ask=lambda word, arrays, seconds: answer(arrays))


def test_a_rate_passes_or_fails_by_its_interval_and_else_buys_seeds():
    assert survival.decide(20, 20, 0.6, RULE) == survival.PASSED
    assert survival.decide(14, 20, 0.6, RULE) == survival.UNDECIDED
    assert survival.decide(3, 20, 0.6, RULE) == survival.FAILED
    assert survival.decide(48, 80, 0.6, RULE) == survival.PASSED  # the rate itself, at the budget's end
    assert survival.decide(47, 80, 0.6, RULE) == survival.FAILED


def test_a_policy_at_half_the_threshold_hardly_ever_passes():
    generator = np.random.default_rng(0)
    passed = 0
    for _ in range(400):
        runs = generator.random(80) < 0.4
        for count in survival.looks(RULE):
            found = survival.decide(int(runs[:count].sum()), count, 0.6, RULE)
            if found != survival.UNDECIDED:
                break
        passed += found == survival.PASSED
    assert passed <= 4


def test_the_share_of_the_box_is_moocores_hypervolume():
    generator = np.random.default_rng(3)
    for _ in range(20):
        points = np.column_stack([generator.uniform(0, 0.5, 5), generator.uniform(100, 500, 5)])
        area = pareto.hypervolume(points, [0.0, 500.0]) / (0.5 * 400.0)
        assert hypervolume.share([tuple(one) for one in points], BOX) == pytest.approx(area)
    assert hypervolume.share([(9.0, 0.0)], BOX) == 1.0
    assert hypervolume.share([(0.4, float("inf"))], BOX) == 0.0


@pytest.mark.parametrize("file", ["ppo_actor.onnx", "ppo_actor.pth"])
def test_the_shipped_policy_drives_through_plain_arrays_alone(file):
    kept: dict = {}
    names = {"weights": str(MODEL_FOLDER / file)}
    planner = RemotePolicy(asks(lambda given: ("", ADAPTERS["policy"](names, given, kept))), 60.0)
    drives = Drives(planner, Secret(b"k" * 32, "course").seeds)
    policy = Policy(survival=RULE.model_copy(update={"first": 3, "most": 3}), hypervolume=BOX)
    outcome, table = judge_survival(drives, policy)
    assert (outcome.status, table[0]["survived"], table[0]["episodes"]) == ("passed", 3, 3)
    if file.endswith("onnx"):
        found = judge_hypervolume(drives, policy, table)
        assert 0.2 < found.detail["share_of_box"] < 1.0
        assert not any(seed in str(found) + str(outcome) for seed in map(str, drives.seeds_of("navigation", 3)))


def test_standing_still_passes_nothing():
    planner = RemotePolicy(asks(lambda given: ("", {"actions": np.zeros((len(given["worlds"]), 2))})), 60.0)
    drives = Drives(planner, Secret(b"k" * 32, "course").seeds)
    policy = Policy(survival=RULE.model_copy(update={"first": 6, "most": 6}), hypervolume=BOX)
    outcome, table = judge_survival(drives, policy)
    assert (outcome.share, outcome.status, outcome.reason) == (0.0, "failed", "survives_too_rarely")
    assert table[0]["timeouts"] == 6
    assert judge_hypervolume(drives, policy, table).reason == "survives_too_rarely"


def _raises(problem):
    def answer(given):
        raise problem

    return answer


@pytest.mark.parametrize(
    ("answer", "status", "reason"),
    [
        (lambda given: ("", {"actions": np.full((len(given["worlds"]), 2), np.nan)}), "failed", "not_finite"),
        (lambda given: ("", {"actions": np.full((len(given["worlds"]), 2), 1e6)}), "failed", "command_out_of_range"),
        (lambda given: ("", {"actions": np.zeros((1, 2))}), "failed", "wrong_shape"),
        (lambda given: ("", {"actions": np.zeros((20, 2)), "score": np.ones(1)}), "failed", "wrong_type"),
        (lambda given: ("ValueError", {}), "error", "raised_ValueError"),
        (lambda given: ("Chosen_by_a_student", {}), "error", "raised_an_error"),
        (_raises(wire.DeadlineError("late")), "timeout", "took_too_long"),
        (_raises(wire.ClosedError("gone")), "error", "kernel_ended"),
        (_raises(wire.ProtocolError("nonsense")), "error", "protocol"),
    ],
)
def test_an_answer_that_is_none_ends_the_task_with_a_reason(answer, status, reason):
    drives = Drives(RemotePolicy(asks(answer), 60.0), Secret(b"k" * 32, "course").seeds)
    with pytest.raises(PolicyEnded) as end:
        drives.rows("navigation", 0.5, 4)
    assert (end.value.outcome.status, end.value.outcome.reason) == (status, reason)


def test_a_rubric_that_does_not_add_up_is_refused(tmp_path):
    rubric = load_rubric().model_dump(mode="json")
    assert Rubric.model_validate(rubric)
    for change in ({"total": 99}, {"lessons": {}}, {"unknown": 1}):
        with pytest.raises(ValueError, match=r"total|Extra"):
            Rubric.model_validate(rubric | change)
    for name, wrong in itertools.product(("first", "most"), (0, -1)):
        with pytest.raises(ValueError, match="greater"):
            Survival.model_validate(RULE.model_dump() | {name: wrong})
    (tmp_path / "rubric.yaml").write_text("total: [", encoding="utf-8")
    with pytest.raises(UnusableInput, match="not valid YAML in line 1"):
        load_rubric(tmp_path / "rubric.yaml")


def test_a_three_hour_run_is_looked_at_once_and_the_full_course_asks_the_same_lessons():
    rule = RULE.model_copy(update={"thresholds": {"navigation": 0.6, "battery": 1.0}, "seeds": {"battery": 1}})
    assert survival.looks(rule.of("battery")) == [1]
    assert survival.looks(rule.of("navigation")) == [20, 40, 80]
    assert [survival.decide(n, 1, 1.0, rule.of("battery")) for n in (0, 1)] == [survival.FAILED, survival.PASSED]
    with pytest.raises(ValueError, match="'battery', which has no threshold"):
        Survival.model_validate(RULE.model_dump() | {"seeds": {"battery": 1}})
    full, usual = load_rubric(RUBRIC.with_name("full.yaml")), load_rubric()
    assert (full.lessons, full.policy.survival.of("battery").most) == (usual.lessons, 1)
    assert (full.policy.survival.first, full.policy.survival.most) == (200, 200)


def test_a_misspelt_scenario_is_told_before_anybody_is_graded(tmp_path):
    text = RUBRIC.read_text(encoding="utf-8").replace("low_light: 0.65", "low_lihgt: 0.65")
    (tmp_path / "rubric.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(UnusableInput, match="unknown scenario 'low_lihgt'"):
        load_rubric(tmp_path / "rubric.yaml")


def test_whoever_has_used_up_his_time_is_asked_no_more():
    here, there = socket.socketpair()
    with here, there, pytest.raises(PolicyEnded) as end:
        RemotePolicy(wire.Caller(wire.Connection(here)), 0.0).act(np.zeros((1, 4, 64, 64)), [{}])
    assert (end.value.outcome.status, end.value.outcome.reason) == ("timeout", "took_too_long")


def test_what_ends_the_second_part_does_not_cost_the_first(monkeypatch):
    passed, late = Outcome(1.0, "passed"), Outcome(0.0, "timeout", "took_too_long")

    def too_late(*given):
        raise PolicyEnded(late)

    sandbox = SimpleNamespace(accept=lambda *given: (None, {}), killed_for="")
    monkeypatch.setattr(graded, "Sandbox", lambda *given: contextlib.nullcontext(sandbox))
    monkeypatch.setattr(graded, "judge_survival", lambda *given: (passed, []))
    monkeypatch.setattr(graded, "judge_hypervolume", too_late)
    setting = SimpleNamespace(packages=None, limits=Limits(), tier="A", secret=Secret(b"k" * 32, "course"))
    policy = Policy(survival=RULE, hypervolume=BOX)
    assert graded.grade_policy(setting, policy, b"") == {"survival": passed, "hypervolume": late}
    monkeypatch.setattr(graded, "judge_survival", too_late)
    assert graded.grade_policy(setting, policy, b"") == {"survival": late, "hypervolume": late}
