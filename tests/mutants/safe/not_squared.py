# hint: square the missing distance
import numpy as np


def safe(clearance):
    return -10.0 * np.clip(0.3 - np.asarray(clearance, float), 0.0, 0.3)
