"""Distance along every beam of a lidar turn to the first surface it meets."""

import math

import numpy as np
from numba import njit

# Inside the kernel a beam keeps its nearness, 1 / range. Along a wall at perpendicular distance h with unit normal
# (nx, ny) the nearness of the beam (c, s) is (c nx + s ny) / h: no division and no trigonometry per beam, and the
# nearest surface is the one with the largest nearness. A surface is tried only on the beams between the bearings of
# its two ends. Surfaces are numbered as they are laid, from 1; `met` holds the number of the nearest, 0 for nothing.
# For the angle of incidence each leaves a row of `facets`: normal x, normal y and curvature. The normal of a circle is
# its centre over its radius, so that cos(incidence) = beam . normal - range * curvature serves both.


@njit(cache=True)
def _lay_line(nearness, met, cos_table, sin_table, first, last, ux, uy, number):
    """Keep the larger nearness on beams `first` to `last` for the line whose normal over distance is (ux, uy)."""
    beams = len(nearness)
    for start, stop in ((first, min(last + 1, beams)), (0, max(last + 1 - beams, 0))):  # up to the seam and beyond
        near, who = nearness[start:stop], met[start:stop]
        cosines, sines = cos_table[start:stop], sin_table[start:stop]
        for k in range(len(near)):  # no branch, so several beams are done at a time
            candidate = cosines[k] * ux + sines[k] * uy
            is_nearer = candidate > near[k]
            near[k] = candidate if is_nearer else near[k]
            who[k] = number if is_nearer else who[k]


@njit(cache=True)
def _lay_circle(nearness, met, cos_table, sin_table, first, last, x, y, radius, number):
    """Keep the larger nearness on beams `first` to `last` for a circle around (x, y) that does not hold the robot.

    The near root t of |t d - q| = r has 1 / t = (d.q + sqrt(r^2 - (d x q)^2)) / (q^2 - r^2), by Vieta.
    """
    beams = len(nearness)
    scale = 1.0 / (x * x + y * y - radius * radius)
    for start, stop in ((first, min(last + 1, beams)), (0, max(last + 1 - beams, 0))):
        near, who = nearness[start:stop], met[start:stop]
        cosines, sines = cos_table[start:stop], sin_table[start:stop]
        for k in range(len(near)):
            aside = cosines[k] * y - sines[k] * x
            half_chord = math.sqrt(max(radius * radius - aside * aside, 0.0))
            candidate = (cosines[k] * x + sines[k] * y + half_chord) * scale
            is_nearer = candidate > near[k]
            near[k] = candidate if is_nearer else near[k]
            who[k] = number if is_nearer else who[k]


@njit(cache=True)
def _beams_between(right, left, beams):
    """First and last beam from bearing `right` counter-clockwise to `left`, both included; none if last < first.

    0 <= first < beams; `last` runs on past the seam straight behind. Two surfaces that share a corner share its bearing
    bit for bit, so ceil and floor leave no beam between them.
    """
    per_radian = beams / (2.0 * math.pi)
    start, stop = (right + math.pi) * per_radian, (left + math.pi) * per_radian
    if start - stop > 0.5 * beams:  # the span crosses the seam; a smaller excess is rounding on a tiny span
        stop += beams
    first, last = math.ceil(start), math.floor(stop)
    if first >= beams:
        first, last = first - beams, last - beams
    return first, last


@njit(cache=True)
def _lay_segments(nearness, met, facets, kind, pose, segments, surfaces, count, range_max, cos_table, sin_table):
    """Lay the front faces of one world's first `count` segments; returns how many there were."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    number = 0
    for j in range(count):
        dx, dy = segments[j, 0] - pose[0], segments[j, 1] - pose[1]
        ax, ay = c * dx + s * dy, c * dy - s * dx
        dx, dy = segments[j, 2] - pose[0], segments[j, 3] - pose[1]
        bx, by = c * dx + s * dy, c * dy - s * dx
        ex, ey = bx - ax, by - ay
        area, length = ay * bx - ax * by, math.sqrt(ex * ex + ey * ey)  # of the parallelogram; positive in front
        if area <= 0.0 or area >= range_max * length:
            continue
        number += 1
        first, last = _beams_between(math.atan2(by, bx), math.atan2(ay, ax), len(nearness))
        _lay_line(nearness, met, cos_table, sin_table, first, last, -ey / area, ex / area, number)
        facets[number, 0], facets[number, 1], facets[number, 2] = -ey / length, ex / length, 0.0
        kind[number] = surfaces[j]
    return number


@njit(cache=True)
def _lay_circles(nearness, met, facets, kind, pose, circles, surfaces, count, range_max, cos_table, sin_table, number):
    """Lay one world's first `count` circles, but those the robot is in, numbered on from `number`."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for j in range(count):
        dx, dy, radius = circles[j, 0] - pose[0], circles[j, 1] - pose[1], circles[j, 2]
        x, y = c * dx + s * dy, c * dy - s * dx
        tangent2 = x * x + y * y - radius * radius
        if tangent2 <= 0.0 or tangent2 >= range_max * (range_max + 2.0 * radius):
            continue
        number += 1
        tangent = math.sqrt(tangent2)  # length of the tangents, which bound the span
        right = math.atan2(y * tangent - x * radius, x * tangent + y * radius)
        left = math.atan2(y * tangent + x * radius, x * tangent - y * radius)
        first, last = _beams_between(right, left, len(nearness))
        _lay_circle(nearness, met, cos_table, sin_table, first, last, x, y, radius, number)
        facets[number, 0], facets[number, 1], facets[number, 2] = x / radius, y / radius, 1.0 / radius
        kind[number] = surfaces[j]


@njit(cache=True)
def cast_scans(
    poses,
    segments,
    segment_surface,
    num_segments,
    circles,
    circle_surface,
    num_circles,
    range_max,
    cos_table,
    sin_table,
    ranges,
    surfaces,
    incidence,
):
    """Fill in what each beam of n worlds meets first.

    Beam k points at -pi + 2 pi k / beams, counter-clockwise from straight ahead. Only front faces are met: a segment
    from its right side, a circle from outside; a segment seen exactly edge-on is not met.

    Args:
        poses: (n, 3) true x [m], y [m], heading [rad], world frame.
        segments, segment_surface, num_segments: (n, S, 4), (n, S), (n,), see `scene.Scene`.
        circles, circle_surface, num_circles: (n, C, 3), (n, C), (n,), likewise.
        range_max: reading of a beam that meets nothing nearer [m].
        cos_table, sin_table: (beams,) of the bearings.
        ranges: (n, beams) out, [m] in (0, range_max].
        surfaces: (n, beams) out, u8 `Surface` code, 0 where nothing is met.
        incidence: (n, beams) out, cosine between beam and surface normal, 0 where nothing is met.

    Source: line in normal form, circle by the quadratic formula; `cast_scan_reference` states both the plain way.
    """
    beams = len(cos_table)
    most = segments.shape[1] + circles.shape[1] + 1
    met = np.empty(beams, np.int64)  # as wide as a float, so that both are compared several at a time
    facets, kind = np.zeros((most, 3)), np.zeros(most, np.uint8)
    for i in range(len(poses)):
        nearness = ranges[i]
        nearness[:] = 1.0 / range_max
        met[:] = 0
        turn = (range_max, cos_table, sin_table)
        laid = (nearness, met, facets, kind, poses[i])
        number = _lay_segments(*laid, segments[i], segment_surface[i], num_segments[i], *turn)
        _lay_circles(*laid, circles[i], circle_surface[i], num_circles[i], *turn, number)
        for k in range(beams):
            facet = facets[met[k]]
            distance = 1.0 / nearness[k] if met[k] > 0 else range_max
            ranges[i, k] = distance
            surfaces[i, k] = kind[met[k]]
            incidence[i, k] = cos_table[k] * facet[0] + sin_table[k] * facet[1] - distance * facet[2]


def cast_scan_reference(pose, segments, segment_surface, circles, circle_surface, range_max, beams):
    """The same for one world, the plain way: every beam against every primitive, in the world frame.

    Args:
        pose: (3,); segments: (S, 4); circles: (C, 3), rows in use only; surfaces: (S,), (C,).

    Returns:
        ranges (beams,), surfaces (beams,), incidence (beams,) as `cast_scans` fills them.

    Source: Cramer's rule for the segments, the quadratic formula for the circles.
    """
    bearings = -np.pi + 2 * np.pi * np.arange(beams) / beams
    ranges = np.full(beams, float(range_max))
    surfaces, incidence = np.zeros(beams, np.uint8), np.zeros(beams)
    for k, bearing in enumerate(bearings):
        dx, dy = np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)
        for (x0, y0, x1, y1), surface in zip(segments, segment_surface, strict=True):
            ex, ey = x1 - x0, y1 - y0
            determinant = dy * ex - dx * ey  # positive where the beam enters the solid on the left
            if determinant <= 0:
                continue
            ax, ay = x0 - pose[0], y0 - pose[1]
            along_beam = (ay * ex - ax * ey) / determinant
            along_wall = (ay * dx - ax * dy) / determinant
            if 0 <= along_wall <= 1 and 0 < along_beam < ranges[k]:
                ranges[k], surfaces[k] = along_beam, surface
                incidence[k] = determinant / np.hypot(ex, ey)
        for (x, y, radius), surface in zip(circles, circle_surface, strict=True):
            qx, qy = x - pose[0], y - pose[1]
            ahead = dx * qx + dy * qy
            discriminant = ahead**2 - (qx**2 + qy**2 - radius**2)
            if discriminant < 0 or qx**2 + qy**2 <= radius**2:
                continue
            near = ahead - np.sqrt(discriminant)
            if 0 < near < ranges[k]:
                ranges[k], surfaces[k] = near, surface
                incidence[k] = np.sqrt(discriminant) / radius
    return ranges, surfaces, incidence
