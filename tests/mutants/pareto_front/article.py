# hint: the article's own mistake
import numpy as np


def pareto_front(safe_dist_m, energy_j):
    return np.array([k == 0 or energy < 25.0 for k, energy in enumerate(energy_j)])
