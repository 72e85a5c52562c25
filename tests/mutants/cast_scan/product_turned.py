# hint: look at the order of the cross products
import numpy as np


def cast_scan(pose, bearings, segments, range_max):
    ranges = np.full(len(bearings), range_max)
    for k, bearing in enumerate(bearings):
        dx, dy = np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)
        for x0, y0, x1, y1 in segments:
            ex, ey = x1 - x0, y1 - y0
            ax, ay = x0 - pose[0], y0 - pose[1]
            determinant = dx * ey - dy * ex
            if determinant == 0:
                continue
            t = (ay * ex - ax * ey) / determinant
            u = (ax * dy - ay * dx) / determinant
            if t > 0 and 0 <= u <= 1:
                ranges[k] = min(ranges[k], t)
    return ranges
