# hint: bearings are in radians
import numpy as np


def cast_scan(pose, bearings, segments, range_max):
    ranges = np.full(len(bearings), range_max)
    for k, bearing in enumerate(bearings):
        dx, dy = np.cos(pose[2] + np.radians(bearing)), np.sin(pose[2] + np.radians(bearing))
        for x0, y0, x1, y1 in segments:
            ex, ey = x1 - x0, y1 - y0
            ax, ay = x0 - pose[0], y0 - pose[1]
            determinant = dx * ey - dy * ex
            if determinant == 0:
                continue
            t = (ax * ey - ay * ex) / determinant
            u = (ax * dy - ay * dx) / determinant
            if t > 0 and 0 <= u <= 1:
                ranges[k] = min(ranges[k], t)
    return ranges
