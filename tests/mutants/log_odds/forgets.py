# hint: do not replace it
import numpy as np


def log_odds(evidence, hits, passes):
    return np.clip(4 * hits - 2 * passes, -6, 20)
