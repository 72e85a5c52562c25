# hint: within 0.3 m at 1 s and within 0.5 m at 2 s
import numpy as np


def displacement_errors(predicted, happened):
    distances = np.linalg.norm(predicted - happened, axis=-1)
    return {
        "ade_m": distances.mean(),
        "fde_1s_m": distances[:, 9].mean(),
        "fde_2s_m": distances[:, 19].mean(),
        "hit_1s": np.mean(distances[:, 9] <= 0.5),
        "hit_2s": np.mean(distances[:, 19] <= 0.5),
    }
