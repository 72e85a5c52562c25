"""Costs of a grid of commands by rolling each out among fixed and moving things."""

import numpy as np
from numba import njit

# Columns of the parameter row built by `planners.sampling`.
(
    HULL,
    MAX_V,
    MAX_OMEGA,
    MAX_ACC,
    MAX_ANG_ACC,
    FIRST_S,
    SECOND_S,
    DT,
    STATIC_MARGIN,
    STATIC_SOFT,
    MOVING_MARGIN,
    MOVING_SOFT,
    GOAL_RADIUS,
    COLLISION,
    MARGIN_RATE,
    SOFT_RATE,
    STATIC_RATE,
    TURN_COST,
    SPEED_COST,
    REVERSE_COST,
    LANE_M,
    LANE_COST,
    CAP,
) = range(23)
CLEARANCE, WAY, FACTOR, CARROT = range(4)  # layers of `fields`
_ALIGN_M = 0.3  # the way left is also read this far ahead, so that facing the right way pays
_ALIGN_SHARE = 0.5
_TURN_GAIN = 3.0  # [1/s] of the heading error
_CARROT_CELLS = 5  # near enough not to cut corners, far enough to be smooth
_WALKS_M_S = 0.1
_DEAREST = 30.0  # factor of closed cells, along a rollout
_SLACK_M = 0.25  # of the bound: what the goal's radius, the facing and the cells can add to it
_OUTSIDE = 1e3


@njit(cache=True)
def read_bilinear(fields, layer, x, y, grid, outside):
    """Value of a layer of cell centres at a point.

    Args:
        fields: (L, H, W); layer: which of them.
        x, y: the point [m].
        grid: (origin x, origin y, cell size) [m].
        outside: value where the field ends, and an upper bound on the others.
    """
    u, v = (x - grid[0]) / grid[2] - 0.5, (y - grid[1]) / grid[2] - 0.5
    if u < 0.0 or v < 0.0 or u >= fields.shape[2] - 1 or v >= fields.shape[1] - 1:
        return outside
    ix, iy = int(u), int(v)
    a, b = u - ix, v - iy
    value = (1.0 - b) * ((1.0 - a) * fields[layer, iy, ix] + a * fields[layer, iy, ix + 1])
    value += b * ((1.0 - a) * fields[layer, iy + 1, ix] + a * fields[layer, iy + 1, ix + 1])
    return min(value, outside)


@njit(cache=True)
def _rate(gap, margin, soft, margin_rate, soft_rate):
    """Cost a second of being this close: rises from `soft` to `margin`, steeply below; a gap below 0 is a collision."""
    if gap >= soft:
        return 0.0
    if gap >= margin:
        share = (soft - gap) / (soft - margin)
        return soft_rate * share * share
    return soft_rate + margin_rate * (margin - gap) / margin


@njit(cache=True)
def _closeness(x, y, speed, t, fields, grid, circles, boxes, p):
    """Cost a second at a place, speed and time, and whether the hull overlaps something there."""
    fixed = read_bilinear(fields, CLEARANCE, x, y, grid, _OUTSIDE) - p[HULL]  # gap to what stands
    moving = np.inf  # gap to what moves
    reach = p[HULL] + max(p[MOVING_SOFT], p[STATIC_SOFT])
    for k in range(circles.shape[0]):
        dx, dy = x - circles[k, 0] - t * circles[k, 3], y - circles[k, 1] - t * circles[k, 4]
        square = dx * dx + dy * dy
        if square < (circles[k, 2] + reach) ** 2:
            gap = np.sqrt(square) - circles[k, 2] - p[HULL]
            if circles[k, 3] ** 2 + circles[k, 4] ** 2 > _WALKS_M_S**2:
                moving = min(moving, gap)
            else:
                fixed = min(fixed, gap)
    for k in range(boxes.shape[0]):
        dx, dy = x - boxes[k, 0] - t * boxes[k, 6], y - boxes[k, 1] - t * boxes[k, 7]
        outside_x = max(abs(boxes[k, 2] * dx + boxes[k, 3] * dy) - boxes[k, 4], 0.0)
        outside_y = max(abs(boxes[k, 2] * dy - boxes[k, 3] * dx) - boxes[k, 5], 0.0)
        gap = np.sqrt(outside_x * outside_x + outside_y * outside_y) - p[HULL]
        if boxes[k, 6] ** 2 + boxes[k, 7] ** 2 > _WALKS_M_S**2:
            moving = min(moving, gap)
        else:
            fixed = min(fixed, gap)
    # By length and not by time, so that hurrying past pays nothing and waiting before a narrow place saves nothing.
    rate = speed / p[MAX_V] * _rate(fixed, p[STATIC_MARGIN], p[STATIC_SOFT], p[MARGIN_RATE], p[STATIC_RATE])
    rate = max(rate, _rate(moving, p[MOVING_MARGIN], p[MOVING_SOFT], p[MARGIN_RATE], p[SOFT_RATE]))
    ix, iy = int((x - grid[0]) / grid[2]), int((y - grid[1]) / grid[2])
    if 0 <= ix < fields.shape[2] and 0 <= iy < fields.shape[1]:
        rate += speed * (min(fields[FACTOR, iy, ix], _DEAREST) - 1.0)
    return rate, fixed < 0.0 or moving < 0.0


@njit(cache=True)
def _approach(value, target, step):
    return value + min(max(target - value, -step), step)


@njit(cache=True)
def _downhill(fields, x, y, grid):
    """Heading to the cell that lies `_CARROT_CELLS` steps down the way [rad]; found once a cell, kept in its layer."""
    height, width = fields.shape[1], fields.shape[2]
    ix = min(max(int((x - grid[0]) / grid[2]), 0), width - 1)
    iy = min(max(int((y - grid[1]) / grid[2]), 0), height - 1)
    if fields[CARROT, iy, ix] < 0.0:
        ay, ax = iy, ix
        for _ in range(_CARROT_CELLS):
            by, bx = ay, ax
            for cy in range(max(ay - 1, 0), min(ay + 2, height)):
                for cx in range(max(ax - 1, 0), min(ax + 2, width)):
                    is_open = fields[WAY, ay, cx] < np.inf and fields[WAY, cy, ax] < np.inf
                    if is_open and fields[WAY, cy, cx] < fields[WAY, by, bx]:
                        by, bx = cy, cx
            ay, ax = by, bx
        fields[CARROT, iy, ix] = ay * width + ax
    carrot = int(fields[CARROT, iy, ix])
    to_x = grid[0] + (carrot % width + 0.5) * grid[2] - x
    to_y = grid[1] + (carrot // width + 0.5) * grid[2] - y
    return np.arctan2(to_y, to_x)


@njit(cache=True)
def _roll(state, v, omega, heading, begin, end, dt, limit, goal, fields, grid, circles, boxes, p):
    """Drive `state` (x, y, heading, v, omega) from time `begin` to `end`; its cost and whether it is over.

    It holds v and omega (`heading` nan), or turns to a heading and drives on there at v; heading inf is downhill on
    the way. It is over at a collision (dear, the more so the sooner), at the goal (where the time left counts as way),
    or when it cannot end below `limit`: the way shrinks by no more than what is driven, times the factor that the
    cost has already counted.
    """
    cost = 0.0
    horizon = p[FIRST_S] + p[SECOND_S]
    speed = v
    t = begin
    while t < end - 1e-9:
        if heading == heading:
            aim = heading
            if heading == np.inf:
                aim = _downhill(fields, state[0], state[1], grid)
            error = (aim - state[2] + np.pi) % (2.0 * np.pi) - np.pi
            omega = min(max(_TURN_GAIN * error, -p[MAX_OMEGA]), p[MAX_OMEGA])
            speed = v * max(np.cos(error), 0.0)
        state[3] = _approach(state[3], speed, p[MAX_ACC] * dt)
        state[4] = _approach(state[4], omega, p[MAX_ANG_ACC] * dt)
        middle = state[2] + 0.5 * dt * state[4]
        state[0] += dt * state[3] * np.cos(middle)
        state[1] += dt * state[3] * np.sin(middle)
        state[2] += dt * state[4]
        t += dt
        x, y = state[0], state[1]
        rate, hit = _closeness(x, y, abs(state[3]), t, fields, grid, circles, boxes, p)
        cost += dt * (rate + p[REVERSE_COST] * max(0.0, -state[3]))
        left = read_bilinear(fields, WAY, x, y, grid, _OUTSIDE)
        if hit:
            return cost + p[COLLISION] * (1.0 - 0.7 * t / horizon) + left, True
        if (x - goal[0]) ** 2 + (y - goal[1]) ** 2 < p[GOAL_RADIUS] ** 2:
            return cost - p[MAX_V] * (horizon - t), True
        least = cost + left - p[MAX_V] * (horizon - t) - _SLACK_M
        if least >= limit:
            return least, True
    return cost, False


@njit(cache=True)
def _cost_to_go(state, t, fields, grid, circles, p):
    """Way left at the end of a rollout, a little less where it faces the way on, more in the lane of a walker."""
    x, y = state[0], state[1]
    left = read_bilinear(fields, WAY, x, y, grid, _OUTSIDE)
    ahead_x, ahead_y = x + _ALIGN_M * np.cos(state[2]), y + _ALIGN_M * np.sin(state[2])
    ahead = read_bilinear(fields, WAY, ahead_x, ahead_y, grid, left + _ALIGN_M)
    cost = left + _ALIGN_SHARE * min(ahead - left, _ALIGN_M)
    worst = 0.0
    for k in range(circles.shape[0]):
        pace = np.sqrt(circles[k, 3] ** 2 + circles[k, 4] ** 2)
        if pace > _WALKS_M_S:
            dx, dy = x - circles[k, 0] - t * circles[k, 3], y - circles[k, 1] - t * circles[k, 4]
            along = (dx * circles[k, 3] + dy * circles[k, 4]) / pace
            aside = abs(dx * circles[k, 4] - dy * circles[k, 3]) / pace
            if 0.0 < along < p[LANE_M] and aside < circles[k, 2] + p[HULL] + p[MOVING_MARGIN]:
                worst = max(worst, 1.0 - along / p[LANE_M])
    return cost + p[LANE_COST] * worst


@njit(cache=True)
def score_commands(pose, twist, commands, headings, goal, fields, grid, circles, boxes, p, costs):
    """Cost of each command now: held for a while, then followed by the best of a few ways to go on.

    These are: hold it, stop, back off, follow the way, or turn to one of some headings and drive there at top speed.
    Following the way keeps the robot from putting off what a first command and one heading happen to reach.

    Args:
        pose: (3,) robot; twist: (2,) v, omega.
        commands: (k, 2) v [m/s], omega [rad/s].
        headings: (j,) [rad]. Fixed in the world: were they to turn with the robot, what looked best a moment ago would
            be gone, and it would dither.
        goal: (2,) [m]; rollouts end there.
        fields: (4, H, W) of cells: distance from the centre to the nearest fixed solid [m], way left to the goal [m],
            the factor on a step's length with which that way was computed, and work space that begins at -1.
        grid: (origin x, origin y, cell size) of the fields [m].
        circles: (c, 5) x, y, radius, vx, vy of moving things, same frame, which keep their velocity.
        boxes: (b, 8) x, y, cos, sin of the angle, half length, half width, vx, vy.
        p: (23,) parameters, columns as named above.
        costs: (k,) out, in metres of way; those more than `CAP` above the lowest are only bounds.
    """
    begin, end, dt = p[FIRST_S], p[FIRST_S] + p[SECOND_S], p[DT]
    first, state = np.empty(5), np.empty(5)
    around = (goal, fields, grid, circles, boxes, p)
    cheapest = np.inf
    for k in range(commands.shape[0]):
        first[0], first[1], first[2], first[3], first[4] = pose[0], pose[1], pose[2], twist[0], twist[1]
        own = p[TURN_COST] * abs(commands[k, 1] - twist[1]) + p[SPEED_COST] * abs(commands[k, 0] - twist[0])
        limit = cheapest + p[CAP] - own
        begun, over = _roll(first, commands[k, 0], commands[k, 1], np.nan, 0.0, begin, dt, limit, *around)
        own += begun
        best = 0.0 if over else np.inf
        for j in range(headings.shape[0] + 4):
            if over:
                break
            state[:] = first
            v, omega, heading = p[MAX_V], 0.0, np.nan
            if j == 0:
                heading = np.inf
            elif j == 1:
                v, omega = commands[k, 0], commands[k, 1]
            elif j == 2:
                v = 0.0
            elif j == 3:
                v = -p[MAX_V]
            else:
                heading = headings[j - 4]
            limit = min(best, cheapest + p[CAP] - own)
            cost, is_end = _roll(state, v, omega, heading, begin, end, 2.0 * dt, limit, *around)
            if not is_end:
                cost += _cost_to_go(state, end, fields, grid, circles, p)
            best = min(best, cost)
        costs[k] = own + best
        cheapest = min(cheapest, costs[k])
