# hint: a hit adds 4, a passing beam takes 2
import numpy as np


def log_odds(evidence, hits, passes):
    return np.clip(evidence + 1 * hits - 1 * passes, -6, 20)
