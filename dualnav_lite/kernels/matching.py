"""Where a scan fits the map best, in a small window around where the robot believes to be."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.grid import DOOR, WEAK
from dualnav_lite.kernels.scan_noise import path_loss

EVERY = 8  # beams between two that are matched: neighbours see the same cells
FARTHEST_M = 6.0  # beyond, a beam's cells lie too far apart
TURN_RAD, SHIFT_M = 0.025, 0.05  # of the window, either way
WINDOW = np.array([SHIFT_M, SHIFT_M, TURN_RAD])  # by column of a pose
ORDER = np.array([2, 0, 1])  # heading first: a turn moves every point, a shift only fits what is turned right
GAIN = 0.6  # share of the way to the best fit that a match moves the pose: one scan may be wrong, many are not
LEAST_FIT = 0.35  # share of the beams that must fall on something solid


@njit(cache=True)
def _fit(cells, corner, pose, points, count, resolution):
    """Sum over the points of how solid the map is where they fall, read between the cells' middles."""
    size = len(cells)
    x, y, c, s = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for k in range(count):
        u = (x + points[k, 0] * c - points[k, 1] * s) / resolution - 0.5
        v = (y + points[k, 0] * s + points[k, 1] * c) / resolution - 0.5
        iu, iv = math.floor(u), math.floor(v)
        if iu < corner[0] or iv < corner[1] or iu + 1 >= corner[0] + size or iv + 1 >= corner[1] + size:
            continue
        a, b = u - iu, v - iv
        left, right, low, high = iu % size, (iu + 1) % size, iv % size, (iv + 1) % size
        if cells[low, left] >= DOOR:
            total += (1.0 - a) * (1.0 - b)
        if cells[low, right] >= DOOR:
            total += a * (1.0 - b)
        if cells[high, left] >= DOOR:
            total += (1.0 - a) * b
        if cells[high, right] >= DOOR:
            total += a * b
    return total


@njit(cache=True)
def _peak(before, here, after):
    """Place of the top of a parabola through three equally spaced values, in steps, inside [-1, 1]."""
    bend = before - 2.0 * here + after
    if bend >= -1e-9:
        return 1.0 if after > max(before, here) else -1.0 if before > max(after, here) else 0.0
    return min(max(0.5 * (before - after) / bend, -1.0), 1.0)


@njit(cache=True)
def match_scans(cells, corners, scans, due, cos_table, sin_table, resolution, range_max, poses):
    """Move the believed poses of some worlds a little towards where their scans fit their maps.

    Each of heading, x and y is tried a step to either side, and moved by `GAIN` of the way to the top of the parabola
    through the three fits. Nothing moves where the scan does not know the map.

    Args:
        cells: (n, G, G) u8 toroidal maps, corners: (n, 2) i64 lowest cells of their windows.
        scans: (n, beams, 2).
        due: (n,) bool worlds to match.
        cos_table, sin_table: (beams,) of the bearings.
        resolution: side of a cell [m]; range_max: reading of a lost beam [m].
        poses: (n, 3) changed in place.
    """
    beams = scans.shape[1]
    points = np.empty((beams // EVERY + 1, 2))
    for i in range(len(poses)):
        if not due[i]:
            continue
        count = 0
        for k in range(0, beams, EVERY):
            distance = scans[i, k, 0]
            if distance < min(range_max, FARTHEST_M) and scans[i, k, 1] * path_loss(distance) >= WEAK:
                points[count, 0], points[count, 1] = distance * cos_table[k], distance * sin_table[k]
                count += 1
        pose = poses[i]
        if count == 0 or _fit(cells[i], corners[i], pose, points, count, resolution) < LEAST_FIT * count:
            continue
        for axis in ORDER:
            believed, fits = pose[axis], np.empty(3)
            for k in range(3):
                pose[axis] = believed + (k - 1) * WINDOW[axis]
                fits[k] = _fit(cells[i], corners[i], pose, points, count, resolution)
            pose[axis] = believed + GAIN * WINDOW[axis] * _peak(fits[0], fits[1], fits[2])
