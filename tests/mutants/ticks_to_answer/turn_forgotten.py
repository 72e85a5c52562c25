# hint: a turn is an answer too
import numpy as np


def ticks_to_answer(driven, twin, seen):
    gap = np.abs(driven - twin)
    differs = (gap[:, 0] > 0.05) | (gap[:, 1] > 9.0)
    steps = np.flatnonzero(differs[seen:])
    return float(steps[0] + 1) if len(steps) else float("nan")
