"""The parts of the observation that are computed beam by beam or number by number."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.raster import CELLS_PER_M, HALF, SIZE


@njit(cache=True)
def project_intensities(scans, cosines, sines, images):
    """Strongest intensity among the beams that end in each cell.

    Args:
        scans: (n, beams, 2) range [m] and intensity; an intensity of 0 leaves no trace.
        cosines, sines: (beams,) directions of the beams, robot frame.
        images: (n, SIZE, SIZE) float32, written; 0 where no beam ends.
    """
    for i in range(scans.shape[0]):
        image = images[i]
        image[:] = np.float32(0.0)
        for k in range(scans.shape[1]):
            distance = float(scans[i, k, 0])
            row = math.floor(HALF - distance * cosines[k] * CELLS_PER_M)
            column = math.floor(HALF - distance * sines[k] * CELLS_PER_M)
            if 0 <= row < SIZE and 0 <= column < SIZE and scans[i, k, 1] > image[row, column]:
                image[row, column] = min(np.float32(1.0), scans[i, k, 1])


@njit(cache=True)
def _direction(point):
    """Sine and cosine of a point's bearing; straight ahead for the robot's own place."""
    distance = math.hypot(point[0], point[1])
    if distance < 1e-9:
        return 0.0, 1.0
    return point[1] / distance, point[0] / distance


@njit(cache=True)
def _clipped(value, low):
    return min(1.0, max(low, value))


@njit(cache=True)
def paint_bands(twists, batteries, goals, guides, ages, preferences, scales, edges, images):
    """The robot's own state as ten bands of rows, each of one value; `encoder.BANDS` names them.

    Args:
        twists: (n, 2) v [m/s], omega [rad/s].
        batteries, preferences: (n,) in [0, 1].
        goals, guides: (n, 2) [m], robot frame.
        ages: (n,) age of the map [s].
        scales: (4,) v and omega that read 1, goal distance that reads 0.5, age that reads 1.
        edges: (11,) first row of each band and the end of the last.
        images: (n, SIZE, SIZE) float32, written.
    """
    values = np.empty(10)
    for i in range(twists.shape[0]):
        distance = math.hypot(goals[i, 0], goals[i, 1])
        values[0] = _clipped(twists[i, 0] / scales[0], -1.0)
        values[1] = _clipped(twists[i, 1] / scales[1], -1.0)
        values[2] = _clipped(batteries[i], 0.0)
        values[3] = distance / (distance + scales[2])
        values[4], values[5] = _direction(goals[i])
        values[6], values[7] = _direction(guides[i])
        values[8] = _clipped(ages[i] / scales[3], 0.0)
        values[9] = _clipped(preferences[i], 0.0)
        for band in range(10):
            images[i, edges[band] : edges[band + 1]] = np.float32(values[band])
