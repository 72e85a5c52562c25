# hint: ten numbers in ten bands
import numpy as np


def paint_bands(ego):
    return np.full((64, 64), ego.battery)
