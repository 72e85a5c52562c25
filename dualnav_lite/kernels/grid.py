"""A semantic occupancy grid that rolls along with the robot: scrolling, carving free space, marking hits."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.scan_noise import path_loss

# The grid is toroidal: the cell that holds (x, y) of the map frame is [floor(y / res) mod G, floor(x / res) mod G], so
# nothing moves in memory while the robot drives. A window's `corner` is floor(x / res), floor(y / res) of its lowest
# cell; each cell of the array stands for the one place inside the window that maps to it. Inner loops see a grid as one
# long row: a flat index is quicker, and so is copying.

# Cell codes as in `semantics.Cell` and `Surface.PERSON`; kernels import nothing above them (a test compares).
FREE, UNKNOWN, DOOR, FURNITURE, WALL = 0, 1, 2, 3, 4
PERSON_LABEL = 4
CELL_OF_LABEL = np.array([FURNITURE, WALL, DOOR, FURNITURE, FURNITURE, FURNITURE, FURNITURE, FURNITURE], np.uint8)

# A hit adds evidence, a beam that passes takes some away. From unknown a cell is occupied after two scans, from surely
# free after three; a surely occupied one is free again after eight beams.
HIT, PASS, LEAST, OCCUPIED, MOST = 4, 2, -6, 6, 20
MOST_VOTES = 8
TURNS = 3  # a scan carves and marks with every third beam, in turn: neighbours see the same cells
CARVE_SPACING = 2.0  # [cells] between carving beams, at most, until there are no more of them
WEAK = 0.06  # returns this faint, counted back to 1 m, are taken for ghosts


@njit(cache=True)
def copy_grid(source, target):
    """Copy one (G, G) grid; a plain loop over the long row is eight times as fast as `target[:] = source` here."""
    size = source.size
    flat_source, flat_target = source.reshape(size), target.reshape(size)
    for k in range(size):
        flat_target[k] = flat_source[k]


@njit(cache=True)
def window_corner(pose, size, resolution):
    """Lowest cell (x, y) of a window of size x size cells with the robot's cell at its middle."""
    return math.floor(pose[0] / resolution) - size // 2, math.floor(pose[1] / resolution) - size // 2


@njit(cache=True)
def move_window(grid, blank, corner, pose, resolution):
    """Blank the cells of one grid that leave when its window moves from `corner` to around a pose."""
    size = len(grid)
    x, y = window_corner(pose, size, resolution)
    for k in range(min(abs(x - corner[0]), size)):
        column = (corner[0] + k if x > corner[0] else corner[0] - 1 - k) % size
        for row in range(size):
            grid[row, column] = blank
    for k in range(min(abs(y - corner[1]), size)):
        row = (corner[1] + k if y > corner[1] else corner[1] - 1 - k) % size
        for column in range(size):
            grid[row, column] = blank


@njit(cache=True)
def hit_cells(corner, size, pose, scan, first, every, cos_table, sin_table, resolution, range_max):
    """Flat index of the cell that beams first, first + every, ... hit, (ceil((beams - first) / every),) i32.

    It is -1 for a lost beam, outside the window, and for a return fainter than any surface would send from there.
    """
    found = np.empty((len(cos_table) - first + every - 1) // every, np.int32)
    c, s = math.cos(pose[2]) / resolution, math.sin(pose[2]) / resolution
    gx, gy = pose[0] / resolution - corner[0], pose[1] / resolution - corner[1]
    left, low = corner[0] % size, corner[1] % size
    for j in range(len(found)):
        k = first + j * every
        distance = scan[k, 0]
        x = gx + distance * (cos_table[k] * c - sin_table[k] * s)
        y = gy + distance * (cos_table[k] * s + sin_table[k] * c)
        inside = (x >= 0.0) & (y >= 0.0) & (x < size) & (y < size)
        believed = (distance < range_max) & (scan[k, 1] * path_loss(distance) >= WEAK)
        column, row = int(x) + left, int(y) + low
        column = column - size if column >= size else column
        row = row - size if row >= size else row
        found[j] = row * size + column if inside & believed else -1
    return found


@njit(cache=True)
def carve_scan(cells, evidence, corner, size, pose, scan, step, cos_table, sin_table, resolution, range_max):
    """Take evidence from the cells that every TURNS-th beam passes, up to a cell before its hit.

    Near the robot beams lie closer than cells, so only every eighth ray starts at the robot; the others start where
    the rays inside are CARVE_SPACING apart. Both choices go round with the step. `cells` and `evidence` are flat.
    """
    beams = len(cos_table)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    gx, gy = pose[0] / resolution - corner[0], pose[1] / resolution - corner[1]
    left, low = corner[0] % size, corner[1] % size
    farthest = CARVE_SPACING * beams / (TURNS * 2.0 * math.pi)  # [cells] where the rays are that far apart
    for k in range(step % TURNS, beams, TURNS):
        distance = scan[k, 0]
        if distance >= range_max:
            continue
        ray = (k + step) // TURNS
        start = farthest / 2 if ray & 1 else farthest / 4 if ray & 2 else farthest / 8 if ray & 4 else 0.0
        dx, dy = cos_table[k] * c - sin_table[k] * s, cos_table[k] * s + sin_table[k] * c
        major = max(abs(dx), abs(dy))  # a step of the walk is one cell along the longer axis
        first, last = int(start * major), min(int((distance / resolution - 1.0) * major), size // 2 - 1)
        dx, dy = dx / major, dy / major
        x, y = gx + left + first * dx, gy + low + first * dy
        for _ in range(first, last + 1):
            column, row = int(x), int(y)
            x, y = x + dx, y + dy
            column = column - size if column >= size else column
            row = row - size if row >= size else row
            at = np.uint64(row * size + column)  # unsigned: no check for an index from the end
            if evidence[at] > LEAST:
                evidence[at] = max(evidence[at] - PASS, LEAST)
                if evidence[at] < OCCUPIED:
                    cells[at] = FREE


@njit(cache=True)
def mark_hits(cells, evidence, votes, found, labels):
    """Add evidence and a vote for its label to the cells hit; beams side by side in one cell count once.

    A person's hits take evidence away instead: whoever stands there leaves again. The label of a cell is the majority
    among its hits; `votes` holds 16 x label + lead. The grids are flat, `found` is from `hit_cells`.

    Source: Boyer and Moore, MJRTY (1981): a like vote adds to the lead, another takes away, at zero the newcomer wins.
    """
    before = -1
    for k in range(len(found)):
        if found[k] < 0 or found[k] == before:
            continue
        before = found[k]
        at, label = np.uint64(found[k]), labels[k]
        if label == PERSON_LABEL:
            evidence[at] = max(evidence[at] - PASS, LEAST)
            continue
        evidence[at] = min(evidence[at] + HIT, MOST)
        winner, lead = votes[at] >> 4, votes[at] & 15
        if winner == label:
            lead = min(lead + 1, MOST_VOTES)
        elif lead == 0:
            winner, lead = label, 1
        else:
            lead -= 1
        votes[at] = winner << 4 | lead
        if evidence[at] >= OCCUPIED:
            cells[at] = CELL_OF_LABEL[winner]


@njit(cache=True)
def update_maps(
    cells, evidence, votes, corners, poses, scans, labels, step, active, cos_table, sin_table, resolution, range_max
):
    """Bring the maps of n worlds up to the present scan.

    Args:
        cells: (n, G, G) u8 cell codes, changed in place.
        evidence: (n, G, G) i8, votes: (n, G, G) u8, likewise.
        corners: (n, 2) i64 lowest cell of each window, x then y, likewise.
        poses: (n, 3) believed poses, map frame.
        scans: (n, beams, 2) f32, labels: (n, beams) u8.
        step: (n,) i64; which beams carve goes round with it.
        active: (n,) bool, the others stay as they are.
        cos_table, sin_table: (beams,) of the bearings.
        resolution: side of a cell [m].
        range_max: reading of a lost beam [m].
    """
    size = cells.shape[1]
    for i in range(len(poses)):
        if not active[i]:
            continue
        move_window(cells[i], UNKNOWN, corners[i], poses[i], resolution)
        move_window(evidence[i], 0, corners[i], poses[i], resolution)
        move_window(votes[i], 0, corners[i], poses[i], resolution)
        corners[i] = window_corner(poses[i], size, resolution)
        flat_cells, flat_evidence = cells[i].reshape(size * size), evidence[i].reshape(size * size)
        view = (corners[i], size, poses[i], scans[i])
        beams = (cos_table, sin_table, resolution, range_max)
        carve_scan(flat_cells, flat_evidence, *view, step[i], *beams)
        first = step[i] % TURNS
        found = hit_cells(*view, first, TURNS, *beams)
        mark_hits(flat_cells, flat_evidence, votes[i].reshape(size * size), found, labels[i, first::TURNS])
