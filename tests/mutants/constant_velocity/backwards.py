# hint: do not take it away
import numpy as np


def constant_velocity(positions, velocities):
    times = 0.1 * np.arange(1, 21)
    return positions[:, None] - times[:, None] * velocities[:, None]
