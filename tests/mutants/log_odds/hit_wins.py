# hint: a cell that is hit and passed gets both
import numpy as np


def log_odds(evidence, hits, passes):
    return np.clip(evidence + np.where(hits, 4, -2 * passes), -6, 20)
