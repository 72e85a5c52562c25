# hint: v is the mean of both wheels
import numpy as np


def step_pose(pose, v_left, v_right, track, dt):
    v, omega = v_left + v_right, (v_right - v_left) / track
    middle = pose[2] + 0.5 * omega * dt
    return np.array([pose[0] + v * np.cos(middle) * dt, pose[1] + v * np.sin(middle) * dt, pose[2] + omega * dt])
