"""From points and footprints to ego-centred images: robot in the middle, heading up, row 0 farthest ahead."""

import math

import numpy as np
from numba import njit

SIZE = 64  # rows and columns
CELL_M = 0.1
CELLS_PER_M = 10.0
HALF = SIZE // 2


@njit(cache=True)
def rasterise_scans(scans, poses, compensate, cosines, sines, frames):
    """Cells that a returned beam ends in, for a short history of scans, all seen from the newest pose.

    Args:
        scans: (n, f, beams, 2) range [m] and intensity, oldest first; intensity 0 marks a beam without a return.
        poses: (n, f, 3) believed poses of those scans, map frame.
        compensate: whether the robot's own motion is taken out; else each scan is drawn from its own pose.
        cosines, sines: (beams,) directions of the beams, robot frame.
        frames: (n, f, SIZE, SIZE) uint8, written: 255 where a beam ends, else 0.
    """
    for i in range(scans.shape[0]):
        newest = poses[i, scans.shape[1] - 1]
        c, s = math.cos(newest[2]), math.sin(newest[2])
        for f in range(scans.shape[1]):
            turn_c, turn_s, shift_x, shift_y = 1.0, 0.0, 0.0, 0.0
            if compensate:
                turn = poses[i, f, 2] - newest[2]
                turn_c, turn_s = math.cos(turn), math.sin(turn)
                dx, dy = poses[i, f, 0] - newest[0], poses[i, f, 1] - newest[1]
                shift_x, shift_y = c * dx + s * dy, c * dy - s * dx
            image = frames[i, f]
            image[:] = 0
            for k in range(scans.shape[2]):
                if scans[i, f, k, 1] <= 0.0:
                    continue
                distance = float(scans[i, f, k, 0])
                x, y = distance * cosines[k], distance * sines[k]
                row = math.floor(HALF - (shift_x + turn_c * x - turn_s * y) * CELLS_PER_M)
                column = math.floor(HALF - (shift_y + turn_s * x + turn_c * y) * CELLS_PER_M)
                if 0 <= row < SIZE and 0 <= column < SIZE:
                    image[row, column] = 255


@njit(cache=True)
def paint_forecasts(positions, radii, valid, images):
    """How soon each cell will be taken by a mover: 1 at once, falling evenly to 0 just past the horizon.

    A cell is taken while its centre lies within a mover's radius; where several claim it, the soonest counts.

    Args:
        positions: (n, k, steps, 2) future centres [m], robot frame, evenly spaced in time.
        radii: (n, k) [m].
        valid: (n, k) bool; other rows are not read.
        images: (n, SIZE, SIZE) float32, written.
    """
    for i in range(positions.shape[0]):
        images[i] = np.float32(0.0)
        for k in range(positions.shape[1]):
            if valid[i, k]:
                _paint_mover(positions[i, k], radii[i, k], images[i])


@njit(cache=True)
def _paint_mover(path, radius, image):
    """Raise each cell within the radius of (steps, 2) future centres to how soon it is taken."""
    reach = radius * CELLS_PER_M
    for j in range(path.shape[0]):
        value = np.float32(1.0 - j / path.shape[0])
        middle_row, middle_column = HALF - 0.5 - path[j, 0] * CELLS_PER_M, HALF - 0.5 - path[j, 1] * CELLS_PER_M
        first, last = math.ceil(middle_row - reach), math.floor(middle_row + reach)
        for row in range(max(0, first), min(SIZE - 1, last) + 1):
            width = math.sqrt(max(0.0, reach * reach - (row - middle_row) ** 2))
            left, right = math.ceil(middle_column - width), math.floor(middle_column + width)
            for column in range(max(0, left), min(SIZE - 1, right) + 1):
                if image[row, column] < value:
                    image[row, column] = value


@njit(cache=True)
def scan_difference(old, new, image):
    """+1 where something is now and nothing was near before, -1 where something was and nothing is near now.

    Near means the cell itself or one of its eight neighbours, so that noise of a cell's width shows no motion.

    Args:
        old, new: (SIZE, SIZE) uint8 rasters in one frame, non-zero where a beam ends.
        image: (SIZE, SIZE) float32, written.
    """
    for row in range(SIZE):
        for column in range(SIZE):
            image[row, column] = 0.0
            is_new, is_old = new[row, column] > 0, old[row, column] > 0
            if is_new == is_old:
                continue
            other = old if is_new else new
            explained = False
            for r in range(max(0, row - 1), min(SIZE, row + 2)):
                for c in range(max(0, column - 1), min(SIZE, column + 2)):
                    explained = explained or other[r, c] > 0
            if not explained:
                image[row, column] = 1.0 if is_new else -1.0
