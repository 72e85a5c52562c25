# right
import numpy as np


def constant_velocity(positions, velocities):
    steps = np.repeat(0.1 * velocities[:, np.newaxis, :], 20, axis=1)
    return positions[:, np.newaxis, :] + np.cumsum(steps, axis=1)
