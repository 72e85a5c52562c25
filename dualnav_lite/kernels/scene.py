"""Moving things into the arrays that beams and hulls meet, once a control step."""

import numpy as np
from numba import njit

from dualnav_lite.kernels.hashing import hash_uniform

_DRAWS = 8  # hashed numbers kept apart for each phantom and life
X, Y, RADIUS, EXPIRES_S, LIVES = range(5)  # columns of a phantom


@njit(cache=True)
def place_movers(
    kinds,
    surface_of_kind,
    active,
    states,
    radii,
    halves,
    num_static,
    phantoms,
    num_phantoms,
    phantom_surface,
    segments,
    segment_surface,
    num_segments,
    circles,
    circle_surface,
    num_circles,
):
    """Write the active movers of each world behind its static lines, and the phantoms behind its people.

    Args:
        kinds, active, states, radii, halves: arrays of `pedestrians.Movers`.
        surface_of_kind: `Surface` of each kind of mover, 0 for none.
        num_static: (n,) static lines of each world.
        phantoms: (n, P, 5) x, y, radius, time of expiry, lives; num_phantoms: (n,) in use.
        phantom_surface: surface code of a phantom.
        segments, segment_surface, num_segments, circles, circle_surface, num_circles: `scene.Scene`, changed in place.
    """
    for i in range(kinds.shape[0]):
        lines, rounds = num_static[i], 0
        for m in range(kinds.shape[1]):
            if not active[i, m]:
                continue
            surface = surface_of_kind[kinds[i, m]]
            if halves[i, m, 0] == 0.0:
                circles[i, rounds, 0], circles[i, rounds, 1] = states[i, m, 0], states[i, m, 1]
                circles[i, rounds, 2] = radii[i, m]
                circle_surface[i, rounds] = surface
                rounds += 1
                continue
            c, s = np.cos(states[i, m, 2]), np.sin(states[i, m, 2])
            for side in range(4):  # counter-clockwise from the right rear corner, as `geometry.box_corners`
                for end in range(2):
                    corner = (side + end) % 4
                    along = halves[i, m, 0] if corner == 1 or corner == 2 else -halves[i, m, 0]
                    across = halves[i, m, 1] if corner >= 2 else -halves[i, m, 1]
                    segments[i, lines, 2 * end] = states[i, m, 0] + c * along - s * across
                    segments[i, lines, 2 * end + 1] = states[i, m, 1] + s * along + c * across
                segment_surface[i, lines] = surface
                lines += 1
        for k in range(num_phantoms[i]):
            circles[i, rounds] = phantoms[i, k, :3]
            circle_surface[i, rounds] = phantom_surface
            rounds += 1
        num_segments[i] = lines
        num_circles[i] = rounds


@njit(cache=True)
def renew_phantoms(phantoms, num_phantoms, poses, times, keys, life, ahead, radius, active):
    """Let expired phantoms appear anew ahead of the robot; they stay where they are in the world while they live.

    Args:
        phantoms: (n, P, 5), changed in place; num_phantoms: (n,) in use.
        poses: (n, 3) true poses; times: (n,) [s]; keys: (n,) uint64.
        life [s], ahead [m], radius [m]: (n, 2) bounds of the draws.
        active: (n,) worlds to renew.
    """
    for i in range(poses.shape[0]):
        if not active[i]:
            continue
        for k in range(num_phantoms[i]):
            if times[i] < phantoms[i, k, EXPIRES_S]:
                continue
            first = (int(phantoms[i, k, LIVES]) * phantoms.shape[1] + k) * _DRAWS
            distance = ahead[i, 0] + (ahead[i, 1] - ahead[i, 0]) * hash_uniform(keys[i], first)
            bearing = poses[i, 2] + (hash_uniform(keys[i], first + 1) - 0.5) * 2.0  # within 57 degrees of ahead
            phantoms[i, k, X] = poses[i, 0] + distance * np.cos(bearing)
            phantoms[i, k, Y] = poses[i, 1] + distance * np.sin(bearing)
            phantoms[i, k, RADIUS] = radius[i, 0] + (radius[i, 1] - radius[i, 0]) * hash_uniform(keys[i], first + 2)
            lasts = life[i, 0] + (life[i, 1] - life[i, 0]) * hash_uniform(keys[i], first + 3)
            phantoms[i, k, EXPIRES_S] = times[i] + lasts
            phantoms[i, k, LIVES] += 1.0


@njit(cache=True)
def read_field(fields, points, resolution, out):
    """Bilinear reading of one field a world, from the finite cells around the point alone.

    Args:
        fields: (n, H, W) values at cell centres; cell [0, 0] has its corner at the origin; inf where undefined.
        points: (n, >= 2) x, y [m].
        resolution: cell size [m].
        out: (n,) out; inf where all four cells are undefined.
    """
    rows, columns = fields.shape[1], fields.shape[2]
    for i in range(fields.shape[0]):
        x, y = points[i, 0] / resolution - 0.5, points[i, 1] / resolution - 0.5
        ix, iy = int(np.floor(x)), int(np.floor(y))
        total = weight = 0.0
        for dy in range(2):
            for dx in range(2):
                cx, cy = ix + dx, iy + dy
                if cx < 0 or cx >= columns or cy < 0 or cy >= rows or fields[i, cy, cx] == np.inf:
                    continue
                share = (1.0 - abs(x - cx)) * (1.0 - abs(y - cy)) + 1e-9
                total += share * fields[i, cy, cx]
                weight += share
        out[i] = total / weight if weight > 0.0 else np.inf
