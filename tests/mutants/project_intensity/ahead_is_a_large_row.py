# hint: heading up
import numpy as np


def project_intensity(scan):
    ranges, intensities = np.asarray(scan, float).T
    angles = -np.pi + 2.0 * np.pi * np.arange(len(ranges)) / len(ranges)
    rows = np.floor(32 + 10 * ranges * np.cos(angles)).astype(int)
    columns = np.floor(32 - 10 * ranges * np.sin(angles)).astype(int)
    inside = (rows >= 0) & (rows < 64) & (columns >= 0) & (columns < 64)
    image = np.zeros((64, 64))
    np.maximum.at(image, (rows[inside], columns[inside]), np.clip(intensities[inside], 0, 1))
    return image
