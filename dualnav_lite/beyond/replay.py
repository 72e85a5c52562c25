"""Drives on a recorded log: frames a second on one thread, and how far from the recorded commands.

`onboard` copies this file beside the log and the weights; there it runs by itself.
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from dualnav_lite.embedded import EmbeddedPolicy
from dualnav_lite.encoder import Ego, encode_state
from dualnav_lite.tracking import Tracker, constant_velocity

WARM_UP = 5  # frames in which the kernels are compiled
OWN = ("twist", "battery", "goal_robot", "guide_robot", "map_age_s", "preference")  # what the robot knows of itself
FOREIGN = {"torch", "pymunk", "gymnasium", "pydantic", "pandas"}  # what a board need not have


def drive(folder: Path) -> dict[str, float]:
    """Numbers of a drive on `scans.npz` with `ppo_actor.onnx`, both in the folder."""
    cv2.setNumThreads(1)
    log = np.load(folder / "scans.npz")
    policy, tracker = EmbeddedPolicy(folder / "ppo_actor.onnx"), Tracker(1)
    policy.reset([0])
    seconds, worst = [], 0.0
    scans, poses = [log["scan"][0]] * 3, [log["pose"][0]] * 3
    for k in range(len(log["scan"])):
        begin = time.process_time()
        scans, poses = [*scans[1:], log["scan"][k]], [*poses[1:], log["pose"][k]]
        forecast = constant_velocity(tracker.update(poses[-1][None], scans[-1][None])).rows(0)
        ego = Ego(**{name: log[name][k] for name in OWN}, forecast=forecast)
        state = encode_state(np.stack(scans), np.stack(poses), log["map"][k], ego)
        v, omega = policy.get_action(state[None])
        seconds.append(time.process_time() - begin)
        worst = max(worst, float(np.abs([v, omega] - log["action"][k]).max()))
    times = np.array(seconds[WARM_UP:])
    return {
        "frames": len(times),
        "frames_per_s": 1.0 / times.mean(),
        "p50_ms": 1e3 * float(np.percentile(times, 50)),
        "p99_ms": 1e3 * float(np.percentile(times, 99)),
        "most_different": worst,
        "foreign_modules": len(FOREIGN & set(sys.modules)),
    }


if __name__ == "__main__":
    print(json.dumps(drive(Path(__file__).resolve().parent)))
