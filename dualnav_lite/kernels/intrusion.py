"""How far a robot that keeps its twist will drive into where movers will be."""

import math

from numba import njit


@njit(cache=True)
def predicted_intrusion(twists, positions, radii, valid, hull_radius, margin, step_s, out):
    """The worst moment of the horizon: closeness of hulls then, counted less the later it comes.

    Closeness is 1 where the hulls touch, falling evenly to 0 at a gap of `margin`; moment j of `steps` counts
    1 - (j - 1) / steps.

    Args:
        twists: (n, 2) v [m/s], omega [rad/s], kept over the horizon.
        positions: (n, k, steps, 2) future centres of movers [m], robot frame of now, at step_s, 2 step_s, ...
        radii: (n, k) [m].
        valid: (n, k) bool.
        hull_radius, margin: [m].
        step_s: [s].
        out: (n,) in [0, 1], written.
    """
    steps = positions.shape[2]
    for i in range(twists.shape[0]):
        v, omega = twists[i, 0], twists[i, 1]
        worst = 0.0
        for j in range(steps):
            turn = omega * step_s * (j + 1)
            half = 0.5 * turn
            chord = v * step_s * (j + 1) * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
            x, y = chord * math.cos(half), chord * math.sin(half)
            for k in range(positions.shape[1]):
                if not valid[i, k]:
                    continue
                gap = math.hypot(positions[i, k, j, 0] - x, positions[i, k, j, 1] - y) - hull_radius - radii[i, k]
                closeness = min(1.0, 1.0 - gap / margin)
                worst = max(worst, closeness * (1.0 - j / steps))
        out[i] = worst
