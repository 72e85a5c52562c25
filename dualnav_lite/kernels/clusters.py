"""Small things in one scan: runs of returns between jumps, how big they are and where their middle is."""

import math

from numba import njit

from dualnav_lite.kernels.scan_noise import path_loss

# Neighbouring returns farther apart belong to different things; people walk 0.2 m apart. [m], and share of range noise.
JUMP = (0.14, 3.0)
MIN_RETURNS = 4
MAX_EXTENT_M = 1.5
MAX_RANGE_M = 6.5
MIN_BRIGHTNESS = 0.33  # of the brightest return; ghosts and reflections are dimmer, cloth has half
MIN_RADIUS_M, USUAL_RADIUS_M, MAX_RADIUS_M = 0.10, 0.27, 0.50


@njit(cache=True)
def segment_scan(scan, noise, clusters):
    """Runs of neighbouring returns without a jump between them, small enough to be a person or a box.

    Args:
        scan: (beams, 2) range [m] and intensity; intensity 0 marks a lost beam.
        noise: standard deviation of the ranges [m].
        clusters: (C, 4) i64, written: first beam, last beam (beyond `beams` where the run passes straight behind),
            whether something nearer hides its right end, and its left end.

    Returns:
        number of clusters, at most C; further ones are dropped.
    """
    beams = scan.shape[0]
    step = 2.0 * math.pi / beams
    jump_square = (JUMP[0] + JUMP[1] * noise) ** 2
    brightest = _brightest(scan)
    start, right_range = _first_start(scan, step, jump_square)
    if start < 0:
        return 0
    found, size, begin, end = 0, 0, start, start
    for k in range(start, start + beams + 1):  # the first return once more, to close the last run
        row = k if k < beams else k - beams
        if scan[row, 1] <= 0.0:
            continue
        far = scan[end if end < beams else end - beams, 0]
        if size == 0 or not _is_jump(far, scan[row, 0], step * (k - end), jump_square):
            size += 1
            end = k
            continue
        near, span = scan[begin if begin < beams else begin - beams, 0], step * (end - begin)
        is_small = size >= MIN_RETURNS and span < math.pi and near < MAX_RANGE_M
        is_small = is_small and _gap_square(near, far, span) < MAX_EXTENT_M * MAX_EXTENT_M
        if is_small and found < clusters.shape[0] and _brightness(scan, begin, end) > MIN_BRIGHTNESS * brightest:
            shift = beams if begin >= beams else 0
            clusters[found, 0], clusters[found, 1] = begin - shift, end - shift
            clusters[found, 2], clusters[found, 3] = right_range < near, scan[row, 0] < far
            found += 1
        right_range, size, begin, end = far, 1, k, k
    return found


@njit(cache=True)
def _gap_square(a, b, turn):
    """Squared distance of two returns at ranges a and b, `turn` apart."""
    return a * a + b * b - 2.0 * a * b * math.cos(turn)


@njit(cache=True)
def _is_jump(a, b, turn, jump_square):
    """Whether neighbouring returns at ranges a and b are farther apart than a jump; cos(turn) to second order."""
    return (a - b) ** 2 + a * b * turn * turn > jump_square


@njit(cache=True)
def _first_start(scan, step, jump_square):
    """The first beam that begins a run and the range of the return before it; -1 where the scan has no jump."""
    beams, before = scan.shape[0], -1
    for k in range(beams):
        if scan[k, 1] > 0.0:
            if before >= 0 and _is_jump(scan[before, 0], scan[k, 0], step * (k - before), jump_square):
                return k, float(scan[before, 0])
            before = k
    return -1, 0.0


@njit(cache=True)
def _brightest(scan):
    """Largest intensity within 5 m, range law taken out: that of a bright wall in the present light."""
    brightest = 0.0
    for k in range(0, scan.shape[0], 3):
        if scan[k, 0] < 5.0:
            brightest = max(brightest, scan[k, 1] * path_loss(scan[k, 0]))
    return brightest


@njit(cache=True)
def _brightness(scan, begin, end):
    """Mean intensity of the middle third of a cluster, range law taken out."""
    beams, third = scan.shape[0], (end - begin) // 3
    total, count = 0.0, 0
    for k in range(begin + third, end - third + 1):
        row = k if k < beams else k - beams
        if scan[row, 1] > 0.0:
            total += scan[row, 1] * path_loss(scan[row, 0])
            count += 1
    return total / max(count, 1)


@njit(cache=True)
def range_noise(scan):
    """Standard deviation of a scan's range noise [m], from how much each return leaves the line of its neighbours."""
    beams, total, count = scan.shape[0], 0.0, 0
    for k in range(2, beams, 5):
        if scan[k - 2, 1] > 0.0 and scan[k - 1, 1] > 0.0 and scan[k, 1] > 0.0:
            bend = abs(scan[k - 2, 0] - 2.0 * scan[k - 1, 0] + scan[k, 0])
            if bend < 0.4:  # else an edge
                total += bend
                count += 1
    return (
        total / max(count, 1) * math.sqrt(math.pi / 12.0)
    )  # mean |bend| of Gaussian noise: sigma sqrt(6) sqrt(2 / pi)


@njit(cache=True)
def _middle_range(scan, begin, end):
    """Mean range of the middle third of the beams begin to end."""
    beams, third = scan.shape[0], (end - begin) // 3
    total, count = 0.0, 0
    for k in range(begin + third, end - third + 1):
        row = k if k < beams else k - beams
        if scan[row, 1] > 0.0:
            total += scan[row, 0]
            count += 1
    return total / count if count > 0 else scan[begin, 0]


@njit(cache=True)
def round_size(scan, begin, end):
    """Radius of a round thing that just fills the beams begin to end."""
    sine = math.sin(min(1.2, math.pi * (end - begin + 1) / scan.shape[0]))
    return min(MAX_RADIUS_M, max(MIN_RADIUS_M, _middle_range(scan, begin, end) * sine / (1.0 - sine)))


@njit(cache=True)
def locate(scan, cluster, radius):
    """Centre of a round thing of known radius, from its visible part.

    An end that nothing hides is a tangent to the circle; each of up to some twenty beams then says how far the centre
    is.

    Args:
        scan: (beams, 2).
        cluster: (4,) as `segment_scan` writes it.
        radius: [m].

    Returns:
        x, y [m], robot frame.
    """
    beams = scan.shape[0]
    step = 2.0 * math.pi / beams
    begin, end, hidden_right, hidden_left = cluster[0], cluster[1], cluster[2], cluster[3]
    distance = _middle_range(scan, begin, end) + radius
    half = math.asin(min(1.0, radius / distance)) / step
    middle = 0.5 * (begin + end)
    if hidden_right and not hidden_left:
        middle = end + 0.5 - half
    elif hidden_left and not hidden_right:
        middle = begin - 0.5 + half
    first = max(begin, math.ceil(middle - 0.75 * half))
    last = min(end, math.floor(middle + 0.75 * half))
    stride = 1 + max(0, last - first) // 20
    sine, cosine = math.sin(step * (first - middle)), math.cos(step * (first - middle))
    turn_s, turn_c = math.sin(step * stride), math.cos(step * stride)
    total, count = 0.0, 0
    for k in range(first, last + 1, stride):
        row = k if k < beams else k - beams
        if scan[row, 1] > 0.0:
            aside = scan[row, 0] * sine
            total += scan[row, 0] * cosine + math.sqrt(max(0.0, radius * radius - aside * aside))
            count += 1
        sine, cosine = sine * turn_c + cosine * turn_s, cosine * turn_c - sine * turn_s
    if count > 0:
        distance = total / count
    bearing = step * middle - math.pi
    return distance * math.cos(bearing), distance * math.sin(bearing)
