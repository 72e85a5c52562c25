# hint: mover, step, x and y
import numpy as np


def constant_velocity(positions, velocities):
    times = 0.1 * np.arange(1, 21)
    return positions + times[:, None, None] * velocities
