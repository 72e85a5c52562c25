# hint: before you add the old place
import numpy as np


def compensate(points, pose_then, pose_now):
    x, y = points[:, 0] + pose_then[0], points[:, 1] + pose_then[1]
    dx, dy = x - pose_now[0], y - pose_now[1]
    c, s = np.cos(pose_now[2]), np.sin(pose_now[2])
    return np.column_stack([c * dx + s * dy, c * dy - s * dx])
