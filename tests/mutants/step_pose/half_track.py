# hint: by the whole track
import numpy as np


def step_pose(pose, v_left, v_right, track, dt):
    v, omega = 0.5 * (v_left + v_right), (v_right - v_left) / (track / 2)
    middle = pose[2] + 0.5 * omega * dt
    return np.array([pose[0] + v * np.cos(middle) * dt, pose[1] + v * np.sin(middle) * dt, pose[2] + omega * dt])
