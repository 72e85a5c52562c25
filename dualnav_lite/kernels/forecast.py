"""What the predictor is told about a mover, and its network's forward pass: the same bits for any number of movers."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.tracking import AGE, MISSES, P_VEL, RADIUS, VX, VY, X, Y

SECTORS = 12  # of the room around a mover, the first one straight ahead of it
SIGHT_M = 3.0  # how far the room around it is looked at
CORRIDOR_M = 0.35  # half width of the strip ahead of it
OWN_M = 0.12  # returns this close to its circle are its own
BEAM_STRIDE = 2

SEQUENCE = 9  # numbers of each scan; see `describe_mover`
CONTEXT = 8 + SECTORS  # numbers of now


@njit(cache=True)
def _look_around(scan, pose, x, y, cosine, sine, radius, room):
    """Nearest return in each sector around a mover, and in the strip ahead of it, as shares of `SIGHT_M`.

    Args:
        scan: (beams, 2); pose: (3,) of the robot; x, y: the mover's middle; cosine, sine: of its heading, same frame.
        room: (SECTORS + 1,) out.
    """
    room[:] = 1.0
    beams = scan.shape[0]
    turn = 2.0 * math.pi / beams
    # The mover as the robot sees it, then each return as the mover sees it.
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = x - pose[0], y - pose[1]
    away_x, away_y = c * dx + s * dy, c * dy - s * dx
    head_x, head_y = c * cosine + s * sine, c * sine - s * cosine
    step_c, step_s = math.cos(turn * BEAM_STRIDE), math.sin(turn * BEAM_STRIDE)
    beam_c, beam_s = -1.0, 0.0
    for k in range(0, beams, BEAM_STRIDE):
        distance = scan[k, 0]
        px, py = distance * beam_c - away_x, distance * beam_s - away_y
        beam_c, beam_s = beam_c * step_c - beam_s * step_s, beam_s * step_c + beam_c * step_s
        square = px * px + py * py
        if scan[k, 1] <= 0.0 or square >= SIGHT_M * SIGHT_M or square < (radius + OWN_M) ** 2:
            continue
        ahead, left = head_x * px + head_y * py, head_x * py - head_y * px
        place = math.atan2(left, ahead) / (2.0 * math.pi) * SECTORS
        sector = math.floor(place + 0.5) % SECTORS
        room[sector] = min(room[sector], math.sqrt(square) / SIGHT_M)
        if ahead > 0.0 and abs(left) < CORRIDOR_M:
            room[SECTORS] = min(room[SECTORS], ahead / SIGHT_M)


@njit(cache=True)
def describe_mover(states, poses, scan, sequence, context, frame):
    """What the network is told about one mover, in the mover's own frame: origin at its middle, x along its velocity.

    Args:
        states: (f, COLUMNS) of its track after each scan, map frame; an age of 0 before it was first seen.
        poses: (f, 3) believed; scan: (beams, 2) the newest.
        sequence: (f, SEQUENCE) out: is tracked; x, y [m]; vx, vy [m/s]; standard deviation of the velocity; was seen;
            x, y of the robot [m].
        context: (CONTEXT,) out: speed [m/s], radius [m], age as a share of f, distance [m], robot's vx, vy [m/s], scans
            since it was last seen, room ahead, room in each sector.
        frame: (4,) out: x, y of its middle, cosine and sine of its heading, map frame.
    """
    depth = states.shape[0]
    now, pose = states[depth - 1], poses[depth - 1]
    speed = math.hypot(now[VX], now[VY])
    c, s = (now[VX] / speed, now[VY] / speed) if speed > 1e-6 else (1.0, 0.0)
    frame[0], frame[1], frame[2], frame[3] = now[X], now[Y], c, s
    for k in range(depth):
        track = states[k]
        sequence[k, :] = 0.0
        if track[AGE] > 0.0:
            dx, dy = track[X] - now[X], track[Y] - now[Y]
            sequence[k, 0] = 1.0
            sequence[k, 1], sequence[k, 2] = c * dx + s * dy, c * dy - s * dx
            sequence[k, 3], sequence[k, 4] = c * track[VX] + s * track[VY], c * track[VY] - s * track[VX]
            sequence[k, 5] = math.sqrt(track[P_VEL])
            sequence[k, 6] = 1.0 if track[MISSES] == 0.0 else 0.0
        dx, dy = poses[k, 0] - now[X], poses[k, 1] - now[Y]
        sequence[k, 7], sequence[k, 8] = c * dx + s * dy, c * dy - s * dx
    before = max(0, depth - 4)
    seconds = 0.1 * max(1, depth - 1 - before)
    robot_vx, robot_vy = (pose[0] - poses[before, 0]) / seconds, (pose[1] - poses[before, 1]) / seconds
    context[0], context[1] = speed, now[RADIUS]
    context[2] = min(1.0, now[AGE] / depth)
    context[3] = math.hypot(now[X] - pose[0], now[Y] - pose[1])
    context[4], context[5] = c * robot_vx + s * robot_vy, c * robot_vy - s * robot_vx
    context[6] = now[MISSES]
    room = np.empty(SECTORS + 1)
    _look_around(scan, pose, now[X], now[Y], c, s, now[RADIUS], room)
    context[7] = room[SECTORS]
    for k in range(SECTORS):
        context[8 + k] = room[k]


@njit(cache=True)
def describe_movers(states, poses, scans, valid, sequences, contexts, frames):
    """`describe_mover` of every valid mover of n worlds; other rows are zero.

    Args:
        states: (n, K, f, COLUMNS); poses: (n, f, 3); scans: (n, beams, 2) the newest; valid: (n, K).
        sequences: (n, K, f, SEQUENCE) f32; contexts: (n, K, CONTEXT) f32; frames: (n, K, 4); all out.
    """
    for i in range(states.shape[0]):
        for k in range(states.shape[1]):
            if valid[i, k]:
                describe_mover(states[i, k], poses[i], scans[i], sequences[i, k], contexts[i, k], frames[i, k])
            else:
                sequences[i, k], contexts[i, k], frames[i, k] = 0.0, 0.0, 0.0


@njit(cache=True)
def _add_product(vector, weights, out):
    """out += vector @ weights, a column of partial sums at a time, so that the order never depends on anything."""
    for i in range(vector.shape[0]):
        value = vector[i]
        row = weights[i]
        for j in range(out.shape[0]):
            out[j] += value * row[j]


@njit(cache=True)
def _sigmoid(x):
    return np.float32(1.0) / (np.float32(1.0) + np.exp(-x))


@njit(cache=True)
def run_network(sequence, context, w_input, w_hidden, bias, w_first, b_first, w_last, b_last, out):
    """An LSTM over the scans, then two dense layers over its last state and the context.

    Args:
        sequence: (f, SEQUENCE) f32; context: (CONTEXT,) f32.
        w_input: (SEQUENCE, 4 H), w_hidden: (H, 4 H), bias: (4 H,) of the gates input, forget, cell, output.
        w_first: (H + CONTEXT, D), b_first: (D,), w_last: (D, O), b_last: (O,).
        out: (O,) f32.

    Source: Hochreiter and Schmidhuber, "Long short-term memory", Neural Computation 9 (1997), with forget gates (Gers
    et al. 2000), in the order of torch's `nn.LSTM`.
    """
    size = w_hidden.shape[0]
    joined = np.zeros(size + context.shape[0], np.float32)
    hidden, cell, gates = joined[:size], np.zeros(size, np.float32), np.empty(4 * size, np.float32)
    for k in range(sequence.shape[0]):
        gates[:] = bias
        _add_product(sequence[k], w_input, gates)
        _add_product(hidden, w_hidden, gates)
        for j in range(size):
            fresh = _sigmoid(gates[j]) * np.tanh(gates[2 * size + j])
            cell[j] = _sigmoid(gates[size + j]) * cell[j] + fresh
            hidden[j] = _sigmoid(gates[3 * size + j]) * np.tanh(cell[j])
    joined[size:] = context
    middle = b_first.copy()
    _add_product(joined, w_first, middle)
    for j in range(middle.shape[0]):
        middle[j] = max(middle[j], np.float32(0.0))
    out[:] = b_last
    _add_product(middle, w_last, out)


@njit(cache=True)
def run_network_on_movers(
    sequences, contexts, valid, w_input, w_hidden, bias, w_first, b_first, w_last, b_last, outputs
):
    """`run_network` for every valid mover of n worlds; other rows of `outputs` (n, K, O) are zero."""
    weights = (w_input, w_hidden, bias, w_first, b_first, w_last, b_last)
    for i in range(valid.shape[0]):
        for k in range(valid.shape[1]):
            if valid[i, k]:
                run_network(sequences[i, k], contexts[i, k], *weights, outputs[i, k])
            else:
                outputs[i, k] = 0.0
