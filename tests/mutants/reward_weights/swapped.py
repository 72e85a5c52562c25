# hint: preference 0 is all safety
import numpy as np


def reward_weights(preference, charge):
    return np.array([0.9 * preference, 0.25, 0.4 * (1 - preference) * (4 - 3 * charge), 0.10, 1.0])
