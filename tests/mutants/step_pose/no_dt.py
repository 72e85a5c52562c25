# hint: a speed times dt is a way
import numpy as np


def step_pose(pose, v_left, v_right, track, dt):
    v, omega = 0.5 * (v_left + v_right), (v_right - v_left) / track
    middle = pose[2] + 0.5 * omega * dt
    return np.array([pose[0] + v * np.cos(middle), pose[1] + v * np.sin(middle), pose[2] + omega * dt])
