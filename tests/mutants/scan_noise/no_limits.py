# hint: a reading stays in
import numpy as np


def scan_noise(ranges, intensities, ambient_lux, normal, uniform):
    q = min(max(1.0 - np.log10(ambient_lux) / np.log10(300.0), 0.0), 1.0)
    readings = ranges + (0.01 + 0.042 * q) * normal
    gone = uniform < 0.005 + 0.20 * q
    return np.stack([np.where(gone, 10.0, readings), np.where(gone, 0.0, (1.0 - 0.557 * q) * intensities)], axis=1)
