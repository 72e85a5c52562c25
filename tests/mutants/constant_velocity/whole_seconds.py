# hint: a step is 0.1 s
import numpy as np


def constant_velocity(positions, velocities):
    times = np.arange(1, 21)
    return positions[:, None] + times[:, None] * velocities[:, None]
