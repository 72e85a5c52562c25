import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from dualnav_lite.config import UnusableInput
from dualnav_lite.curriculum import Training, load_training, runs_folder
from dualnav_lite.deploy import EmbeddedPolicy
from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.progress import Log, Reporter
from dualnav_lite.train import Trainer, TrainingStopped, train
from dualnav_lite.weights import load_weights

TRAINING = Path(__file__).parent.parent / "training"
SHORT = {
    "title": "short",
    "worlds": 3,
    "stages": [
        {
            "name": "imitate",
            "kind": "imitate",
            "scenarios": ["navigation"],
            "imitation": {
                "rounds": 1,
                "first_round_shards": 1,
                "worlds": 2,
                "shard_labels": 16,
                "last_updates": 2,
                "batch": 8,
            },
        },
        {
            "name": "ppo",
            "kind": "ppo",
            "scenarios": ["navigation", "pop_up"],
            "steps": 96,
            "rollout_steps": 8,
            "segment_updates": 2,
            "warm_up_updates": 1,
            "ppo": {"reference_coef": 0.1, "minibatch": 12, "micro_batch": 12, "epochs": 1},
        },
    ],
}


def quiet(text):
    pass


def weights(folder):
    states = [load_weights(Path(folder) / f"{name}.pth") for name in ("actor", "critic")]
    return torch.cat([value.ravel() for state in states for value in state.values()])


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    Trainer(Training(**SHORT), folder, say=quiet).run()
    return folder


def test_what_a_stage_taught_is_exported_and_the_same_command_goes_on_from_there(undisturbed, tmp_path, monkeypatch):
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "runs"))
    config = tmp_path / "short.yaml"
    config.write_text(yaml.safe_dump(SHORT), encoding="utf-8")
    folder = train(config, out=tmp_path / "taught", until="imitate", say=quiet)
    taught = load_weights(tmp_path / "taught" / "ppo_actor.pth")
    kept = load_weights(undisturbed / "imitate.done.pth")["actor"]
    assert all(torch.equal(taught[name], kept[name]) for name in kept)
    assert not (folder / "actor.pth").exists()
    with pytest.raises(UnusableInput, match="no stage 'ppp'; the training has imitate, ppo"):
        train(config, until="ppp", say=quiet)
    train(config, say=quiet)
    assert torch.equal(weights(folder), weights(undisturbed))


@pytest.mark.parametrize("at_save", [1, 2])
def test_a_run_that_was_stopped_ends_with_the_weights_of_one_that_was_not(undisturbed, tmp_path, monkeypatch, at_save):
    saves, save = [], Trainer._save

    def stop_after_saving(self, *rest):
        save(self, *rest)
        saves.append(1)
        if len(saves) == at_save:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_save", stop_after_saving)
        with pytest.raises(KeyboardInterrupt):
            Trainer(Training(**SHORT), tmp_path, say=quiet).run()
    said = []
    Trainer(Training(**SHORT), tmp_path, say=said.append).run()
    assert f"going on from update {2 * at_save}" in said
    assert torch.equal(weights(tmp_path), weights(undisturbed))
    steps = [line.split(",")[:2] for line in (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()]
    assert steps == [["stage", "step"], ["imitate", "16"]] + [["ppo", str(24 * k)] for k in (1, 2, 3, 4)]


def test_a_finished_run_is_not_trained_again(undisturbed):
    before = (undisturbed / "log.csv").read_bytes()
    trainer = Trainer(Training(**SHORT), undisturbed, say=quiet)
    trainer.run()
    assert (undisturbed / "log.csv").read_bytes() == before


def test_the_policy_learns_only_after_its_values_have_warmed_up(tmp_path):
    short = Training(**SHORT)
    stage = short.stages[1].model_copy(update={"warm_up_updates": 4})
    Trainer(short.model_copy(update={"stages": [short.stages[0], stage]}), tmp_path, say=quiet).run()
    imitated, after = (load_weights(tmp_path / f"{name}.done.pth") for name in ("imitate", "ppo"))
    assert all(torch.equal(imitated["actor"][key], after["actor"][key]) for key in after["actor"])
    assert not all(torch.equal(imitated["critic"][key], after["critic"][key]) for key in after["critic"])


def test_a_folder_of_another_training_is_refused(undisturbed):
    with pytest.raises(UnusableInput, match="other settings"):
        Trainer(Training(**SHORT | {"seed": 1}), undisturbed, say=quiet)


def test_a_value_that_is_no_number_stops_the_run_names_step_and_culprit_and_keeps_the_checkpoint(tmp_path, monkeypatch):
    save = Trainer._save

    def save_and_break(self, *rest):
        save(self, *rest)
        with torch.no_grad():
            self.critic.heads.bias[0] = float("nan")

    monkeypatch.setattr(Trainer, "_save", save_and_break)
    with pytest.raises(TrainingStopped, match=r"stage 'ppo', step 72: the .* loss is nan; the checkpoint of step 48"):
        Trainer(Training(**SHORT), tmp_path, say=quiet).run()
    kept = load_weights(tmp_path / "ppo.checkpoint.pth")
    assert kept["done"] == 2
    assert all(bool(torch.isfinite(value).all()) for value in kept["critic"].values())


def test_a_full_disk_is_said_in_one_line_and_leaves_no_half_file(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    trainer = Trainer(Training(**SHORT), tmp_path, say=quiet)
    monkeypatch.setattr("dualnav_lite.config.os.fsync", full)
    with pytest.raises(UnusableInput, match="cannot be written: No space left"):
        trainer.run()
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == ["training.yaml"]


def test_torn_weights_are_named(undisturbed, tmp_path):
    torn = tmp_path / "actor.pth"
    torn.write_bytes((undisturbed / "actor.pth").read_bytes()[:5000])
    with pytest.raises(UnusableInput, match=r"actor\.pth: cannot be read as weights"):
        load_weights(torn)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stagess": []}, "unknown key 'stagess'; known keys here: .*stages"),
        ({"stages": []}, "stages: "),
        ({"config": {"map.cash": True}}, "unknown key 'map.cash'"),
        ({"stages": [{"name": "a", "kind": "ppo", "scenarios": ["nowhere"]}]}, "unknown scenario 'nowhere'"),
        ({"stages": [{"name": "a", "kind": "sarsa", "scenarios": ["navigation"]}]}, "kind"),
        ({"stages": [SHORT["stages"][0]] * 2}, "names must differ"),
    ],
)
def test_a_wrong_training_file_is_refused_by_name(tmp_path, changes, message):
    path = tmp_path / "training.yaml"
    path.write_text(yaml.safe_dump(SHORT | changes), encoding="utf-8")
    with pytest.raises(UnusableInput, match=message):
        load_training(path)


POLICIES = sorted(path for path in TRAINING.glob("*.yaml") if path.stem != "predictor")  # which has keys of its own


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_shipped_trainings_can_be_read_and_never_touch_foreign_seeds(path):
    training = load_training(path, seed=3)
    assert training.seed == 3
    assert len(training.stages) >= 1


def test_runs_go_where_they_are_told_and_never_into_the_checkout(monkeypatch, tmp_path):
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path))
    assert runs_folder() == tmp_path
    monkeypatch.delenv("DUALNAV_RUNS")
    assert not runs_folder().is_relative_to(TRAINING.parent)


def test_both_objectives_are_printed_every_hundred_episodes():
    said = []
    reporter = Reporter(said.append, total_steps=1000, done_steps=0)
    summary = {"min_clearance_m": [0.4, 0.2], "energy_j": [10.0, 30.0], "outcome": np.array(["goal", "timeout"])}
    for step in range(50):
        reporter.take({"summary": summary, "_summary": np.array([True, True])}, step + 1)
    assert len(said) == 1
    assert said[0].startswith("Ep 100: SafeDist=0.30m | Energy=20.00J | reached 50%")


def test_a_log_forgets_what_came_after_a_checkpoint(tmp_path):
    log = Log(tmp_path / "log.csv", quiet)
    for stage, step in (("a", 10), ("a", 20), ("b", 10), ("b", 20), ("b", 30)):
        log.add(stage, step, {"loss": 1.0 / step})
    again = Log(tmp_path / "log.csv", quiet)
    again.rewind("b", 10)
    assert [(row["stage"], int(row["step"])) for row in again.rows] == [("a", 10), ("a", 20), ("b", 10)]


def test_an_exported_training_drives_the_worlds_it_was_trained_in(undisturbed, tmp_path):
    trainer = Trainer(Training(**SHORT), undisturbed, say=quiet)
    trainer.run()
    paths = trainer.export(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "ppo_actor.pth",
        "ppo_actor.pt",
        "ppo_actor.onnx",
        "ppo_critic.pth",
    }
    env = DynamicNavEnv(scenario="navigation")
    policy = EmbeddedPolicy(paths["onnx"], env.config)
    observation, _ = env.reset(seed=1)
    for _ in range(3):
        observation, *_, info = env.step(policy.get_action(observation[None]))
        assert not info["clipped"]


SCRIPT = """
import sys
from dualnav_lite.train import train
if __name__ == "__main__":
    train(sys.argv[1], run="killed", workers=int(sys.argv[2]), say=lambda text: print(text, flush=True))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is a POSIX matter")
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_at_random_moments_and_resumed_it_ends_with_the_same_weights(tmp_path, monkeypatch, workers):
    config, script = tmp_path / "short.yaml", tmp_path / "go.py"
    longer = SHORT | {"stages": [SHORT["stages"][0], SHORT["stages"][1] | {"steps": 24 * 60}]}
    config.write_text(yaml.safe_dump(longer), encoding="utf-8")
    script.write_text(SCRIPT, encoding="utf-8")
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "alone"))
    begin = time.monotonic()
    alone = train(config, run="killed", workers=1, say=quiet)
    lasted = time.monotonic() - begin
    environment = {**os.environ, "DUALNAV_RUNS": str(tmp_path / "killed")}
    moments = np.random.default_rng(workers).uniform(0.2, 1.0, 5) * (lasted + 5.0)
    for moment in moments:
        process = subprocess.Popen(
            [sys.executable, str(script), str(config), str(workers)], env=environment, start_new_session=True
        )
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    subprocess.run([sys.executable, str(script), str(config), str(workers)], env=environment, check=True)
    assert torch.equal(weights(alone), weights(tmp_path / "killed" / "killed"))
