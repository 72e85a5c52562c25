"""The stress runner: papermill once a case, and whatever fails costs only itself."""

import errno
import re
import signal

import numpy as np
import pandas as pd
import pytest

from dualnav_lite import drivers, judge, pace, stress, traces
from dualnav_lite.cases import all_cases
from dualnav_lite.config import UnusableInput
from dualnav_lite.episodes import SEEDS
from dualnav_lite.survival import read_episodes, survived

TUNING = SEEDS["tuning"].start


def a_plan(out, **changes):
    settings = {
        "arms": ["stand_still", "straight"],
        "episodes": 2,
        "long_arms": ["straight"],
        "long_runs": 1,
        "seed_base": TUNING,
        "jobs": 1,
        "out": out,
        "command": "a command",
    }
    return stress.Plan(**(settings | changes))


@pytest.fixture
def two_cases(monkeypatch):
    """Two short cases in place of five, one of them three hours long."""
    chosen = {name: all_cases()[name] for name in ("pop_up", "comms_dropout")}
    for module in (stress, judge):
        monkeypatch.setattr(module, "all_cases", lambda: chosen)
    return chosen


def pretended(results):
    """In place of papermill: what a case does by its name; the summary does nothing."""

    def run_notebook(notebook, output, given, progress=None):
        if notebook.stem == "summary":
            return
        act = results.get(given["case"])
        if isinstance(act, Exception):
            raise act
        names = ("case", "arms", "episodes", "seed_base", "out")
        stress.run_case(**{name: given[name] for name in names})

    return run_notebook


def test_a_quick_run_leaves_rows_tables_figures_a_report_and_the_executed_notebooks(monkeypatch, tmp_path, capsys):
    from dualnav_lite.__main__ import main

    chosen = {"pop_up": all_cases()["pop_up"]}
    for module in (stress, judge, pace):
        monkeypatch.setattr(module, "all_cases", lambda: chosen)
    out = tmp_path / "结果 一"
    arms = ["--arms", "stand_still,straight", "--seed-base", f"{TUNING}", "--jobs", "1"]
    assert main(["stress", "--quick", *arms, "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "2 arms: about a minute on 1 processes" in said.err
    assert "Pop-up obstacle: article 92 %" in said.out
    assert str(out) in said.out
    table = pd.read_csv(out / "survival.csv")
    assert list(table.arm) == ["stand_still", "straight"] * 2
    assert set(table.seed_first) == {TUNING}
    rows = read_episodes(out / "episodes.csv")
    assert len(rows) == 20
    assert not survived(rows[rows.arm == "stand_still"]).any()
    for name in ("survival", "paired", "pareto_episodes", "outcomes", "survival_strict", "training_seeds"):
        assert (out / f"{name}.csv").exists(), name
    assert r"\toprule" in (out / "survival.tex").read_text(encoding="utf-8")
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "Pop-up obstacle" in report
    assert "92 %" in report
    page = (out / "report.html").read_text(encoding="utf-8")
    assert all((out / name).exists() for name in re.findall('src="([^"]+)"', page))
    assert "image/png" in (out / "pop_up.ipynb").read_text(encoding="utf-8")
    assert "\\r" not in (out / "pop_up.ipynb").read_text(encoding="utf-8")  # of a progress bar only its end
    assert "image/png" in (out / "summary.ipynb").read_text(encoding="utf-8")
    assert (out / "figures" / "survival.pdf").stat().st_size > 1000
    assert "**survival.**" in (out / "figures" / "captions.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_whole_quick_run_with_the_shipped_policy(tmp_path):
    from dualnav_lite.__main__ import main

    assert main(["stress", "--quick", "--out", str(tmp_path)]) in (0, 1)  # 1: one run of three hours can miss 100 %
    assert pd.read_csv(tmp_path / "failed.csv").empty
    rows = read_episodes(tmp_path / "episodes.csv")
    assert len(rows) == 8 * 2 * 5 + 1
    assert rows[rows.scenario == "battery"].steps.iloc[0] == 108_000


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (RuntimeError("a scenario raised\nin the middle"), "RuntimeError: a scenario raised in the middle"),
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device"),
    ],
)
def test_a_case_that_fails_is_named_with_its_reason_and_the_others_complete(
    monkeypatch, tmp_path, two_cases, error, reason
):
    monkeypatch.setattr(stress, "run_notebook", pretended({"pop_up": error}))
    tables, failed = stress.run_stress(a_plan(tmp_path, arms=["straight"]))
    assert [what for what, _ in failed] == ["pop_up"]
    assert reason in failed[0][1]
    assert set(tables["survival"].scenario) == {"comms_dropout", "comms_dropout_bursts"}
    assert reason in (tmp_path / "report.md").read_text(encoding="utf-8")
    assert pd.read_csv(tmp_path / "failed.csv").what.tolist() == ["pop_up"]


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_kernel_is_that_case_s_failure(monkeypatch, tmp_path, two_cases):
    from dualnav_lite import notebooks

    (tmp_path / "case.ipynb").write_text(
        notebooks.to_notebook(
            '# %% tags=["parameters"]\ncase = ""\narms = []\nepisodes = 1\nseed_base = 1\njobs = 1\nshard = ""\n'
            'cluster = ""\npreference = 0.5\noverrides = {}\nout = ""\n\n# %%\nimport os\nimport signal\n\n'
            "os.kill(os.getpid(), signal.SIGKILL)\n"
        ),
        encoding="utf-8",
    )
    monkeypatch.setattr(stress, "FOLDER", tmp_path)
    monkeypatch.setattr(stress, "all_cases", lambda: {"pop_up": two_cases["pop_up"]})
    failed = stress.run_cases(a_plan(tmp_path / "out"))
    assert [what for what, _ in failed] == ["pop_up"]
    assert "DeadKernelError" in failed[0][1]


def test_episodes_that_raise_are_reported_and_fail_the_run(monkeypatch, tmp_path, two_cases):
    from dualnav_lite.simulation import Simulation

    advance = Simulation.advance

    def raising(self, commands, active):
        if (self.steps == 20).any() and self.scenarios[0].id == "comms_dropout":
            raise RuntimeError("the floor gave way")
        advance(self, commands, active)

    monkeypatch.setattr(Simulation, "advance", raising)
    monkeypatch.setattr(stress, "run_notebook", pretended({}))
    tables, failed = stress.run_stress(a_plan(tmp_path, arms=["straight"]))
    assert [what for what, _ in failed] == ["comms_dropout, straight"]
    assert "2 episodes raised; the first: RuntimeError: the floor gave way" in failed[0][1]
    assert set(tables["survival"].scenario) >= {"pop_up", "comms_dropout_bursts"}


def test_corrupt_weights_cost_one_arm_and_a_missing_model_or_name_is_refused_at_once(monkeypatch, tmp_path):
    monkeypatch.setattr(drivers, "MODEL_FOLDER", tmp_path)
    with pytest.raises(UnusableInput, match="no such model"):
        stress.broken_arms(["ppo"])
    with pytest.raises(UnusableInput, match="unknown arm 'nobody'"):
        stress.broken_arms(["nobody"])
    (tmp_path / "ppo_actor.onnx").write_bytes(b"\x08garbage" * 100)
    broken = stress.broken_arms(["ppo", "ppo_filter", "straight"])
    assert set(broken) == {"ppo", "ppo_filter"}
    assert "not an exported policy" in broken["ppo"]
    plan, failed = stress.without_broken(a_plan(tmp_path, arms=["ppo", "straight"], long_arms=["ppo"]))
    assert (plan.arms, plan.long_arms) == (["straight"], ["straight"])
    assert failed == [("ppo", broken["ppo"])]
    with pytest.raises(UnusableInput, match="no arm can drive"):
        stress.without_broken(a_plan(tmp_path, arms=["ppo"], long_arms=["ppo"]))


def test_a_policy_of_another_shape_is_one_arm_s_failure(tmp_path):
    import onnx

    node = onnx.helper.make_node("Identity", ["state"], ["output"])
    shapes = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["n", 7, 7]) for name in ("state", "output")
    ]
    model = onnx.helper.make_model(onnx.helper.make_graph([node], "foreign", shapes[:1], shapes[1:]))
    path = tmp_path / "foreign.onnx"
    path.write_bytes(model.SerializeToString())
    assert "not an exported policy" in stress.broken_arms([str(path)])[str(path)]
    shipped = onnx.load(drivers.MODEL_FOLDER / "ppo_actor.onnx")
    model.metadata_props.extend(shipped.metadata_props)  # with the card of another network it is found out by driving
    model.ir_version = shipped.ir_version
    path.write_bytes(model.SerializeToString())
    assert set(stress.broken_arms([str(path), "ppo"])) == {str(path)}


def test_nothing_to_show_is_an_error_not_an_empty_table(monkeypatch, tmp_path, two_cases):
    monkeypatch.setattr(stress, "run_notebook", pretended(dict.fromkeys(two_cases, RuntimeError("no"))))
    with pytest.raises(UnusableInput, match="no case came to its end: RuntimeError: no"):
        stress.run_stress(a_plan(tmp_path))


def test_the_notebook_asks_for_exactly_what_the_runner_gives(tmp_path):
    import papermill

    known = papermill.inspect_notebook(str(stress.FOLDER / "case.ipynb"))
    for name in all_cases():
        assert set(a_plan(tmp_path).parameters(name)) == set(known)
    assert set(papermill.inspect_notebook(str(stress.FOLDER / "summary.ipynb"))) == {"results", "language"}


def test_every_scenario_of_the_article_belongs_to_a_case():
    from dualnav_lite.scenario import all_scenarios

    held = [scenario for case in all_cases().values() for scenario in case.scenarios]
    assert len(held) == len(set(held))
    for name, scenario in all_scenarios().items():
        if scenario.article_claim is not None or name == "crowd_reactive":
            assert name in held


def test_three_hours_have_arms_and_a_count_of_their_own(tmp_path):
    for name, case in all_cases().items():
        given = a_plan(tmp_path, episodes=7).parameters(name)
        expected = (["straight"], 1) if case.is_long else (["stand_still", "straight"], 7)
        assert (given["arms"], given["episodes"]) == expected
        assert case.is_long == (name == "battery")


def test_three_hours_can_be_left_out_and_an_earlier_run_s_do_not_stand_for_them(monkeypatch, tmp_path):
    chosen = {name: all_cases()[name] for name in ("pop_up", "battery")}
    for module in (stress, judge):
        monkeypatch.setattr(module, "all_cases", lambda: chosen)
    monkeypatch.setattr(stress, "run_notebook", pretended({}))
    (tmp_path / "battery").mkdir()
    (tmp_path / "battery" / "episodes.csv").write_text("an earlier run", encoding="utf-8")
    tables, failed = stress.run_stress(a_plan(tmp_path, long_runs=0))
    assert failed == []
    assert "battery" not in set(tables["episodes"].scenario)


def test_shards_merged_are_the_whole_and_a_missing_one_is_named(monkeypatch, tmp_path, two_cases):
    def run_notebook(notebook, output, given, progress=None):
        if notebook.stem == "case":
            stress.run_case(**given)

    monkeypatch.setattr(stress, "run_notebook", run_notebook)
    settings = {"arms": ["straight"], "episodes": 5}
    stress.run_stress(a_plan(tmp_path / "whole", **settings))
    for k in (1, 2, 3):
        tables, failed = stress.run_stress(a_plan(tmp_path / f"part{k}", shard=f"{k}/3", **settings))
        assert (tables, failed) == ({}, [])
    parts = [tmp_path / f"part{k}" for k in (1, 2, 3)]
    with pytest.raises(UnusableInput, match="chunks of these settings are missing"):
        stress.merge_shards(parts[:1], a_plan(tmp_path / "some", **settings))
    stress.merge_shards(parts, a_plan(tmp_path / "merged", **settings))
    for name in ("episodes", "survival", "paired", "pareto_episodes", "outcomes"):
        assert (tmp_path / "merged" / f"{name}.csv").read_bytes() == (tmp_path / "whole" / f"{name}.csv").read_bytes()


@pytest.mark.parametrize(("text", "word"), [("3/2", "k/n"), ("0/2", "k/n"), ("a/b", "2/8"), ("2", "2/8")])
def test_a_shard_that_is_none_is_refused(text, word):
    with pytest.raises(UnusableInput, match=word):
        stress.shard_of(text)


def test_a_picture_is_drawn_with_the_policy_at_the_wheel():
    view = traces.picture("ppo", "navigation", TUNING, until_s=1.0)
    assert view.ndim == 3
    assert view.dtype == np.uint8
    assert view.std() > 10


def test_an_estimate_names_hours_and_the_dearest_arm_before_anything_runs(tmp_path):
    from dualnav_lite.pace import estimate, paces

    assert set(paces(["straight", "no_such.onnx"])) == {"straight"}
    plan = a_plan(tmp_path, arms=["straight", "cv_sampling"], long_arms=["straight"], episodes=1000, jobs=2)
    line = estimate(plan, {"straight": 1e-4, "cv_sampling": 3e-3})
    # 8 short scenarios x 1000 x 150 steps: 120 s and 3600 s; 108,000 steps of the long one: 10.8 s.
    assert line.startswith("2 arms: about 32 minutes on 2 processes")
    assert "1.0 hours of processor time; cv_sampling 96%" in line
    own = "/course/parts/ppo_actor.onnx::/course/parts"
    assert "; ppo_actor + own parts 100%)" in estimate(a_plan(tmp_path, arms=[own], long_arms=[]), {own: 1e-4})
