"""RRT*: a random tree over free cells whose branches are rewired until the way to the goal is short."""

import numpy as np
from numba import njit

from dualnav_lite.kernels.hashing import hash_uniform
from dualnav_lite.kernels.routing import HARD, OPEN_RADIUS_SQUARED, SOLID

GOAL_SHARE = 0.05  # of the samples
STEP_CELLS = 8.0
NEAR_CELLS = 12.0  # new nodes look this far for a better parent, and for nodes to rewire


@njit(cache=True)
def is_way_free(levels, x0, y0, x1, y1, start, goal):
    """Whether a straight line between two points [cells] keeps its margin; near start and goal only solids count."""
    samples = int(2.0 * np.hypot(x1 - x0, y1 - y0)) + 1
    for k in range(samples + 1):
        x, y = x0 + (x1 - x0) * k / samples, y0 + (y1 - y0) * k / samples
        ix, iy = int(np.floor(x)), int(np.floor(y))
        if ix < 0 or iy < 0 or ix >= levels.shape[1] or iy >= levels.shape[0]:
            return False
        near = min((x - start[0]) ** 2 + (y - start[1]) ** 2, (x - goal[0]) ** 2 + (y - goal[1]) ** 2)
        if levels[iy, ix] >= (SOLID if near <= OPEN_RADIUS_SQUARED else HARD):
            return False
    return True


@njit(cache=True)
def rrt_star(levels, start, goal, key, samples, corners):
    """A way from start to goal through a window of `routing.clearance_levels`.

    Args:
        levels: (G, G) u8.
        start, goal: (2,) x, y [cells] inside the window.
        key: uint64 of the random stream; the same key draws the same tree.
        samples: draws after which the tree is done.
        corners: (C, 2) out, the way's corners from start to goal [cells].

    Returns:
        Number of corners, 0 where no way was found.

    Source: Karaman, Frazzoli (IJRR 30, 2011), algorithm 6, with a fixed radius of neighbourhood.
    """
    size = levels.shape[0]
    nodes = np.empty((samples + 1, 2))
    parent = np.full(samples + 1, -1, np.int64)
    cost = np.zeros(samples + 1)
    nodes[0] = start
    count = 1
    for k in range(samples):
        if hash_uniform(key, 3 * k) < GOAL_SHARE:
            x, y = goal[0], goal[1]
        else:
            x, y = size * hash_uniform(key, 3 * k + 1), size * hash_uniform(key, 3 * k + 2)
        nearest, least = 0, np.inf
        for n in range(count):
            d = (nodes[n, 0] - x) ** 2 + (nodes[n, 1] - y) ** 2
            if d < least:
                nearest, least = n, d
        if least < 1e-12:
            continue
        share = min(1.0, STEP_CELLS / np.sqrt(least))
        x, y = nodes[nearest, 0] + share * (x - nodes[nearest, 0]), nodes[nearest, 1] + share * (y - nodes[nearest, 1])
        if not is_way_free(levels, nodes[nearest, 0], nodes[nearest, 1], x, y, start, goal):
            continue
        best, best_cost = nearest, cost[nearest] + np.hypot(x - nodes[nearest, 0], y - nodes[nearest, 1])
        for n in range(count):
            d = np.hypot(nodes[n, 0] - x, nodes[n, 1] - y)
            if d >= NEAR_CELLS or cost[n] + d >= best_cost - 1e-9:
                continue
            if is_way_free(levels, nodes[n, 0], nodes[n, 1], x, y, start, goal):
                best, best_cost = n, cost[n] + d
        new = count
        nodes[new, 0], nodes[new, 1], parent[new], cost[new] = x, y, best, best_cost
        count += 1
        for n in range(1, new):
            d = np.hypot(nodes[n, 0] - x, nodes[n, 1] - y)
            if d >= NEAR_CELLS or best_cost + d >= cost[n] - 1e-9:
                continue
            if is_way_free(levels, x, y, nodes[n, 0], nodes[n, 1], start, goal):
                _hang(n, new, best_cost + d, parent, cost, count)
    return _way_to(goal, levels, start, nodes, parent, cost, count, corners)


@njit(cache=True)
def _hang(node, new_parent, new_cost, parent, cost, count):
    """Give a node another parent and lower the cost of everything below it."""
    gain = cost[node] - new_cost
    parent[node] = new_parent
    cost[node] = new_cost
    for n in range(1, count):
        up = parent[n]
        while up > 0 and up != node:
            up = parent[up]
        if up == node:
            cost[n] -= gain


@njit(cache=True)
def _way_to(goal, levels, start, nodes, parent, cost, count, corners):
    """Corners of the cheapest way to the goal through the tree; their number, 0 where there is none."""
    last, best = -1, np.inf
    for n in range(count):
        d = np.hypot(nodes[n, 0] - goal[0], nodes[n, 1] - goal[1])
        if d >= NEAR_CELLS or cost[n] + d >= best:
            continue
        if is_way_free(levels, nodes[n, 0], nodes[n, 1], goal[0], goal[1], start, goal):
            last, best = n, cost[n] + d
    if last < 0:
        return 0
    depth, n = 2, last
    while parent[n] >= 0:
        n = parent[n]
        depth += 1
    if depth > corners.shape[0]:
        return 0
    corners[depth - 1, 0], corners[depth - 1, 1] = goal[0], goal[1]
    n = last
    for row in range(depth - 2, -1, -1):
        corners[row] = nodes[n]
        n = parent[n]
    return depth
