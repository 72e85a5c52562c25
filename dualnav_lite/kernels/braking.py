"""What the hull sweeps in one more control step and the braking after it, against the points of a scan."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.scan_noise import path_loss

MOVES_M_S = 0.02  # slower than this the hull does not sweep anything: it turns on the spot
BESIDE, LEAST = 3, 3  # beams to either side that are asked too; returns among them that can make a hit
FAINT = 0.08  # returns this faint, counted back to 1 m, are no surface; even at 5 lux one that is faces away
TURNS_RAD_S = 0.3  # faster than this a command finds another heading by itself
CLOSER_M = 1e-6  # a hull that is too close already may move as long as no step takes it closer than by rounding


@njit(cache=True)
def points_within(scan, cosines, sines, reach, range_max, points):
    """Number of hits of a scan (beams, 2) closer than `reach` [m], written to `points` (beams, 2), robot frame.

    A hit is the median of what neighbouring beams return: the nearest of hundreds of noisy readings lies far before the
    surface, at 5 lux by 10 cm. A return too faint for its range to be a surface is none: a ghost or a reflection.
    """
    beams, count, near = scan.shape[0], 0, np.empty(2 * BESIDE + 1)
    for k in range(beams):
        if scan[k, 0] >= min(reach, range_max):
            continue
        found = 0
        for j in range(k - BESIDE, k + BESIDE + 1):
            distance = scan[j % beams, 0]
            if distance < range_max and scan[j % beams, 1] * path_loss(distance) >= FAINT:
                near[found] = distance
                found += 1
        if found < LEAST:
            continue
        distance = np.median(near[:found])
        if distance < reach:
            points[count, 0], points[count, 1] = distance * cosines[k], distance * sines[k]
            count += 1
    return count


@njit(cache=True)
def _nearest(points, count, x, y):
    """Square of the distance from (x, y) to the nearest of the first `count` points."""
    least = np.inf
    for k in range(count):
        dx, dy = points[k, 0] - x, points[k, 1] - y
        least = min(least, dx * dx + dy * dy)
    return least


@njit(cache=True)
def is_braking_safe(points, count, twist_v, twist_omega, v, omega, max_acc, max_ang_acc, control_dt, dt, hull):
    """Whether the robot can take a command for one control step, then brake to a stand, and touch no point.

    Args:
        points, count: hits around, robot frame [m].
        twist_v, twist_omega: present [m/s], [rad/s].
        v, omega: the command.
        max_acc, max_ang_acc: [m/s2], [rad/s2].
        control_dt, dt: length of the command and of an integration step [s].
        hull: radius and margin [m].
    """
    x = y = heading = time = 0.0
    before = math.sqrt(_nearest(points, count, x, y))
    while time < control_dt - 1e-9 or abs(twist_v) > MOVES_M_S:
        is_braking = time >= control_dt - 1e-9
        target_v, target_omega = (0.0, 0.0) if is_braking else (v, omega)
        twist_v += min(max(target_v - twist_v, -max_acc * dt), max_acc * dt)
        twist_omega += min(max(target_omega - twist_omega, -max_ang_acc * dt), max_ang_acc * dt)
        middle = heading + 0.5 * dt * twist_omega
        x += dt * twist_v * math.cos(middle)
        y += dt * twist_v * math.sin(middle)
        heading += dt * twist_omega
        time += dt
        gap = math.sqrt(_nearest(points, count, x, y))
        if gap < hull and abs(twist_v) > MOVES_M_S and gap < before - CLOSER_M:
            return False
        before = gap
    return True


@njit(cache=True)
def _turned(points, count, angle, turned):
    """Write the points as a robot turned by `angle` [rad] sees them."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(count):
        turned[k, 0], turned[k, 1] = c * points[k, 0] + s * points[k, 1], c * points[k, 1] - s * points[k, 0]


@njit(cache=True)
def safe_commands(
    commands, scans, twists, cosines, sines, range_max, shares, turns, max_acc, max_ang_acc, max_omega, control_dt, dt,
    hull, out
):  # fmt: skip
    """The largest of the shares by which each command's speed may be taken, its turn kept.

    Where none is, the robot brakes; and where it stands already and was told to go nearly straight on, it turns on the
    spot to the nearest heading from which it could go: without that a driver who sees less sharply waits for ever.

    Args:
        commands, twists: (n, 2) v [m/s], omega [rad/s].
        scans: (n, beams, 2) ranges [m] and intensities; intensity 0 marks a lost beam.
        cosines, sines: (beams,) of the bearings; range_max: reading of nothing [m].
        shares: (k,) falling from 1 to 0; turns: (j,) [rad] headings that are looked at, the nearest first.
        max_acc, max_ang_acc, control_dt, dt, hull: as in `is_braking_safe`; max_omega: [rad/s].
        out: (n, 2) written.
    """
    points, turned = np.empty((scans.shape[1], 2)), np.empty((scans.shape[1], 2))
    for i in range(commands.shape[0]):
        v, omega = commands[i, 0], commands[i, 1]
        top = max(abs(v), abs(twists[i, 0]))
        reach = hull + top * (2.0 * control_dt + top / max_acc) + 0.05
        count = points_within(scans[i], cosines, sines, reach, range_max, points)
        out[i, 0], out[i, 1] = 0.0, omega
        for share in shares:
            if count == 0 or is_braking_safe(
                points, count, twists[i, 0], twists[i, 1], share * v, omega, max_acc, max_ang_acc, control_dt, dt, hull
            ):
                out[i, 0] = share * v
                break
        if (
            abs(out[i, 0]) > MOVES_M_S
            or abs(twists[i, 0]) > MOVES_M_S
            or abs(v) <= MOVES_M_S
            or abs(omega) > TURNS_RAD_S
        ):
            continue
        for angle in turns:
            _turned(points, count, angle, turned)
            if is_braking_safe(turned, count, 0.0, 0.0, v, 0.0, max_acc, max_ang_acc, control_dt, dt, hull):
                out[i, 1] = math.copysign(max_omega, angle)
                break
