# right
import numpy as np


def cast_scan(pose, bearings, segments, range_max):
    angles = pose[2] + np.asarray(bearings)[:, None]
    dx, dy = np.cos(angles), np.sin(angles)
    start, along = segments[:, :2] - pose[:2], segments[:, 2:] - segments[:, :2]
    (ax, ay), (ex, ey) = start.T, along.T
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (ax * ey - ay * ex) / (dx * ey - dy * ex)
        u = (ax * dy - ay * dx) / (dx * ey - dy * ex)
        met = np.where((t > 0) & (u >= 0) & (u <= 1), t, np.inf)
    return np.minimum(met.min(axis=1), range_max)
