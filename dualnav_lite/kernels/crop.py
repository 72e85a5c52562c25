"""What the robot sees of its map: an ego-centred image, and the planner's grid with the present scan laid over."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.grid import (
    CELL_OF_LABEL,
    FREE,
    UNKNOWN,
    WEAK,
    copy_grid,
    hit_cells,
    move_window,
    window_corner,
)
from dualnav_lite.kernels.scan_noise import path_loss

# Image rows run from ahead to behind, columns from left to right, the robot in the middle; an image cell is as large as
# a map cell, so offsets count in cells.


@njit(cache=True)
def crop_map(cells, corner, pose, resolution, cell_value, image):
    """Fill one image with the map around a pose, heading up; outside the window it is unknown."""
    size, side = len(cells), len(image)
    flat = cells.reshape(size * size)
    found = np.empty(side, np.int64)  # apart from the look-up, so that the arithmetic is done several cells at a time
    c, s = math.cos(pose[2]), math.sin(pose[2])
    gx, gy = pose[0] / resolution - corner[0], pose[1] / resolution - corner[1]
    left, low = corner[0] % size, corner[1] % size
    middle = 0.5 * (side - 1)
    for row in range(side):
        ahead = middle - row
        for k in range(side):
            leftward = middle - k
            x, y = gx + ahead * c - leftward * s, gy + ahead * s + leftward * c
            inside = (x >= 0.0) & (y >= 0.0) & (x < size) & (y < size)
            at_x, at_y = int(x) + left, int(y) + low
            at_x = at_x - size if at_x >= size else at_x
            at_y = at_y - size if at_y >= size else at_y
            found[k] = at_y * size + at_x if inside else -1
        for k in range(side):
            image[row, k] = cell_value[flat[found[k]] if found[k] >= 0 else UNKNOWN]


@njit(cache=True)
def lay_free(image, scan, cell_beam, cell_distance, resolution, range_max, value):
    """Show as free every image cell that the beam through its middle passes, a cell short of the hit."""
    passed = np.empty(len(scan), np.float32)
    for k in range(len(scan)):
        passed[k] = scan[k, 0] / resolution - 1.0 if scan[k, 0] < range_max else 0.0
    for row in range(len(image)):
        for k in range(len(image)):
            is_passed = cell_distance[row, k] < passed[cell_beam[row, k]]
            image[row, k] = value if is_passed else image[row, k]


@njit(cache=True)
def lay_hits(image, scan, labels, cos_table, sin_table, resolution, range_max, cell_value):
    """Show the hits in an image; people too, as furniture, for they stand there now.

    Of beams less than half a cell apart at the middle of the image's edge some are left out.
    """
    side, beams = len(image), len(scan)
    every = max(1, int(0.5 * beams / (math.pi * side)))
    found = np.empty((beams + every - 1) // every, np.int64)
    for j in range(len(found)):
        distance, intensity = scan[j * every, 0], scan[j * every, 1]
        down = 0.5 * side - distance / resolution * cos_table[j * every]
        right = 0.5 * side - distance / resolution * sin_table[j * every]
        inside = (down >= 0.0) & (right >= 0.0) & (down < side) & (right < side)
        believed = (distance < range_max) & (intensity * path_loss(distance) >= WEAK)
        found[j] = int(down) * side + int(right) if inside & believed else -1
    flat = image.reshape(side * side)
    for j in range(len(found)):
        if found[j] >= 0:
            flat[np.uint64(found[j])] = cell_value[CELL_OF_LABEL[labels[j * every]]]


@njit(cache=True)
def crop_maps(
    cells,
    corners,
    poses,
    cached,
    age_steps,
    scans,
    labels,
    cell_beam,
    cell_distance,
    cos_table,
    sin_table,
    resolution,
    range_max,
    cell_value,
    images,
):
    """Images of n maps, with the present scan laid over where `cached`.

    Args:
        cells: (n, G, G) u8 received maps, corners: (n, 2) their windows.
        poses: (n, 3) where each image is taken, map frame.
        cached: whether the present scan is laid over.
        age_steps: (n,) age of each map; free space is laid over only where the map is older than the scan.
        scans: (n, beams, 2) f32, labels: (n, beams) u8.
        cell_beam: (side, side) i64 beam through the middle of each image cell.
        cell_distance: (side, side) f32 distance of that middle [cells].
        cell_value: (5,) f32 shown value of each code.
        images: (n, side, side) f32 out.
    """
    for i in range(len(poses)):
        image, scan = images[i], scans[i]
        crop_map(cells[i], corners[i], poses[i], resolution, cell_value, image)
        if cached and age_steps[i] > 0:
            lay_free(image, scan, cell_beam, cell_distance, resolution, range_max, cell_value[FREE])
        if cached:
            lay_hits(image, scan, labels[i], cos_table, sin_table, resolution, range_max, cell_value)


@njit(cache=True)
def plan_grids(
    cells, corners, poses, cached, scans, labels, due, cos_table, sin_table, resolution, range_max, grids, grid_corners
):
    """Received maps in a window around the present pose, with the present hits laid over where `cached`.

    Args:
        cells, corners, poses, cached, scans, labels: as in `crop_maps`.
        due: (n,) bool, the other worlds stay as they are.
        grids: (n, G, G) u8 out, toroidal; what the received window did not hold is unknown.
        grid_corners: (n, 2) i64 out, lowest cell of each window.
    """
    size = cells.shape[1]
    for i in range(len(poses)):
        if not due[i]:
            continue
        copy_grid(cells[i], grids[i])
        move_window(grids[i], UNKNOWN, corners[i], poses[i], resolution)
        grid_corners[i] = window_corner(poses[i], size, resolution)
        if not cached:
            continue
        found = hit_cells(grid_corners[i], size, poses[i], scans[i], 0, 1, cos_table, sin_table, resolution, range_max)
        flat = grids[i].reshape(size * size)
        for k in range(len(found)):
            if found[k] >= 0:
                flat[np.uint64(found[k])] = CELL_OF_LABEL[labels[i, k]]
