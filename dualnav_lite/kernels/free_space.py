"""Whether an earlier scan looked through a place: what stands there now has moved in."""

import math

from numba import njit

FREE_MARGIN_M = 0.15  # the three beams around a place must have gone this much farther


@njit(cache=True)
def sees_free(ranges, pose, x, y):
    """Whether a past scan saw through a point: 1 yes, 0 no, -1 where it cannot tell.

    Args:
        ranges: (beams,) [m], 0 for a lost beam.
        pose: (3,) of that scan; x, y: the point, same frame.
    """
    beams = ranges.shape[0]
    dx, dy = x - pose[0], y - pose[1]
    distance = math.hypot(dx, dy)
    place = (math.atan2(dy, dx) - pose[2] + math.pi) / (2.0 * math.pi) * beams
    middle = round(place)
    seen = False
    for k in range(middle - 1, middle + 2):
        r = ranges[k % beams]
        if r > 0.0:
            seen = True
            if r < distance + FREE_MARGIN_M:
                return 0
    return 1 if seen else -1


@njit(cache=True)
def was_free(scan, cluster, pose, past_ranges, past_pose):
    """Share of a cluster's returns that end where a past scan saw free space; some six returns are asked.

    Args:
        scan: (beams, 2), cluster: (4,) as in `clusters.segment_scan`; pose: (3,) of the scan.
        past_ranges: (beams,) [m], 0 for a lost beam; past_pose: (3,) of that scan, same frame as `pose`.
    """
    beams = scan.shape[0]
    step = 2.0 * math.pi / beams
    begin, end = cluster[0], cluster[1]
    stride = max(1, (end - begin) // 6)
    free, told = 0, 0
    for k in range(begin + stride // 2, end + 1, stride):
        if scan[k % beams, 1] <= 0.0:
            continue
        r, bearing = scan[k % beams, 0], pose[2] - math.pi + step * k
        x, y = pose[0] + r * math.cos(bearing), pose[1] + r * math.sin(bearing)
        answer = sees_free(past_ranges, past_pose, x, y)
        if answer >= 0:
            told += 1
            free += answer
    return free / told if told > 0 else 0.0
