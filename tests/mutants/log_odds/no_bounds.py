# hint: a cell that was once sure
import numpy as np


def log_odds(evidence, hits, passes):
    return evidence + 4 * hits - 2 * passes
