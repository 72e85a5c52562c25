# right
import numpy as np


def wilson_interval(successes, trials):
    z, rate = 1.959964, np.divide(successes, trials)
    half = z * np.sqrt(rate * (1 - rate) / trials + (z / trials) ** 2 / 4)
    return np.stack([rate + z**2 / (2 * trials) + sign * half for sign in (-1, 1)]) / (1 + z**2 / trials)
