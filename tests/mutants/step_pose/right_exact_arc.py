# right
import numpy as np


def step_pose(pose, v_left, v_right, track, dt):
    x, y, heading = pose
    v, turn = (v_left + v_right) / 2, (v_right - v_left) / track * dt
    if abs(turn) < 1e-9:
        return np.array([x + v * dt * np.cos(heading), y + v * dt * np.sin(heading), heading])
    radius = v * dt / turn  # the exact arc of a circle
    after = heading + turn
    return np.array(
        [x + radius * (np.sin(after) - np.sin(heading)), y - radius * (np.cos(after) - np.cos(heading)), after]
    )
