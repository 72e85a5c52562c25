# hint: it pays for staying near the goal
import numpy as np


def goal(before, after, reached, gamma):
    return 3.0 * np.exp(-after / 5.0)
