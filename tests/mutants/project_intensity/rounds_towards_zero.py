# hint: round down
import numpy as np


def project_intensity(scan):
    count = len(scan)
    image = np.zeros((64, 64), np.float32)
    for k in range(count):
        angle = -np.pi + 2 * np.pi * k / count
        row = int(32 - 10 * scan[k, 0] * np.cos(angle))
        column = int(32 - 10 * scan[k, 0] * np.sin(angle))
        if 0 <= row < 64 and 0 <= column < 64:
            image[row, column] = max(image[row, column], min(1.0, scan[k, 1]))
    return image
