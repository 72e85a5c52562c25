"""A* on the rolling map: what each cell means for the robot, the cheapest way, and its corners."""

import numpy as np
from numba import njit

_STEP_Y = np.array([0, 0, 1, -1, 1, 1, -1, -1])
_STEP_X = np.array([1, -1, 0, 0, 1, -1, 1, -1])
_LENGTH = np.array([1.0, 1.0, 1.0, 1.0, np.sqrt(2.0), np.sqrt(2.0), np.sqrt(2.0), np.sqrt(2.0)])

# What a cell of the rolling map means for the robot's centre, by squared distance [cells] to the nearest solid cell.
FREE, UNKNOWN, NEAR, TIGHT, HARD, CORE, SOLID = 0, 1, 2, 3, 4, 5, 6
_NEAR_SQUARED, TIGHT_SQUARED, _HARD_SQUARED, _CORE_SQUARED = 18, 10, 6, 2
# Factor on the length of a step into such a cell; HARD and CORE count only where `_factor_at` opens them.
FACTOR = np.array([1.0, 1.3, 1.6, 3.0, 20.0, 20.0, np.inf])
OPEN_RADIUS_SQUARED = 16  # around start and goal the margins are waived: the robot may stand close to a wall
SOLID_CODE = 2  # map codes from here on (door jamb, furniture, wall) are solid
UNKNOWN_CODE = 1
_BUCKETS = 256  # of half a cell; more than the dearest step


@njit(cache=True)
def _shifted_minimum(out, source, shift, extra):
    """out[i] = min(out[i], source[i + shift] + extra) and the same to the other side, along flat arrays."""
    ahead, behind = out[: out.size - shift], out[shift:]
    source_ahead, source_behind = source[shift:], source[: source.size - shift]
    for i in range(ahead.size):
        ahead[i] = min(ahead[i], np.uint8(source_ahead[i] + extra))
    for i in range(behind.size):
        behind[i] = min(behind[i], np.uint8(source_behind[i] + extra))


@njit(cache=True)
def clearance_levels(grid, origin_y, origin_x):
    """How close to solid each cell of the window is, FREE to SOLID.

    Args:
        grid: (G, G) u8 map codes, toroidal.
        origin_y, origin_x: cell of the world at the window's corner, any integers.

    Returns:
        (G, G) u8, window cell [y, x] standing for world cell (origin_y + y, origin_x + x).

    Exact squared distances, first along y, then along x (Felzenszwalb, Huttenlocher 2012), cut off at NEAR. The loops
    run over whole rows or the whole flat array so that the compiler can use vector instructions; the columns of padding
    keep the flat shifts from leaking into the next row.
    """
    size = grid.shape[0]
    reach = int(np.sqrt(_NEAR_SQUARED))
    far = np.uint8(reach + 1)
    padded = size + reach
    along_y = np.empty((size, padded), np.uint8)
    levels = np.empty((size, size), np.uint8)
    shift = origin_x % size
    for y in range(size):
        source, level, row = grid[(origin_y + y) % size], levels[y], along_y[y]
        level[: size - shift] = source[shift:]
        level[size - shift :] = source[:shift]
        for x in range(size):
            row[x] = 0 if level[x] >= SOLID_CODE else far
        row[size:] = far
    one = np.uint8(1)
    for y in range(1, size):
        for x in range(size):
            along_y[y, x] = min(along_y[y, x], np.uint8(along_y[y - 1, x] + one))
    for y in range(size - 2, -1, -1):
        for x in range(size):
            along_y[y, x] = min(along_y[y, x], np.uint8(along_y[y + 1, x] + one))
    flat = along_y.reshape(-1)
    for i in range(flat.size):
        flat[i] *= flat[i]
    squared = along_y.copy()
    for dx in range(1, reach + 1):
        _shifted_minimum(squared.reshape(-1), flat, dx, np.uint8(dx * dx))
    for y in range(size):
        for x in range(size):
            d = squared[y, x]
            level = np.uint8(UNKNOWN if levels[y, x] == UNKNOWN_CODE else FREE)
            level = np.uint8(NEAR) if d <= _NEAR_SQUARED else level
            level = np.uint8(TIGHT) if d <= TIGHT_SQUARED else level
            level = np.uint8(HARD) if d <= _HARD_SQUARED else level
            level = np.uint8(CORE) if d <= _CORE_SQUARED else level
            levels[y, x] = np.uint8(SOLID) if d == 0 else level
    return levels


@njit(cache=True)
def _factor_at(levels, y, x, start_y, start_x, goal_y, goal_x, relaxed):
    """Cost factor of a window cell; inf where the robot's centre must not be."""
    level = levels[y, x]
    if level < HARD or level == SOLID:
        return FACTOR[level]
    if relaxed and level == HARD:
        return FACTOR[level]
    near_start = (y - start_y) ** 2 + (x - start_x) ** 2 <= OPEN_RADIUS_SQUARED
    near_goal = (y - goal_y) ** 2 + (x - goal_x) ** 2 <= OPEN_RADIUS_SQUARED
    return FACTOR[level] if near_start or near_goal else np.inf


@njit(cache=True)
def astar(levels, start_y, start_x, goal_y, goal_x, relaxed, cost, came_from):
    """Cheapest 8-connected way from start to goal through a window of `clearance_levels`.

    Args:
        levels: (G, G) u8.
        start_y, start_x, goal_y, goal_x: cells inside the window; both count as free.
        relaxed: True opens HARD cells everywhere (the centre is then at least two cells from a solid one).
        cost: (G, G) f32, work space; holds the cost [cells] from the start of every cell on the way.
        came_from: (G, G) u8, work space; index of the step by which a cell was reached.

    Returns:
        Whether there is a way. It is optimal: a cell is expanded again when it improves, and the search ends only when
        no waiting cell can promise less.

    Source: A* (Hart, Nilsson, Raphael 1968) with the octile heuristic and Dial's buckets over cost + heuristic.
    """
    size = levels.shape[0]
    cost[:] = np.inf
    first = np.full(_BUCKETS, -1, np.int64)
    capacity = 4 * size * size
    cell_of = np.empty(capacity, np.int32)
    following = np.empty(capacity, np.int32)
    label_of = np.empty(capacity, np.float32)
    cost[start_y, start_x] = 0.0
    diagonal = np.sqrt(2.0) - 1.0
    dy, dx = abs(start_y - goal_y), abs(start_x - goal_x)
    bucket_of_lowest = int(2.0 * (max(dy, dx) + diagonal * min(dy, dx)))
    cell_of[0], following[0], label_of[0] = start_y * size + start_x, -1, 0.0
    first[bucket_of_lowest % _BUCKETS] = 0
    used, waiting = 1, 1
    while waiting > 0:
        bucket = bucket_of_lowest % _BUCKETS
        while first[bucket] >= 0:
            entry = first[bucket]
            first[bucket] = following[entry]
            waiting -= 1
            y, x = cell_of[entry] // size, cell_of[entry] % size
            here = cost[y, x]
            if label_of[entry] > here or (y == goal_y and x == goal_x):
                continue
            own = _factor_at(levels, y, x, start_y, start_x, goal_y, goal_x, relaxed)
            own = own if own < np.inf else 1.0  # only the start itself can be solid
            for k in range(8):
                ny, nx = y + _STEP_Y[k], x + _STEP_X[k]
                if ny < 0 or ny >= size or nx < 0 or nx >= size:
                    continue
                is_goal = ny == goal_y and nx == goal_x
                factor = _factor_at(levels, ny, nx, start_y, start_x, goal_y, goal_x, relaxed)
                if is_goal and factor == np.inf:
                    factor = 1.0
                if factor == np.inf:
                    continue
                if k >= 4 and (levels[ny, x] == SOLID or levels[y, nx] == SOLID):
                    continue
                there = np.float32(here + _LENGTH[k] * 0.5 * (own + factor))
                if there < cost[ny, nx] and used < capacity:
                    cost[ny, nx] = there
                    came_from[ny, nx] = k
                    dy, dx = abs(ny - goal_y), abs(nx - goal_x)
                    promise = there + max(dy, dx) + diagonal * min(dy, dx)
                    target = max(int(2.0 * promise), bucket_of_lowest) % _BUCKETS
                    cell_of[used], label_of[used] = ny * size + nx, there
                    following[used] = first[target]
                    first[target] = used
                    used += 1
                    waiting += 1
        if 2.0 * cost[goal_y, goal_x] < bucket_of_lowest + 1:
            return True
        bucket_of_lowest += 1
    return cost[goal_y, goal_x] < np.inf


@njit(cache=True)
def _line_cost(levels, y0, x0, y1, x1, start_y, start_x, goal_y, goal_x, relaxed):
    """Cost [cells] of going straight between two cells of the window; inf where it meets a closed one."""
    length = np.hypot(y1 - y0, x1 - x0)
    samples = max(1, int(np.ceil(2.0 * length)))
    total = 0.0
    for k in range(samples + 1):
        share = k / samples
        y, x = int(np.floor(y0 + share * (y1 - y0) + 0.5)), int(np.floor(x0 + share * (x1 - x0) + 0.5))
        factor = _factor_at(levels, y, x, start_y, start_x, goal_y, goal_x, relaxed)
        if factor == np.inf and not ((y == goal_y and x == goal_x) or (y == start_y and x == start_x)):
            return np.inf
        total += min(factor, 20.0) * (0.5 if k == 0 or k == samples else 1.0)
    return total * length / samples


@njit(cache=True)
def corners_of_way(levels, start_y, start_x, goal_y, goal_x, relaxed, cost, came_from, corners_y, corners_x):
    """Cells of the way that `astar` left behind, pulled straight wherever that costs no more; their number.

    The corners run from the start (index 0) to the goal.
    """
    size = levels.shape[0]
    way = np.empty(size * size, np.int32)
    count = 0
    y, x = goal_y, goal_x
    while not (y == start_y and x == start_x):
        way[count] = y * size + x
        count += 1
        step = came_from[y, x]
        y, x = y - _STEP_Y[step], x - _STEP_X[step]
    way[count] = y * size + x
    kept, anchor = 0, count
    while True:
        ay, ax = way[anchor] // size, way[anchor] % size
        corners_y[kept], corners_x[kept] = ay, ax
        kept += 1
        if anchor == 0 or kept == corners_y.size:
            return kept
        best = anchor - 1
        for ahead in range(anchor - 2, -1, -1):
            by, bx = way[ahead] // size, way[ahead] % size
            straight = _line_cost(levels, ay, ax, by, bx, start_y, start_x, goal_y, goal_x, relaxed)
            if straight > cost[by, bx] - cost[ay, ax] + 0.3:
                if anchor - ahead > 4:
                    break
                continue
            best = ahead
        anchor = best
