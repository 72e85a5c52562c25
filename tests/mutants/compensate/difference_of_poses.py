# hint: before you add the old place
import numpy as np


def compensate(points, pose_then, pose_now):
    dx, dy, turn = pose_now - pose_then
    x, y = points[:, 0] - dx, points[:, 1] - dy
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack([c * x + s * y, c * y - s * x])
