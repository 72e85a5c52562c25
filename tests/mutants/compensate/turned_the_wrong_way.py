# hint: turning left moves the world to the right
import numpy as np


def compensate(points, pose_then, pose_now):
    c, s = np.cos(pose_then[2]), np.sin(pose_then[2])
    x = pose_then[0] + c * points[:, 0] - s * points[:, 1]
    y = pose_then[1] + s * points[:, 0] + c * points[:, 1]
    dx, dy = x - pose_now[0], y - pose_now[1]
    c, s = np.cos(pose_now[2]), np.sin(pose_now[2])
    return np.column_stack([c * dx - s * dy, c * dy + s * dx])
