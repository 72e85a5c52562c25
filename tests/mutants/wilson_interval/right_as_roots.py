# right
import numpy as np


def wilson_interval(successes, trials):
    k, n, z2 = np.asarray(successes, float), np.asarray(trials, float), 1.959964**2
    a, b, c = n + z2, -(2.0 * k + z2), k * k / n
    root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    return (-b - root) / (2.0 * a), (-b + root) / (2.0 * a)
