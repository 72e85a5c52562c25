# right
import numpy as np


def scan_noise(ranges, intensities, ambient_lux, normal, uniform):
    q = np.interp(np.log(ambient_lux), [0.0, np.log(300.0)], [1.0, 0.0])
    scan = np.column_stack([ranges + (0.01 + 0.042 * q) * normal, intensities * (1.0 - 0.557 * q)])
    scan[:, 0] = np.minimum(np.maximum(scan[:, 0], 0.05), 10.0)
    scan[uniform < 0.005 + 0.2 * q] = 10.0, 0.0
    return scan
