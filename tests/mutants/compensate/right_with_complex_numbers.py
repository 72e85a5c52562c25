# right
import numpy as np


def compensate(points, pose_then, pose_now):
    world = complex(*pose_then[:2]) + (points @ [1, 1j]) * np.exp(1j * pose_then[2])
    seen = (world - complex(*pose_now[:2])) * np.exp(-1j * pose_now[2])
    return np.stack([seen.real, seen.imag], axis=1)
