# right
import numpy as np


def log_odds(evidence, hits, passes):
    after = evidence.copy()
    after[passes] = np.maximum(after[passes] - 2, -6)
    after[hits] = np.minimum(after[hits] + 4, 20)
    return after
