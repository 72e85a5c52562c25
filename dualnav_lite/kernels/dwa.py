"""The dynamic window approach: the best pair of speeds that the motors can reach in a moment."""

import numpy as np
from numba import njit

from dualnav_lite.kernels.sampling import read_bilinear

# Weights. Those of Fox, Burgard, Thrun (1997), 2.0, 0.2, 0.2, make it stand and stare at the goal through furniture.
HEADING, CLEARANCE, VELOCITY = 1.0, 0.5, 0.5
_HORIZON_S, _STEP_S = 2.0, 0.1
_FAR_M = 1.5  # more free way than this counts alike
_SPEEDS, _TURNS = 9, 21


@njit(cache=True)
def free_arc(v, omega, clearance, grid, keep):
    """Length of the arc at (v, omega) until the robot's middle comes closer than `keep` to a solid [m]."""
    x = y = heading = length = 0.0
    for _ in range(int(_HORIZON_S / _STEP_S)):
        heading += 0.5 * omega * _STEP_S
        x += v * np.cos(heading) * _STEP_S
        y += v * np.sin(heading) * _STEP_S
        heading += 0.5 * omega * _STEP_S
        if read_bilinear(clearance, 0, x, y, grid, 10.0) < keep:
            return length
        length += v * _STEP_S
    return _FAR_M if v > 0.0 else 0.0


@njit(cache=True)
def best_in_window(twist, goal, clearance, grid, keep, limits, window_s):
    """The admissible command with the highest weighted sum of heading, clearance and velocity.

    Args:
        twist: (2,) v, omega now.
        goal: (2,) [m], robot frame.
        clearance: (1, H, W) distance to the nearest solid [m], robot frame.
        grid: (origin x, origin y, cell size) of it [m].
        keep: hull radius and gap [m].
        limits: (4,) v [m/s], omega [rad/s], their rates [m/s2, rad/s2].
        window_s: time in which the command must be reachable.

    Returns:
        (v, omega); where no command is admissible, a stop while turning towards the goal.
    """
    bearing = np.arctan2(goal[1], goal[0])
    low_v, high_v = max(0.0, twist[0] - limits[2] * window_s), min(limits[0], twist[0] + limits[2] * window_s)
    low_w, high_w = max(-limits[1], twist[1] - limits[3] * window_s), min(limits[1], twist[1] + limits[3] * window_s)
    best, best_v, best_w = -np.inf, 0.0, min(max(bearing, low_w), high_w)
    for a in range(_SPEEDS):
        v = low_v + (high_v - low_v) * a / (_SPEEDS - 1)
        for b in range(_TURNS):
            omega = low_w + (high_w - low_w) * b / (_TURNS - 1)
            free = free_arc(v, omega, clearance, grid, keep)
            if v > np.sqrt(2.0 * free * limits[2]):
                continue
            # The heading is judged where the robot would be after the window and a full stop of its turning.
            turned = omega * window_s + 0.5 * omega * abs(omega) / limits[3]
            error = abs((bearing - turned + np.pi) % (2.0 * np.pi) - np.pi)
            score = HEADING * (1.0 - error / np.pi) + CLEARANCE * min(free, _FAR_M) / _FAR_M + VELOCITY * v / limits[0]
            if score > best:
                best, best_v, best_w = score, v, omega
    return best_v, best_w
