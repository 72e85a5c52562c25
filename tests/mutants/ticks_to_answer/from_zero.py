# hint: is tick 1, not 0
import numpy as np


def ticks_to_answer(driven, twin, seen):
    gap = np.abs(driven - twin)
    differs = (gap[:, 0] > 0.05) | (gap[:, 1] > 0.1)
    steps = np.flatnonzero(differs[seen:])
    return float(steps[0]) if len(steps) else float("nan")
