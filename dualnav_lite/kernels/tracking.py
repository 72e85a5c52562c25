"""Scan clusters followed through time: which of them move, and how fast, in the map frame."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.clusters import USUAL_RADIUS_M, locate, range_noise, round_size, segment_scan
from dualnav_lite.kernels.free_space import sees_free, was_free

# Columns of a track. Position and velocity share one covariance for both axes.
X, Y, VX, VY, P_POS, P_CROSS, P_VEL, RADIUS, AGE, HITS, MISSES, EVIDENCE, MOVING, WALKED = range(14)
COLUMNS = 14

ACCELERATION_NOISE = 0.15  # [m2/s3] spectral density
CENTRE_NOISE = (0.003, 0.4, 0.003)  # standard deviation of a centre: floor [m], share of the range noise, and per metre
SIGNIFICANT = 2.0  # standard deviations
FIRST_SPEED_M_S = 1.0  # standard deviation of a new track's velocity
FAR_M, STEADY_M, STEADY_RADIUS_M = 0.45, 0.10, 0.38
CAME_LAGS, LEFT_LAGS = (3, 8), (4, 9)  # scans back that are asked whether a place was free, and is free now
YOUNG_AGE = 12  # scans
EVIDENCE_YOUNG, EVIDENCE_OLD, EVIDENCE_MOST = 1.0, 2.0, 5.0  # what has long stood still must show more
START_SPEED_M_S, STOP_SPEED_M_S = 0.25, 0.12
WALKER_SCANS = 10  # what has moved for so many scans is kept in mind when it stands: it may walk on at any moment
MIN_HITS = 3
MAX_MISSES = 8.0
GONE_MISSES = 4.0  # what a scan counts that sees the track's place free
GATE_M, GATE_SIGMAS, MAX_GATE_M = 0.20, 3.0, 0.6


@njit(cache=True)
def _centre_noise(distance, noise):
    """Standard deviation of a cluster's centre [m]; grown from measured errors of round things."""
    return CENTRE_NOISE[0] + CENTRE_NOISE[1] * noise + CENTRE_NOISE[2] * distance


@njit(cache=True)
def _predict(track, dt):
    """Move a track on by constant velocity (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2)."""
    track[AGE] += 1.0
    track[X] += dt * track[VX]
    track[Y] += dt * track[VY]
    q = ACCELERATION_NOISE
    track[P_POS] += dt * (2.0 * track[P_CROSS] + dt * track[P_VEL]) + q * dt**3 / 3.0
    track[P_CROSS] += dt * track[P_VEL] + q * dt**2 / 2.0
    track[P_VEL] += q * dt


@njit(cache=True)
def _correct(track, x, y, variance):
    """Kalman update by a measured position; both axes share the covariance."""
    gain_pos = track[P_POS] / (track[P_POS] + variance)
    gain_vel = track[P_CROSS] / (track[P_POS] + variance)
    miss_x, miss_y = x - track[X], y - track[Y]
    track[X] += gain_pos * miss_x
    track[Y] += gain_pos * miss_y
    track[VX] += gain_vel * miss_x
    track[VY] += gain_vel * miss_y
    track[P_VEL] -= gain_vel * track[P_CROSS]
    track[P_CROSS] *= 1.0 - gain_pos
    track[P_POS] *= 1.0 - gain_pos


@njit(cache=True)
def _has_moved(track, scan, cluster, pose, dt, ranges, poses, places, turn, count):
    """Whether one of three things shows that a matched track moves, beyond its estimated speed.

    Static things get a speed too, as their visible part changes while the robot passes. But they do not stand where a
    past scan saw free space, do not leave a place that is now seen free, and never get far with an end in plain view.
    """
    depth = ranges.shape[0]
    for lag in CAME_LAGS:
        past = (turn - lag) % depth
        if lag < count and was_free(scan, cluster, pose, ranges[past], poses[past]) >= 0.5:
            return True
    for lag in LEFT_LAGS:
        past = (turn - lag) % depth
        if lag < track[AGE]:
            x, y = places[past, 0], places[past, 1]
            dx, dy = poses[past, 0] - x, poses[past, 1] - y
            share = min(1.0, places[past, 2] / max(1e-6, math.hypot(dx, dy)))  # of the way from its middle to its front
            if sees_free(ranges[turn], pose, x + share * dx, y + share * dy) == 1:
                return True
            seconds = lag * dt
            off = math.hypot(track[X] - x - seconds * track[VX], track[Y] - y - seconds * track[VY])
            is_steady = off < STEADY_M and math.hypot(track[X] - x, track[Y] - y) > FAR_M
            if is_steady and track[RADIUS] < STEADY_RADIUS_M and cluster[2] + cluster[3] < 2:
                return True
    return False


@njit(cache=True)
def _judge_motion(track, has_moved):
    """Update a matched track's evidence of motion and its verdict."""
    if has_moved:
        track[EVIDENCE] = min(EVIDENCE_MOST, track[EVIDENCE] + 1.0)
    else:
        track[EVIDENCE] = max(0.0, track[EVIDENCE] - 0.5)
    needed = EVIDENCE_YOUNG if track[AGE] <= YOUNG_AGE else EVIDENCE_OLD
    if track[MOVING] > 0.0:
        needed = 0.5
    track[MOVING] = 1.0 if track[EVIDENCE] >= needed else 0.0


@njit(cache=True)
def _is_fast(track):
    """Whether a track's speed is worth asking for evidence: well above its noise, or not yet stopped."""
    speed = math.hypot(track[VX], track[VY])
    if track[MOVING] > 0.0:
        return speed > STOP_SPEED_M_S
    return track[HITS] >= MIN_HITS and speed > max(START_SPEED_M_S, SIGNIFICANT * math.sqrt(track[P_VEL]))


@njit(cache=True)
def match_nearest(tracks, centres, owner, match):
    """Pair tracks with clusters inside the tracks' gates, the relatively closest pair first.

    Args:
        tracks: (T, COLUMNS); an age of 0 marks a free row.
        centres: (m, 2) of the clusters [m], same frame.
        owner: (m,) i64 out: track of each cluster, -1 for none; match: (T,) i64 out: the reverse.
    """
    owner[:] = -1
    match[:] = -1
    pairs = np.empty((256, 3))
    count = 0
    for t in range(tracks.shape[0]):
        if tracks[t, AGE] == 0.0:
            continue
        gate = min(MAX_GATE_M, GATE_M + GATE_SIGMAS * math.sqrt(tracks[t, P_POS]))
        for m in range(centres.shape[0]):
            dx, dy = centres[m, 0] - tracks[t, X], centres[m, 1] - tracks[t, Y]
            share = (dx * dx + dy * dy) / (gate * gate)
            if share < 1.0 and count < pairs.shape[0]:
                pairs[count, 0], pairs[count, 1], pairs[count, 2] = share, t, m
                count += 1
    while True:
        best, chosen = 1.0, -1
        for row in range(count):
            if pairs[row, 0] < best and match[int(pairs[row, 1])] < 0 and owner[int(pairs[row, 2])] < 0:
                best, chosen = pairs[row, 0], row
        if chosen < 0:
            return
        t, m = int(pairs[chosen, 1]), int(pairs[chosen, 2])
        match[t], owner[m] = m, t


@njit(cache=True)
def _miss(track, ranges, pose):
    """Count a scan without a match; forget the track when it is young, long unseen, or seen to be gone."""
    is_gone = sees_free(ranges, pose, track[X], track[Y]) == 1
    track[MISSES] += GONE_MISSES if is_gone else 1.0
    if track[MISSES] >= MAX_MISSES or track[HITS] < MIN_HITS:
        track[:] = 0.0


@njit(cache=True)
def _hit(track, scan, cluster, size, pose, noise):
    """Correct a track by its cluster, placed with the track's own radius."""
    hidden = cluster[2] + cluster[3]
    if hidden == 0:
        track[RADIUS] += 0.2 * (size - track[RADIUS])
    x, y = locate(scan, cluster, track[RADIUS])
    sigma = _centre_noise(math.hypot(x, y), noise) * (1.0 + hidden * hidden)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    _correct(track, pose[0] + c * x - s * y, pose[1] + s * x + c * y, sigma * sigma)
    track[HITS] += 1.0
    track[MISSES] = 0.0


@njit(cache=True)
def _begin(tracks, t, centre, size, pose, noise):
    """Start a track in the first free row from t on; returns the row, or the number of rows if none is free."""
    while t < tracks.shape[0] and tracks[t, AGE] > 0.0:
        t += 1
    if t < tracks.shape[0]:
        track = tracks[t]
        track[:] = 0.0
        track[X], track[Y] = centre[0], centre[1]
        track[P_POS] = _centre_noise(math.hypot(centre[0] - pose[0], centre[1] - pose[1]), noise) ** 2
        track[P_VEL] = FIRST_SPEED_M_S**2
        track[RADIUS] = size
        track[AGE] = track[HITS] = 1.0
    return t


@njit(cache=True)
def _step_world(scan, pose, dt, tracks, places, ranges, poses, count):
    """Advance the tracks of one world by one scan; changes `tracks`, `places`, `ranges`, `poses`."""
    turn = count % ranges.shape[0]
    for k in range(scan.shape[0]):
        ranges[turn, k] = scan[k, 0] if scan[k, 1] > 0.0 else np.float32(0.0)
    poses[turn] = pose
    noise = range_noise(scan)
    clusters = np.empty((64, 4), np.int64)
    found = segment_scan(scan, noise, clusters)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    centres, sizes = np.empty((found, 2)), np.empty(found)
    for m in range(found):
        is_whole = clusters[m, 2] + clusters[m, 3] == 0
        sizes[m] = round_size(scan, clusters[m, 0], clusters[m, 1]) if is_whole else USUAL_RADIUS_M
        x, y = locate(scan, clusters[m], sizes[m])
        centres[m, 0], centres[m, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
    for t in range(tracks.shape[0]):
        if tracks[t, AGE] > 0.0:
            _predict(tracks[t], dt)
    owner, match = np.empty(found, np.int64), np.empty(tracks.shape[0], np.int64)
    match_nearest(tracks, centres, owner, match)
    for t in range(tracks.shape[0]):
        track, m = tracks[t], match[t]
        if track[AGE] > 0.0 and m < 0:
            _miss(track, ranges[turn], pose)
        elif track[AGE] > 0.0:
            _hit(track, scan, clusters[m], sizes[m], pose, noise)
            if _is_fast(track):
                _judge_motion(
                    track, _has_moved(track, scan, clusters[m], pose, dt, ranges, poses, places[t], turn, count + 1)
                )
            else:
                track[MOVING], track[EVIDENCE] = 0.0, max(0.0, track[EVIDENCE] - 0.5)
            track[WALKED] += track[MOVING]
    row = 0
    for m in range(found):
        if owner[m] < 0 and row < tracks.shape[0]:
            row = _begin(tracks, row, centres[m], sizes[m], pose, noise)
    for t in range(tracks.shape[0]):
        if tracks[t, AGE] > 0.0:
            places[t, turn, 0], places[t, turn, 1], places[t, turn, 2] = tracks[t, X], tracks[t, Y], tracks[t, RADIUS]


@njit(cache=True)
def step_tracks(scans, poses, active, dt, tracks, places, past_ranges, past_poses, counts):
    """Advance the tracks of n worlds by one scan each.

    Args:
        scans: (n, beams, 2) range [m] and intensity.
        poses: (n, 3) believed poses, map frame.
        active: (n,) bool; other worlds stay as they are.
        dt: time between scans [s].
        tracks: (n, T, COLUMNS), changed; an age of 0 marks a free row.
        places: (n, T, L, 3) x, y and radius of each track at the last L scans, changed.
        past_ranges: (n, L, beams) f32, past_poses (n, L, 3), changed: the last L scans, 0 for a lost beam.
        counts: (n,) scans since the reset, changed.
    """
    for i in range(scans.shape[0]):
        if active[i]:
            _step_world(scans[i], poses[i], dt, tracks[i], places[i], past_ranges[i], past_poses[i], counts[i])
            counts[i] += 1


@njit(cache=True)
def nearest_movers(tracks, poses, positions, velocities, radii, ages, valid, rows):
    """The nearest tracks of each world that move or have walked before, nearest first, seen from the robot.

    Args:
        tracks: (n, T, COLUMNS); poses: (n, 3).
        positions: (n, K, 2) out [m], robot frame; velocities (n, K, 2) out [m/s] over ground, robot-frame axes;
        radii (n, K) out [m]; ages (n, K) i64 out [scans]; valid (n, K) out. Unused rows are zero.
        rows: (n, K) i64 out: each mover's row of `tracks`, -1 where there is none.
    """
    limit = positions.shape[1]
    for i in range(tracks.shape[0]):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        taken = np.zeros(tracks.shape[1], np.bool_)
        for row in range(limit):
            nearest, best = -1, np.inf
            for t in range(tracks.shape[1]):
                is_mover = tracks[i, t, MOVING] > 0.0 or tracks[i, t, WALKED] >= WALKER_SCANS
                if is_mover and tracks[i, t, MISSES] < GONE_MISSES and not taken[t]:
                    distance = math.hypot(tracks[i, t, X] - poses[i, 0], tracks[i, t, Y] - poses[i, 1])
                    if distance < best:
                        nearest, best = t, distance
            valid[i, row] = nearest >= 0
            rows[i, row] = nearest
            if nearest < 0:
                positions[i, row] = velocities[i, row] = 0.0
                radii[i, row] = 0.0
                ages[i, row] = 0
                continue
            taken[nearest] = True
            track = tracks[i, nearest]
            dx, dy = track[X] - poses[i, 0], track[Y] - poses[i, 1]
            positions[i, row, 0], positions[i, row, 1] = c * dx + s * dy, c * dy - s * dx
            vx, vy = track[VX] * track[MOVING], track[VY] * track[MOVING]  # what stands has the speed of its noise
            velocities[i, row, 0], velocities[i, row, 1] = c * vx + s * vy, c * vy - s * vx
            radii[i, row] = track[RADIUS]
            ages[i, row] = int(track[AGE])
