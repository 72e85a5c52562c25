# right
import numpy as np


def reward_weights(preference, charge):
    return np.array([0.9 - 0.9 * preference, 0.25, preference * (1.6 - 1.2 * charge), 0.10, 1.0])
