# hint: driving backwards costs as much
import numpy as np


def power(v, omega, acceleration):
    return 5.0 + 8.0 * v + 20.0 * v**2 + 6.0 * omega + 4.0 * omega**2 + 15.0 * np.maximum(0.0, v * acceleration)
