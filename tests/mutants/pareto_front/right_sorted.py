# right
import numpy as np


def pareto_front(safe_dist_m, energy_j):
    points = sorted({(energy, -safe) for safe, energy in zip(safe_dist_m, energy_j, strict=True)})
    kept, best = set(), np.inf
    for energy, unsafe in points:
        if unsafe < best:
            kept.add((energy, unsafe))
            best = unsafe
    return np.array([(energy, -safe) in kept for safe, energy in zip(safe_dist_m, energy_j, strict=True)])
