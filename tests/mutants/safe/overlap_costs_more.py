# hint: hulls that overlap count as touching
import numpy as np


def safe(clearance):
    return np.where(np.asarray(clearance) < 0.3, -10.0 * (0.3 - np.asarray(clearance)) ** 2, 0.0)
