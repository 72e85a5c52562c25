# right
import numpy as np


def displacement_errors(predicted, happened):
    off = np.moveaxis(np.asarray(predicted) - np.asarray(happened), -1, 0)
    distances = np.hypot(*off)
    second, end = distances[:, 9], distances[:, -1]
    hits = {"hit_1s": (second < 0.3).sum() / len(second), "hit_2s": (end < 0.5).sum() / len(end)}
    return hits | {"ade_m": distances.sum() / distances.size, "fde_1s_m": second.mean(), "fde_2s_m": end.mean()}
