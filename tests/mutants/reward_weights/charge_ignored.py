# hint: grows as the battery empties
import numpy as np


def reward_weights(preference, charge):
    return np.array([0.9 * (1 - preference), 0.25, 0.4 * preference, 0.10, 1.0])
