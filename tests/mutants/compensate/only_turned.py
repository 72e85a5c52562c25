# hint: not only turned
import numpy as np


def compensate(points, pose_then, pose_now):
    turn = pose_then[2] - pose_now[2]
    c, s = np.cos(turn), np.sin(turn)
    x, y = points.T
    return np.column_stack([c * x - s * y, s * x + c * y])
