# hint: not in the world
import numpy as np


def compensate(points, pose_then, pose_now):
    c, s = np.cos(pose_then[2]), np.sin(pose_then[2])
    x = pose_then[0] + c * points[:, 0] - s * points[:, 1]
    y = pose_then[1] + s * points[:, 0] + c * points[:, 1]
    return np.column_stack([x, y])
