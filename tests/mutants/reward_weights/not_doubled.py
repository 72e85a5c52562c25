# hint: times 2
import numpy as np


def reward_weights(preference, charge):
    return np.array([0.45 * (1 - preference), 0.25, 0.20 * preference * (4 - 3 * charge), 0.10, 1.0])
