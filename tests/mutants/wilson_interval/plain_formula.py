# hint: the plain formula
import numpy as np


def wilson_interval(successes, trials):
    rate = successes / trials
    half = 1.959964 * np.sqrt(rate * (1.0 - rate) / trials)
    return rate - half, rate + half
