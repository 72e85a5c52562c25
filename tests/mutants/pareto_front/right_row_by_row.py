# right
import numpy as np


def pareto_front(safe_dist_m, energy_j):
    front = []
    for safe, energy in zip(safe_dist_m, energy_j, strict=True):
        no_worse = (safe_dist_m >= safe) & (energy_j <= energy)
        better = (safe_dist_m > safe) | (energy_j < energy)
        front.append(not (no_worse & better).any())
    return np.array(front)
