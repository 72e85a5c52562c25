"""The policy for a robot's computer: a folder without the simulator, and a recorded scan log to try it on.

`build` writes the modules that `encode_state` and `EmbeddedPolicy` need (found by following imports), weights, a log
of scans and commands from the simulator, and `replay.py`, which drives on the log, compares with the commands that the
full system gave, and counts frames a second on one thread. A board needs Python, numpy, OpenCV, numba and ONNX Runtime.

What is *on board* follows SPEC 4: scan, odometry, tracks, forecast, encoding, network. The map crop and the guide point
come over the link, so they stand in the log.
"""

import ast
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite.config import CONTROL_DT_S, Config, UnusableInput, write_atomic
from dualnav_lite.drivers import MODEL_FOLDER, EmbeddedPolicy
from dualnav_lite.env import DynamicNavVectorEnv

PACKAGE = Path(__file__).resolve().parent.parent
ROOTS = ("encoder", "tracking", "embedded")  # what `replay` imports
LOGGED = ("scan", "pose", "map", "twist", "battery", "goal_robot", "guide_robot", "map_age_s", "preference")
COLUMNS = [
    "scenario", "seed", "frames", "frames_per_s", "p50_ms", "p99_ms", "most_different", "folder_mb", "foreign_modules",
]  # fmt: skip
# The settings that the modules ask for, without pydantic and YAML: the numbers are those the policy was trained with.
STAND_IN = '''"""Stands in for the kit's `config` on a robot: only what the encoder reads."""

from dataclasses import dataclass, field

CONTROL_DT_S = {step_s!r}


class UnusableInput(ValueError):
    """A file that cannot be used."""


@dataclass(frozen=True)
class Motion:
    """What channel 1 shows."""

    method: str = {method!r}
    component: str = {component!r}


@dataclass(frozen=True)
class Observation:
    """Image the policy sees."""

    layout: str = {layout!r}
    intensity: bool = {intensity!r}
    motion: Motion = field(default_factory=Motion)
'''


def needed_modules() -> list[str]:
    """Dotted names inside the package that `ROOTS` import, directly or through others; `config` is left out."""
    waiting, found = list(ROOTS), set()
    while waiting:
        name = waiting.pop()
        if name in found or name == "config":
            continue
        found.add(name)
        text = (PACKAGE / f"{name.replace('.', '/')}.py").read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dualnav_lite"):
                inside = node.module.removeprefix("dualnav_lite").lstrip(".")
                files = [".".join(filter(None, (inside, alias.name))) for alias in node.names]
                modules = [one for one in files if (PACKAGE / f"{one.replace('.', '/')}.py").exists()]
                waiting += modules or [inside]
    return sorted(found)


def record(policy: EmbeddedPolicy, scenario: str, seed: int, frames: int) -> dict[str, np.ndarray]:
    """What reached the robot in an episode that the policy drove, and its commands; at most so many frames."""
    env = DynamicNavVectorEnv(1, Config(), scenario, autoreset=False)
    observations, infos = env.reset(seed=seed)
    policy.reset([0])
    kept: dict[str, list] = {name: [] for name in (*LOGGED, "action")}
    ended = False
    while not ended and len(kept["action"]) < frames:
        action = policy.act(observations)
        for name in LOGGED:
            kept[name].append(np.array(infos[name][0]))
        kept["action"].append(action[0])
        observations, _, terminations, truncations, infos = env.step(action)
        ended = bool((terminations | truncations)[0])
    return {name: np.stack(values) for name, values in kept.items()}


def build(folder: str | Path, scenario: str = "crowd_crossing", seed: int = 2_000_000, frames: int = 100) -> float:
    """Write the folder; its size in MB.

    Raises:
        UnusableInput: no shipped policy, one whose motion channel needs more than tracks, a folder that refuses.
    """
    folder, model = Path(folder), MODEL_FOLDER / "ppo_actor.onnx"
    policy = EmbeddedPolicy(model)
    observation = policy.card["observation"]
    if observation["motion"]["method"] == "truth":
        raise UnusableInput(f"{model}: it was trained on the simulator's truth, which no robot has")
    for name in needed_modules():
        source = PACKAGE / f"{name.replace('.', '/')}.py"
        write_atomic(folder / "dualnav_lite" / source.relative_to(PACKAGE), source.read_bytes())
    layout = observation.get("layout", "image")  # older cards do not say
    settings = STAND_IN.format(
        step_s=CONTROL_DT_S, layout=layout, intensity=observation["intensity"], **observation["motion"]
    )
    write_atomic(folder / "dualnav_lite" / "config.py", settings)
    for package in ("dualnav_lite", "dualnav_lite/kernels"):
        write_atomic(folder / package / "__init__.py", "")
    log = record(policy, scenario, seed, frames)
    write_atomic(folder / "scans.npz", lambda file: np.savez_compressed(file, **log))
    write_atomic(folder / "ppo_actor.onnx", model.read_bytes())
    write_atomic(folder / "replay.py", (PACKAGE / "beyond" / "replay.py").read_bytes())
    return sum(path.stat().st_size for path in folder.rglob("*") if path.suffix != ".pyc") / 1e6


def replay(folder: str | Path) -> dict[str, float]:
    """Numbers of `replay.py`, run as a board would run it: its folder alone, one thread.

    Raises:
        RuntimeError: it failed; with its last line.
    """
    one_thread = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | one_thread
    command = [sys.executable, str(Path(folder) / "replay.py")]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", env=environment)
    if done.returncode:
        raise RuntimeError(f"replay.py failed: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def onboard_table(frames: int = 300) -> pd.DataFrame:
    """Frames a second of processor time, size, and the largest difference to the full system's commands."""
    rows = []
    for scenario, seed in (("navigation", 2_000_000), ("crowd_crossing", 2_000_000), ("low_light", 2_000_000)):
        with tempfile.TemporaryDirectory() as folder:
            size = build(folder, scenario, seed, frames)
            numbers = replay(folder)
        rows.append({"scenario": scenario, "seed": seed, "folder_mb": size, **numbers})
    return pd.DataFrame(rows, columns=COLUMNS)
