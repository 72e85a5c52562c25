"""How far a car must drive to stand on a spot with a heading: it cannot turn on the spot, so the beeline says little.

The robot's reward measures its way along free space; this is the same for a car on an empty place, forwards and
backwards, with a least turning circle. Solved once, in the goal's frame, by value iteration over place and heading.
"""

from functools import cache

import numpy as np

CIRCLE_M = 6.0  # least turning radius; highway-env's car can do 5.6 m at full lock
CELL_M, HALF_CELLS, HEADINGS = 0.75, 48, 24
SWEEPS = 60
CLOSE_M, CLOSE_RAD = 1.6, 0.6  # within these the way is read off directly: nearer than a cell


def _shifted(values, dx: float, dy: float):
    """`values` (rows of x, columns of y) read dx, dy cells further on, linearly between cells; edges go on."""
    ix, iy = int(np.floor(dx)), int(np.floor(dy))
    fx, fy, reach = dx - ix, dy - iy, 4
    padded = np.pad(values, reach, mode="edge")

    def part(i, j):
        n, m = values.shape
        return padded[reach + i : reach + i + n, reach + j : reach + j + m]

    low = (1.0 - fx) * part(ix, iy) + fx * part(ix + 1, iy)
    high = (1.0 - fx) * part(ix, iy + 1) + fx * part(ix + 1, iy + 1)
    return (1.0 - fy) * low + fy * high


@cache
def way_table() -> np.ndarray:
    """(97, 97, 24) metres to drive from place x, y and heading to the origin with heading 0.

    V = min over the six arcs of their length + V where they lead, from above, read linearly between cells; cells
    close to the goal hold distance and 2 m a radian.
    """
    axis = CELL_M * np.arange(-HALF_CELLS, HALF_CELLS + 1)
    angles = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
    error = np.abs((angles + np.pi) % (2.0 * np.pi) - np.pi)
    distance = np.hypot(axis[:, None], axis[None, :])[..., None]
    ways = distance + 3.0 * np.pi * CIRCLE_M * np.ones(HEADINGS)
    ways = np.where((distance < CLOSE_M) & (error < CLOSE_RAD), distance + 2.0 * error, ways)
    turn = 2.0 * np.pi / HEADINGS
    arc = CIRCLE_M * turn  # as long for straight on
    for _ in range(SWEEPS):
        before = ways.copy()
        for k, angle in enumerate(angles):
            for steps in (-1, 0, 1):
                middle = angle + 0.5 * steps * turn
                chord = arc * (np.sinc(0.5 * turn / np.pi) if steps else 1.0)
                for way in (1.0, -1.0):
                    # Backwards along an arc, the heading turns the other way.
                    bearing = angle + 0.5 * way * steps * turn if steps else middle
                    dx, dy = way * chord * np.cos(bearing), way * chord * np.sin(bearing)
                    there = before[..., int(k + way * steps) % HEADINGS]
                    ways[..., k] = np.minimum(ways[..., k], arc + _shifted(there, dx / CELL_M, dy / CELL_M))
        if np.abs(ways - before).max() < 1e-3:
            break
    return ways


def car_way(place, heading: float) -> float:
    """Metres to drive from a place (2,) [m] with a heading [rad], both seen from the goal, read between cells.

    Beyond the table's 36 m the beeline to its edge comes on top.
    """
    table = way_table()
    cells = np.asarray(place, float) / CELL_M + HALF_CELLS
    inside = np.clip(cells, 0.0, 2.0 * HALF_CELLS - 1e-9)
    turn = (heading / (2.0 * np.pi) * HEADINGS) % HEADINGS
    (x, y), k = inside.astype(int), int(turn)
    fx, fy, fk = inside[0] - x, inside[1] - y, turn - k
    near = table[x : x + 2, y : y + 2][:, :, [k % HEADINGS, (k + 1) % HEADINGS]]
    near = (1.0 - fx) * near[0] + fx * near[1]
    near = (1.0 - fy) * near[0] + fy * near[1]
    return float((1.0 - fk) * near[0] + fk * near[1] + CELL_M * np.hypot(*(cells - inside)))
