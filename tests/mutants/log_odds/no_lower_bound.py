# hint: a free cell needs many hits
import numpy as np


def log_odds(evidence, hits, passes):
    return np.minimum(evidence + 4 * hits - 2 * passes, 20)
