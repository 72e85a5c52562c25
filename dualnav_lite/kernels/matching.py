"""Where a scan fits the map best, in a small window around where the robot believes to be."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.grid import DOOR, WEAK
from dualnav_lite.kernels.scan_noise import path_loss

EVERY = 8  # beams between two that are matched: neighbours see the same cells
FARTHEST_M = 6.0  # beyond, a beam's cells lie too far apart
TURN_RAD, SHIFT_M = 0.025, 0.05  # of the window, either way
GAIN = 0.6  # share of the way to the best fit that a match moves the pose: one scan may be wrong, many are not
LEAST_FIT = 0.35  # share of the beams that must fall on something solid


@njit(cache=True)
def _fit(cells, corner, size, x, y, heading, points, count, resolution):
    """Sum over the points of how solid the map is where they fall, read between the cells' middles."""
    c, s = math.cos(heading), math.sin(heading)
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

    Heading first, then the place along both axes: each is tried a step to either side, and moved by `GAIN` of the way
    to the top of the parabola through the three fits. Nothing moves where the scan does not know the map.

    Args:
        cells: (n, G, G) u8 toroidal maps, corners: (n, 2) i64 lowest cells of their windows.
        scans: (n, beams, 2).
        due: (n,) bool worlds to match.
        cos_table, sin_table: (beams,) of the bearings.
        resolution: side of a cell [m]; range_max: reading of a lost beam [m].
        poses: (n, 3) changed in place.
    """
    size, beams = cells.shape[1], scans.shape[1]
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
        x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
        here = _fit(cells[i], corners[i], size, x, y, heading, points, count, resolution)
        if count == 0 or here < LEAST_FIT * count:
            continue
        before = _fit(cells[i], corners[i], size, x, y, heading - TURN_RAD, points, count, resolution)
        after = _fit(cells[i], corners[i], size, x, y, heading + TURN_RAD, points, count, resolution)
        heading += GAIN * TURN_RAD * _peak(before, here, after)
        here = _fit(cells[i], corners[i], size, x, y, heading, points, count, resolution)
        before = _fit(cells[i], corners[i], size, x - SHIFT_M, y, heading, points, count, resolution)
        after = _fit(cells[i], corners[i], size, x + SHIFT_M, y, heading, points, count, resolution)
        x += GAIN * SHIFT_M * _peak(before, here, after)
        here = _fit(cells[i], corners[i], size, x, y, heading, points, count, resolution)
        before = _fit(cells[i], corners[i], size, x, y - SHIFT_M, heading, points, count, resolution)
        after = _fit(cells[i], corners[i], size, x, y + SHIFT_M, heading, points, count, resolution)
        y += GAIN * SHIFT_M * _peak(before, here, after)
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, heading
