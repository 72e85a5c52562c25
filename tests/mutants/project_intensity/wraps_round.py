# hint: leave out what lies beyond
import numpy as np


def project_intensity(scan):
    count = len(scan)
    image = np.zeros((64, 64), np.float32)
    for k in range(count):
        angle = -np.pi + 2 * np.pi * k / count
        row = int(np.floor(32 - 10 * scan[k, 0] * np.cos(angle)))
        column = int(np.floor(32 - 10 * scan[k, 0] * np.sin(angle)))
        if row < 64 and column < 64:
            image[row, column] = max(image[row, column], min(1.0, scan[k, 1]))
    return image
