# right
import numpy as np


def safe(clearance):
    distance = np.maximum(clearance, 0.0)
    return np.where(distance < 0.3, -10.0 * (distance * distance - 0.6 * distance + 0.09), 0.0)
