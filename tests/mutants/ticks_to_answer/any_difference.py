# hint: less is noise
import numpy as np


def ticks_to_answer(driven, twin, seen):
    gap = np.abs(driven - twin)
    differs = (gap[:, 0] > 0.0) | (gap[:, 1] > 0.0)
    steps = np.flatnonzero(differs[seen:])
    return float(steps[0] + 1) if len(steps) else float("nan")
