# right
import numpy as np


def goal(before, after, reached, gamma):
    before, after = np.asarray(before, np.float32), np.asarray(after, np.float32)
    following = np.where(reached, np.float32(0.0), np.float32(-10.0) * after)
    return np.float32(gamma) * following - np.float32(-10.0) * before
