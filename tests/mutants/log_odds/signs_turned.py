# hint: the signs
import numpy as np


def log_odds(evidence, hits, passes):
    return np.clip(evidence - 4 * hits + 2 * passes, -6, 20)
