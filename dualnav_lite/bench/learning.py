"""Speed of learning and of the learnt: the whole training loop, its peer, and a command at batch 1."""

import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from dualnav_lite.bench import peers
from dualnav_lite.bench.rows import NOT_INSTALLED, Row
from dualnav_lite.config import ROOT, Config, UnusableInput
from dualnav_lite.curriculum import Training, load_training
from dualnav_lite.drivers import MODEL_FOLDER, EmbeddedPolicy
from dualnav_lite.encoder import Ego, encode_state
from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.tracking import constant_velocity
from dualnav_lite.train import Trainer

LESSON = ROOT / "training" / "lesson.yaml"
UPDATES = 4  # that are timed; one more warms up


def _short(training: Training, updates: int) -> Training:
    """The training cut to a few updates of its last stage."""
    stage = training.stages[-1]
    steps = updates * training.worlds * stage.rollout_steps
    stage = stage.model_copy(update={"steps": steps, "segment_updates": updates})
    return training.model_copy(update={"stages": [stage]})


def our_steps_per_second(training: Training, workers: int) -> float:
    """Control steps of all worlds together a second, collecting and learning; median over updates."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = Trainer(_short(training, UPDATES + 1), folder, LESSON.parent, workers, "cpu", lambda text: None)
        trainer.run()
        return float(np.median([float(row["steps_per_s"]) for row in trainer.log.rows[1:]]))


def training_rows(workers: int, with_peers: bool) -> list[Row]:
    """The whole loop of the `lesson` training, and of Stable-Baselines3's PPO on the same worlds and network."""
    training, what = load_training(LESSON), f"training, whole loop, {workers} processes"
    ours = our_steps_per_second(training, workers)
    rows = [Row(what, ours, "steps/s", 1_500, 4_000)]
    if not with_peers:
        return rows
    package = "stable-baselines3"
    name, rate = f"{package} {peers.version(package) or NOT_INSTALLED}", None
    if peers.version(package):
        from dualnav_lite.peer_ppo import train_stable

        with tempfile.TemporaryDirectory() as folder:
            found = train_stable(_short(training, UPDATES + 1), Path(folder) / "peer.zip", LESSON.parent, workers)
        rate = found["steps_per_s"]
    rows.append(Row(f"{what}: {package}", rate, "steps/s", peer=name))
    rows.append(Row(f"{what}: we against {package}", ours / rate if rate else None, "x", 1.5, 3, name))
    return rows


def command_row(config: Config, steps: int) -> Row:
    """Time from scans to a command at batch 1, its 99th percentile [ms]: encoding and the shipped policy, one core."""
    policy = EmbeddedPolicy(MODEL_FOLDER / "ppo_actor.onnx", config)
    env = DynamicNavEnv(config=config, scenario="crowd_crossing")
    _, info = env.reset(seed=1_000_014)
    scans, poses = [info["scan"]] * 3, [info["pose"]] * 3
    times = []
    for _ in range(steps):
        ego = Ego(
            info["twist"],
            info["battery"],
            info["goal_robot"],
            info["guide_robot"],
            info["map_age_s"],
            info["preference"],
            constant_velocity(SimpleNamespace(**info["tracks"])),
        )
        start = time.perf_counter()
        state = encode_state(np.stack(scans), np.stack(poses), info["map"], ego, config.observation)
        action = policy.get_action(state[None])
        times.append(time.perf_counter() - start)
        _, _, terminated, truncated, info = env.step(action)
        scans, poses = [*scans[1:], info["scan"]], [*poses[1:], info["pose"]]
        if terminated or truncated:
            _, info = env.reset()
    env.close()
    worst = float(np.percentile(times[10:], 99) * 1e3)
    return Row("encode + policy, batch 1, 99th percentile", worst, "ms", 10, 1, smaller_is_better=True)


def learning_rows(config: Config, workers: int, with_peers: bool) -> list[Row]:
    """All rows of this file; the command's is left out where no policy is shipped."""
    rows = training_rows(workers, with_peers)
    try:
        return [*rows, command_row(config, 2000)]
    except UnusableInput:
        return rows
