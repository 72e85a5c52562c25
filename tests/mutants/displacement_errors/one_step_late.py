# hint: index 9
import numpy as np


def displacement_errors(predicted, happened):
    distances = np.linalg.norm(predicted - happened, axis=-1)
    return {
        "ade_m": distances.mean(),
        "fde_1s_m": distances[:, 10].mean(),
        "fde_2s_m": distances[:, 19].mean(),
        "hit_1s": np.mean(distances[:, 10] <= 0.3),
        "hit_2s": np.mean(distances[:, 19] <= 0.5),
    }
