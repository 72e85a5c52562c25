# right
import numpy as np


def power(v, omega, acceleration):
    v, omega, gain = np.abs(v), np.abs(omega), np.asarray(v * acceleration)
    return 5.0 + v * (8.0 + 20.0 * v) + omega * (6.0 + 4.0 * omega) + np.where(gain > 0, 15.0 * gain, 0.0)
