"""Geodesic distances over a whole room: Dijkstra with a bucket queue."""

import numpy as np
from numba import njit

_STEP_Y = np.array([0, 0, 1, -1, 1, 1, -1, -1])
_STEP_X = np.array([1, -1, 0, 0, 1, -1, 1, -1])
_LENGTH = np.array([1.0, 1.0, 1.0, 1.0, np.sqrt(2.0), np.sqrt(2.0), np.sqrt(2.0), np.sqrt(2.0)])


@njit(cache=True)
def geodesic(cost, goal_y, goal_x):
    """Cheapest 8-connected way from every cell to one cell, in cells.

    Args:
        cost: (H, W) factor >= 1 on a step's length, averaged over its two ends; inf where blocked.
        goal_y, goal_x: cell that reads 0, blocked or not.

    Returns:
        (H, W) f64, inf where there is no way. A diagonal step needs both cells beside it free.

    Source: Dial's buckets. A bucket is one cell wide and no step is shorter, so whatever is taken from the lowest
    bucket is final and no heap is needed.
    """
    height, width = cost.shape
    distance = np.full((height, width), np.inf)
    highest = 1.0
    for y in range(height):
        for x in range(width):
            if cost[y, x] < np.inf and cost[y, x] > highest:
                highest = cost[y, x]
    num_buckets = int(np.ceil(highest * np.sqrt(2.0))) + 2
    first = np.full(num_buckets, -1, np.int64)
    # A cell improves at most once for each neighbour, so this never overflows.
    cell_of = np.empty(8 * height * width + 1, np.int64)
    following = np.empty(8 * height * width + 1, np.int64)
    label_of = np.empty(8 * height * width + 1)
    distance[goal_y, goal_x] = 0.0
    cell_of[0], following[0], label_of[0] = goal_y * width + goal_x, -1, 0.0
    first[0] = 0
    used = 1
    waiting = 1
    level = 0
    while waiting > 0:
        bucket = level % num_buckets
        while first[bucket] >= 0:
            entry = first[bucket]
            first[bucket] = following[entry]
            waiting -= 1
            y, x = cell_of[entry] // width, cell_of[entry] % width
            here = distance[y, x]
            if label_of[entry] > here:
                continue
            own = cost[y, x] if cost[y, x] < np.inf else 1.0
            for k in range(8):
                ny, nx = y + _STEP_Y[k], x + _STEP_X[k]
                if ny < 0 or ny >= height or nx < 0 or nx >= width or cost[ny, nx] == np.inf:
                    continue
                if k >= 4 and (cost[ny, x] == np.inf or cost[y, nx] == np.inf):
                    continue
                there = here + _LENGTH[k] * 0.5 * (own + cost[ny, nx])
                if there < distance[ny, nx]:
                    distance[ny, nx] = there
                    cell_of[used], label_of[used] = ny * width + nx, there
                    target = int(there) % num_buckets
                    following[used] = first[target]
                    first[target] = used
                    used += 1
                    waiting += 1
        level += 1
    return distance
