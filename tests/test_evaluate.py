"""Rows, chunks and resumption on a small stand-in world whose episodes are known; tables on rows written by hand."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dualnav_lite.config import UnusableInput, dump_config, with_overrides
from dualnav_lite.episodes import COLUMNS, SEEDS
from dualnav_lite.evaluate import evaluate, library_env
from dualnav_lite.scenario import load_scenario

SEEDS_HERE = SEEDS["tuning"][:120]


class CountingWorlds:
    """n worlds on a line: each episode's length and numbers follow from its seed and the actions alone."""

    def __init__(self, num_envs, config, scenario, planner):
        self.num_envs, self.preference, self.delay_s = num_envs, config.preference, getattr(planner, "delay_s", 0.0)
        self.seed, self.step_count, self.x = np.zeros((3, num_envs))
        self.ended = np.ones(num_envs, bool)

    def reset(self, *, seed, options=None):
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        assert self.ended[mask].all(), "a running episode was cut off"
        self.seed[mask] = np.array(seed)[mask]
        self.step_count[mask] = self.x[mask] = 0
        self.ended[mask] = False
        return self._observations(), self._infos()

    def step(self, actions):
        if actions.shape != (self.num_envs, 2) or np.isnan(actions).any():
            raise ValueError(f"actions must be ({self.num_envs}, 2) finite numbers")
        time.sleep(self.delay_s)
        running = ~self.ended
        self.x[running] += 0.1 * actions[running, 0] * (1 + np.sin(self.seed[running]))
        self.step_count[running] += 1
        ends = running & (self.step_count >= 3 + self.seed % 7)
        self.ended |= ends
        return self._observations(), np.zeros(self.num_envs), ends, np.zeros(self.num_envs, bool), self._infos()

    def close(self):
        pass

    def _observations(self):
        return np.stack([self.seed, self.step_count], axis=1)

    def _infos(self):
        numbers = {name: self.x for name, kind in COLUMNS.items() if kind == "float64"}
        counts = {name: self.step_count.astype(int) for name, kind in COLUMNS.items() if kind == "Int64"}
        episode = numbers | counts | {"steps": self.step_count.astype(int), "first_event_s": self.x * np.nan}
        episode["outcome"] = np.where(self.seed % 3 == 0, "hit_wall", "goal").astype(object)
        episode["collided_with"] = np.where(self.seed % 3 == 0, "wall", "").astype(object)
        episode["reason"] = np.full(self.num_envs, "", object)
        preference = np.full(self.num_envs, self.preference)
        return {"summary": episode, "preference": preference, "x": self.x.copy()}


class Driver:
    """Stand-in arm with a memory per world, so that a forgotten reset shows in the rows."""

    needs_truth = needs_full_map = False

    def __init__(self, arm, config):
        self.arm, self.memory = arm, {}
        self.delay_s = 0.002 if arm == "slow" else 0.0

    def reset(self, indices):
        self.memory.update(dict.fromkeys(map(int, indices), 0))

    def act(self, observations, infos):
        actions = np.zeros((len(infos), 2))
        for i, info in enumerate(infos):
            self.memory[i] += 1
            actions[i, 0] = 0.5 + 0.01 * self.memory[i] + 0.1 * info["x"]
            seed, step = observations[i]
            if self.arm == "crashes" and seed % 40 == 7 and step == 2:
                raise RuntimeError(f"no way\nout of {len(infos)} = worlds")
            if self.arm == "not_a_number" and seed % 50 == 3:
                actions[i] = np.nan
        return actions


def run(out, arms=("steady", "other"), scenarios=("navigation", "pop_up"), seeds=SEEDS_HERE, **settings):
    """`evaluate` on the stand-ins, silently."""
    settings = {"make_planner": Driver, "make_env": CountingWorlds, "progress": False} | settings
    return evaluate(arms, scenarios, seeds, out, **settings)


def content(out):
    return (Path(out) / "episodes.csv").read_bytes()


def test_rows_have_the_columns_of_the_contract_and_one_per_arm_scenario_and_seed(tmp_path):
    rows = run(tmp_path)
    with open(tmp_path / "episodes.csv", encoding="utf-8", newline="") as file:
        header = next(csv.reader(file))
    assert ", ".join(header) == (
        "scenario, arm, training_seed, seed, preference, outcome, collided_with, events, first_event_s, steps, time_s, "
        "path_m, min_clearance_m, mean_clearance_m, energy_j, battery_end, goals, contacts, accel_rms, "
        "omega_sign_changes, r_safe, r_dynamic, r_energy, r_goal, r_terminal, reason"
    )
    assert len(rows) == 2 * 2 * len(SEEDS_HERE)
    assert not rows.duplicated(["scenario", "arm", "seed"]).any()
    assert rows.training_seed.isna().all()
    assert (rows.steps == 3 + rows.seed % 7).all()
    assert ((rows.outcome == "goal") == (rows.seed % 3 != 0)).all()


@pytest.mark.parametrize("settings", [{"num_envs": 1}, {"num_envs": 32}, {"jobs": 2}, {"jobs": 2, "num_envs": 3}])
def test_rows_are_the_same_bytes_for_any_number_of_worlds_and_workers(tmp_path, settings):
    run(tmp_path / "a")
    run(tmp_path / "b", **settings)
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_order_of_arms_and_scenarios_does_not_change_the_file(tmp_path):
    run(tmp_path / "a")
    run(tmp_path / "b", arms=("other", "steady", "other"), scenarios=("pop_up", "navigation"))
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_shards_together_are_the_whole_and_only_the_last_one_writes_the_table(tmp_path):
    run(tmp_path / "whole")
    parts = []
    for k in (1, 2, 3):
        assert not (tmp_path / "shards" / "episodes.csv").exists()
        parts.append(len(run(tmp_path / "shards", shard=(k, 3))))
    assert content(tmp_path / "shards") == content(tmp_path / "whole")
    assert parts[0] < parts[1] < parts[2] == 480


def test_a_second_run_runs_nothing_again(tmp_path):
    run(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "chunks").iterdir()}
    assert len(before) == 2 * 2 * 3
    rows = run(tmp_path, make_env=None)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "chunks").iterdir()} == before
    assert len(rows) == 480


def test_a_longer_run_keeps_the_full_chunks_of_a_shorter_one(tmp_path):
    run(tmp_path, arms=["steady"], scenarios=["navigation"], seeds=SEEDS_HERE[:70])
    names = {path.name for path in (tmp_path / "chunks").iterdir()}
    run(tmp_path, arms=["steady"], scenarios=["navigation"])
    longer = {path.name for path in (tmp_path / "chunks").iterdir()}
    assert len(names & longer) == 2  # the short chunk of 20 stays on disk, unused
    assert len(content(tmp_path).splitlines()) == 121


@pytest.mark.parametrize("change", [{"preference": 0.9}, {"overrides": {"hardware.max_lin_vel": 0.5}}])
def test_a_changed_setting_never_meets_an_old_chunk(tmp_path, change):
    run(tmp_path, arms=["steady"], scenarios=["navigation"])
    names = {path.name for path in (tmp_path / "chunks").iterdir()}
    rows = run(tmp_path, arms=["steady"], scenarios=["navigation"], **change)
    assert len({path.name for path in (tmp_path / "chunks").iterdir()} - names) == 3
    assert set(rows.preference) == {change.get("preference", 0.5)}
    assert len(rows) == 120


def test_a_damaged_chunk_is_run_again(tmp_path):
    run(tmp_path, arms=["steady"], scenarios=["navigation"])
    whole = content(tmp_path)
    victim = next((tmp_path / "chunks").iterdir())
    victim.write_bytes(victim.read_bytes()[:-200])
    run(tmp_path, arms=["steady"], scenarios=["navigation"])
    assert content(tmp_path) == whole


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_killed_in_the_middle_and_run_again_gives_the_same_bytes(tmp_path):
    settings = {"arms": ("slow", "steady"), "scenarios": ("navigation",)}
    run(tmp_path / "whole", **settings)
    code = f"import test_evaluate as t; t.run(r'{tmp_path / 'killed'}', **{settings!r})"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    process = subprocess.Popen([sys.executable, "-c", code], env=environment)
    chunks, give_up = tmp_path / "killed" / "chunks", time.monotonic() + 60
    while not (chunks.is_dir() and any(path.suffix == ".csv" for path in chunks.iterdir())):
        assert process.poll() is None
        assert time.monotonic() < give_up
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert 0 < sum(path.suffix == ".csv" for path in chunks.iterdir()) < 6
    assert not (tmp_path / "killed" / "episodes.csv").exists()
    run(tmp_path / "killed", **settings)
    assert content(tmp_path / "killed") == content(tmp_path / "whole")


@pytest.mark.parametrize(
    ("arm", "modulus", "rest", "reason", "steps"),
    [
        ("crashes", 40, 7, "RuntimeError: no way out of 1 = worlds", 2),
        ("not_a_number", 50, 3, "ValueError: actions must be (1, 2) finite numbers", 0),
    ],
)
def test_an_arm_that_crashes_costs_its_own_episodes_alone(tmp_path, arm, modulus, rest, reason, steps):
    rows = run(tmp_path / "a", arms=[arm], scenarios=["navigation"])
    steady = run(tmp_path / "b", arms=["steady"], scenarios=["navigation"])
    bad = rows.seed % modulus == rest
    assert bad.any()
    assert (rows.outcome[bad] == "error").all()
    assert (rows.reason[bad] == reason).all()
    assert (rows.steps[bad] == steps).all()
    assert rows.time_s[bad].isna().all()
    assert rows[~bad].drop(columns="arm").equals(steady[~bad].drop(columns="arm"))
    run(tmp_path / "c", arms=[arm], scenarios=["navigation"], num_envs=1)
    assert content(tmp_path / "a") == content(tmp_path / "c")


def test_unusable_input_ends_the_evaluation_instead_of_filling_rows(tmp_path):
    class Impossible(CountingWorlds):
        def reset(self, *, seed, options=None):
            raise UnusableInput("no room for a goal")

    with pytest.raises(UnusableInput, match="no room"):
        run(tmp_path, make_env=Impossible)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"shard": (0, 2)}, "shard"),
        ({"shard": (3, 2)}, "shard"),
        ({"seeds": []}, "seeds"),
        ({"seeds": [1, 2, 1]}, "distinct"),
        ({"scenarios": ["nowhere"]}, "nowhere.*navigation"),
        ({"overrides": {"hardware.wings": 2}}, "hardware.wings.*max_ang_vel"),
        ({"preference": 2.0}, "preference"),
    ],
)
def test_unusable_input_is_one_clear_line(tmp_path, settings, message):
    with pytest.raises(UnusableInput, match=message) as caught:
        run(tmp_path, **settings)
    assert "\n" not in str(caught.value)


def test_a_file_where_the_results_folder_should_be_is_one_clear_line(tmp_path):
    (tmp_path / "results").write_text("", encoding="utf-8")
    with pytest.raises(UnusableInput, match="cannot be written"):
        run(tmp_path / "results")


def test_a_folder_with_chinese_characters_and_a_space_works(tmp_path):
    run(tmp_path / "结果 一", arms=["steady"], scenarios=["navigation"], seeds=SEEDS_HERE[:3])
    assert len(content(tmp_path / "结果 一").splitlines()) == 4


class Pursuit:
    """A driver for the real worlds: turns to the guide point and goes, with a smoothed command as its memory."""

    needs_truth = needs_full_map = False
    training_seed, fingerprint = 4, "0" * 64

    def __init__(self, arm, config):
        self.speed, self.turn = config.hardware.max_lin_vel, np.zeros(64)

    def reset(self, indices):
        self.turn[indices] = 0.0

    def act(self, observations, infos):
        guides = np.array([info["guide_robot"] for info in infos])
        bearing = np.arctan2(guides[:, 1], guides[:, 0])
        self.turn[: len(infos)] += 0.5 * (2.0 * bearing - self.turn[: len(infos)])
        return np.column_stack([self.speed * np.clip(np.cos(bearing), 0.1, 1.0), self.turn[: len(infos)]])


class Watched:
    """`library_env`, noting in a folder which process makes how many worlds; waits there until `processes` have."""

    def __init__(self, folder, processes):
        self.folder, self.processes = folder, processes
        folder.mkdir()

    def __call__(self, num_envs, config, scenario, planner):
        (self.folder / f"{os.getpid()}.{scenario.id}.{num_envs}").touch()
        give_up = time.monotonic() + 120
        while len({process for process, _, _ in self.made()}) < self.processes:
            assert time.monotonic() < give_up, "no other process has come"
            time.sleep(0.01)
        return library_env(num_envs, config, scenario, planner)

    def made(self):
        return sorted(path.name.split(".") for path in self.folder.iterdir())


def short_scenarios(folder):
    """Files of three scenarios whose runs last seconds: people, light and link; boxes that pop up; a crowd."""
    radio = {f"link.{key}": value for key, value in load_scenario("comms_dropout_bursts").link.model_dump().items()}
    near = {"goal_radius_m": 1.5, "room.goal_distance_m.low": 2.0, "room.goal_distance_m.high": 3.0}
    soon = {"pop_up.first_trigger_m.low": 0.1, "pop_up.first_trigger_m.high": 0.3}
    for name, base, change in (
        ("dim", "low_light_phantoms", radio | near),
        ("box", "pop_up", soon),
        ("crowd", "crowd_reactive", {"crowd.lead_s.low": 4.0}),
    ):
        limit = {"id": name, "time_limit_paths": 0.1, "time_limit_extra_s": 1.8}
        scenario = with_overrides(load_scenario(base), change | limit)
        (folder / f"{name}.yaml").write_text(dump_config(scenario), encoding="utf-8")
        yield str(folder / f"{name}.yaml")


def test_rows_of_the_real_worlds_are_the_same_bytes_for_1_8_and_32_worlds_and_1_or_2_workers(tmp_path, monkeypatch):
    monkeypatch.setattr("dualnav_lite.evaluate.LITTLE", 0)
    settings = {
        "arms": ["pursuit"],
        "scenarios": list(short_scenarios(tmp_path)),
        "seeds": SEEDS["tuning"][:34],  # two more than worlds, so that some begin a second episode
        "make_planner": Pursuit,
    }
    contents = []
    for worlds, jobs in ((1, 1), (8, 1), (32, 2)):
        watched = Watched(tmp_path / f"made {worlds}", jobs)
        rows = run(tmp_path / str(worlds), **settings, num_envs=worlds, jobs=jobs, make_env=watched)
        contents.append(content(tmp_path / str(worlds)))
        processes, scenarios, counts = zip(*watched.made(), strict=True)
        assert set(counts) == {str(worlds)}
        assert sorted(scenarios) == ["box", "crowd", "dim"]
        assert len(set(processes)) == jobs
        assert (str(os.getpid()) in processes) == (jobs == 1)
    assert len(set(contents)) == 1
    assert len(rows) == 3 * 34
    assert not (rows.outcome == "error").any(), rows.reason.tolist()
    assert (rows.training_seed == 4).all()
    assert rows.time_s.to_numpy() == pytest.approx(0.1 * rows.steps)
    assert (rows.outcome == "goal").any()
    assert (rows[rows.scenario != "dim"].groupby("scenario").events.max() > 0).all()
    assert rows.drop(columns=["training_seed", "first_event_s"]).notna().all(axis=None)
