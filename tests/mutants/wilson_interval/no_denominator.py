# hint: 1 + z^2 / n
import numpy as np


def wilson_interval(successes, trials):
    rate, z, n = successes / trials, 1.959964, trials
    centre = (rate + z * z / (2.0 * n)) / (1.0 + 0.0)
    half = z * np.sqrt(rate * (1.0 - rate) / n + z * z / (4.0 * n * n)) / (1.0 + 0.0)
    return centre - half, centre + half
