"""Paths of many worlds at once: planned on the rolling map, then followed."""

import numpy as np
from numba import njit

from dualnav_lite.kernels.routing import (
    HARD,
    OPEN_RADIUS_SQUARED,
    SOLID_CODE,
    TIGHT_SQUARED,
    astar,
    clearance_levels,
    corners_of_way,
)

_LOOK_AHEAD = 20  # points of the path in which the robot is looked for, so that it never jumps to a later leg


@njit(cache=True)
def is_line_clear(grid, resolution, x0, y0, x1, y1):
    """Whether every point of a straight line keeps TIGHT clearance from the solid cells of a toroidal map.

    The first and last few cells are not looked at closely, as in `astar`: there only solid cells count.
    """
    size = grid.shape[0]
    reach = int(np.sqrt(TIGHT_SQUARED))
    length = np.hypot(x1 - x0, y1 - y0) / resolution
    samples = int(length) + 1
    spared = np.sqrt(OPEN_RADIUS_SQUARED)
    for k in range(samples + 1):
        share = k / samples
        is_end = share * length < spared or (1.0 - share) * length < spared
        r = 1 if is_end else reach
        limit = 1 if is_end else TIGHT_SQUARED
        cy = int(np.floor((y0 + share * (y1 - y0)) / resolution))
        cx = int(np.floor((x0 + share * (x1 - x0)) / resolution))
        for dy in range(-r, r + 1):
            row = (cy + dy) % size
            for dx in range(-r, r + 1):
                if dy * dy + dx * dx <= limit and grid[row, (cx + dx) % size] >= SOLID_CODE:
                    return False
    return True


@njit(cache=True)
def resample(corners, spacing, path):
    """Fill `path` (P, 2) with points every `spacing` metres along the corners, the last on their end; how many."""
    count = 1
    path[0] = corners[0]
    carried = 0.0  # length since the last point
    for leg in range(corners.shape[0] - 1):
        dx, dy = corners[leg + 1, 0] - corners[leg, 0], corners[leg + 1, 1] - corners[leg, 1]
        length = np.hypot(dx, dy)
        at = spacing - carried
        while at < length and count < path.shape[0] - 1:
            path[count, 0] = corners[leg, 0] + dx * at / length
            path[count, 1] = corners[leg, 1] + dy * at / length
            count += 1
            at += spacing
        carried = length - (at - spacing)
    path[count] = corners[-1]
    return count + 1


@njit(cache=True)
def plan_paths(grids, resolution, poses, goals, due, paths, counts):
    """New paths for the worlds that are due; straight to the goal where that is free or where no way is known.

    Args:
        grids: (n, G, G) u8 map codes, toroidal: world cell (iy, ix) stands at [iy mod G, ix mod G].
        resolution: cell size [m].
        poses: (n, 3) robot, map frame.
        goals: (n, 2) [m], map frame.
        due: (n,) bool.
        paths: (n, P, 2) out, points 0.1 m apart [m], map frame, from the robot to the goal.
        counts: (n,) out, points in use.
    """
    size = grids.shape[1]
    half = size // 2
    cost = np.empty((size, size), np.float32)
    came_from = np.empty((size, size), np.uint8)
    corners_y, corners_x = np.empty(256, np.int64), np.empty(256, np.int64)
    for i in range(poses.shape[0]):
        if not due[i]:
            continue
        x, y, goal_x, goal_y = poses[i, 0], poses[i, 1], goals[i, 0], goals[i, 1]
        # A goal beyond the rolling map is drawn in along the line to it, to a cell where the robot could stand.
        farthest = max(abs(goal_x - x), abs(goal_y - y))
        share = min(1.0, (half - 2) * resolution / max(farthest, 1e-9))
        near_x, near_y = x + share * (goal_x - x), y + share * (goal_y - y)
        ends = np.array([[x, y], [goal_x, goal_y]])
        if is_line_clear(grids[i], resolution, x, y, near_x, near_y):
            counts[i] = resample(ends, resolution, paths[i])
            continue
        origin_y, origin_x = int(np.floor(y / resolution)) - half, int(np.floor(x / resolution)) - half
        levels = clearance_levels(grids[i], origin_y, origin_x)
        gy, gx = int(np.floor(near_y / resolution)) - origin_y, int(np.floor(near_x / resolution)) - origin_x
        while share < 1.0 and levels[gy, gx] >= HARD:
            share -= 2.0 * resolution / farthest
            gy = int(np.floor((y + share * (goal_y - y)) / resolution)) - origin_y
            gx = int(np.floor((x + share * (goal_x - x)) / resolution)) - origin_x
        relaxed = False
        found = astar(levels, half, half, gy, gx, relaxed, cost, came_from)
        if not found:
            relaxed = True
            found = astar(levels, half, half, gy, gx, relaxed, cost, came_from)
        if not found:
            counts[i] = resample(ends, resolution, paths[i])
            continue
        kept = corners_of_way(levels, half, half, gy, gx, relaxed, cost, came_from, corners_y, corners_x)
        corners = np.empty((kept + 1 if share < 1.0 else kept, 2))
        for k in range(kept):
            corners[k, 0] = (corners_x[k] + origin_x + 0.5) * resolution
            corners[k, 1] = (corners_y[k] + origin_y + 0.5) * resolution
        corners[0] = ends[0]
        corners[-1] = ends[1]
        counts[i] = resample(corners, resolution, paths[i])


@njit(cache=True)
def follow_paths(paths, counts, positions, resolution, poses, distance, guides, ahead, lengths):
    """Where the robot is on its path and what lies ahead of it.

    Args:
        paths, counts, resolution: as `plan_paths` filled them.
        positions: (n,) in and out, index of the path point the robot was last nearest to.
        poses: (n, 3) robot, map frame.
        distance: how far ahead along the path the guide point lies [m].
        guides: (n, 2) out [m], robot frame.
        ahead: (n, A, 2) out, path points from the robot on, robot frame, the last repeated.
        lengths: (n,) out, way left to the goal [m].
    """
    for i in range(poses.shape[0]):
        last = counts[i] - 1
        x, y = poses[i, 0], poses[i, 1]
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        nearest, least = positions[i], np.inf
        for k in range(positions[i], min(positions[i] + _LOOK_AHEAD, last) + 1):
            d = (paths[i, k, 0] - x) ** 2 + (paths[i, k, 1] - y) ** 2
            if d < least:
                nearest, least = k, d
        positions[i] = nearest
        end = np.hypot(
            paths[i, last, 0] - paths[i, max(last - 1, 0), 0], paths[i, last, 1] - paths[i, max(last - 1, 0), 1]
        )
        lengths[i] = np.sqrt(least) + max(last - nearest - 1, 0) * resolution + (end if nearest < last else 0.0)
        for k in range(ahead.shape[1]):
            dx, dy = paths[i, min(nearest + k, last), 0] - x, paths[i, min(nearest + k, last), 1] - y
            ahead[i, k, 0], ahead[i, k, 1] = c * dx + s * dy, c * dy - s * dx
        k = min(nearest + int(np.rint(distance / resolution)), last)
        dx, dy = paths[i, k, 0] - x, paths[i, k, 1] - y
        guides[i, 0], guides[i, 1] = c * dx + s * dy, c * dy - s * dx
