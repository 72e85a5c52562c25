"""How people, groups, pop-up boxes and the forklift want to move in the next control step."""

import numpy as np
from numba import njit

# Kinds of mover; NONE fills unused rows, PUSHABLE moves only when pushed, UNAWARE is a person who reacts to nothing.
NONE, PEDESTRIAN, CROSSING, POP_UP, PUSHABLE, FORKLIFT, UNAWARE = range(7)

# Phases of a pop-up box (column `index`) and of a crossing group.
ARMED, SLIDING, STOPPED = range(3)
WAITING, WALKING, PAUSING = range(3)

# Social force, after Helbing and Molnar (Phys. Rev. E 51, 1995), with ranges for a room instead of a pavement.
RELAXATION_S = 0.5
PERSON_STRENGTH, PERSON_RANGE_M = 2.0, 0.30
WALL_STRENGTH, WALL_RANGE_M = 1.5, 0.10
SIDE_STEP = 0.35  # share of the repulsion turned to the right, so that two who meet head-on pass each other
ARRIVAL_M = 0.25
HULL_GAP_M = 0.08  # a pedestrian's step never takes it closer to the robot than this
STOP_S = 0.4  # and it slows over this time before
PATIENCE_S, BLOCKED_M_S = 4.0, 0.10  # who gets on no faster than this for so long turns to the next waypoint
FORKLIFT_SIGHT_M = 1.2
FORKLIFT_ACC_M_S2 = 0.6


@njit(cache=True)
def _towards_waypoint(x, y, speed, waypoints, pauses, count, index, timer, dt):
    """Velocity towards the current waypoint, and the waypoint index and pause left [s] afterwards."""
    if timer > 0.0:
        return 0.0, 0.0, index, timer - dt
    dx, dy = waypoints[index, 0] - x, waypoints[index, 1] - y
    distance = np.sqrt(dx * dx + dy * dy)
    if distance < ARRIVAL_M:
        return 0.0, 0.0, (index + 1) % count, pauses[index]
    return speed * dx / distance, speed * dy / distance, index, 0.0


@njit(cache=True)
def _give_up(vx, vy, index, timer, count, blocked, dt):
    """Waypoint index and time without getting on [s]: nobody leans on a wardrobe for three hours."""
    if timer > 0.0 or vx * vx + vy * vy > BLOCKED_M_S * BLOCKED_M_S:
        return index, 0.0
    if blocked + dt < PATIENCE_S:
        return index, blocked + dt
    return (index + 1) % count, 0.0


@njit(cache=True)
def _repulsion(dx, dy, gap, strength, reach):
    """Acceleration away from something that lies at (-dx, -dy), with its share of a step to the right."""
    distance = max(np.sqrt(dx * dx + dy * dy), 1e-6)
    push = strength * np.exp(-gap / reach)
    nx, ny = dx / distance, dy / distance
    return push * (nx - SIDE_STEP * ny), push * (ny + SIDE_STEP * nx)


@njit(cache=True)
def _limit_approach(vx, vy, nx, ny, gap):
    """Velocity whose part towards something (unit normal n away from it) lets the gap close only in `STOP_S`."""
    towards = -(vx * nx + vy * ny)
    allowed = max(gap, 0.0) / STOP_S
    if towards > allowed:
        vx += (towards - allowed) * nx
        vy += (towards - allowed) * ny
    return vx, vy


@njit(cache=True)
def _nearest_on_segment(x, y, segment):
    ex, ey = segment[2] - segment[0], segment[3] - segment[1]
    length = ex * ex + ey * ey
    share = ((x - segment[0]) * ex + (y - segment[1]) * ey) / length if length > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return x - segment[0] - share * ex, y - segment[1] - share * ey


@njit(cache=True)
def _pedestrian(m, kinds, radii, states, active, want_x, want_y, speed, robot, hull, segments, num_segments, dt):
    """Velocity of one pedestrian by social force, stopped short of the robot and of solids."""
    x, y, vx, vy = states[m, 0], states[m, 1], states[m, 3], states[m, 4]
    ax, ay = (want_x - vx) / RELAXATION_S, (want_y - vy) / RELAXATION_S
    for other in range(kinds.shape[0]):
        if other == m or kinds[other] == NONE or not active[other]:
            continue
        dx, dy = x - states[other, 0], y - states[other, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        if distance < 2.5:
            fx, fy = _repulsion(dx, dy, distance - radii[m] - radii[other], PERSON_STRENGTH, PERSON_RANGE_M)
            ax, ay = ax + fx, ay + fy
    dx, dy = x - robot[0], y - robot[1]
    robot_distance = max(np.sqrt(dx * dx + dy * dy), 1e-6)
    robot_gap = robot_distance - radii[m] - hull
    if robot_gap < 2.0:
        fx, fy = _repulsion(dx, dy, robot_gap, PERSON_STRENGTH, PERSON_RANGE_M)
        ax, ay = ax + fx, ay + fy
    for k in range(num_segments):
        wx, wy = _nearest_on_segment(x, y, segments[k])
        gap = np.sqrt(wx * wx + wy * wy) - radii[m]
        if gap < 0.6:
            fx, fy = _repulsion(wx, wy, gap, WALL_STRENGTH, WALL_RANGE_M)
            ax, ay = ax + fx, ay + fy
    vx, vy = vx + ax * dt, vy + ay * dt
    pace = np.sqrt(vx * vx + vy * vy)
    if pace > 1.2 * speed:
        vx, vy = vx * 1.2 * speed / pace, vy * 1.2 * speed / pace
    for k in range(num_segments):
        wx, wy = _nearest_on_segment(x, y, segments[k])
        distance = max(np.sqrt(wx * wx + wy * wy), 1e-6)
        if distance - radii[m] < 0.6:
            vx, vy = _limit_approach(vx, vy, wx / distance, wy / distance, distance - radii[m] - 0.03)
    return _limit_approach(vx, vy, dx / robot_distance, dy / robot_distance, robot_gap - HULL_GAP_M)


@njit(cache=True)
def _forklift(m, kinds, radii, states, active, want_x, want_y, speed, half, robot, hull, dt):
    """Velocity along the lane; stops while the robot or a person stands before it."""
    pace = np.sqrt(want_x * want_x + want_y * want_y)
    now = np.sqrt(states[m, 3] ** 2 + states[m, 4] ** 2)
    if pace > 0.0:
        ux, uy = want_x / pace, want_y / pace
        for other in range(-1, kinds.shape[0]):
            if other < 0:
                ox, oy, size = robot[0], robot[1], hull
            else:
                if other == m or kinds[other] == NONE or not active[other]:
                    continue
                ox, oy, size = states[other, 0], states[other, 1], radii[other]
            ahead = (ox - states[m, 0]) * ux + (oy - states[m, 1]) * uy
            aside = abs((oy - states[m, 1]) * ux - (ox - states[m, 0]) * uy)
            if 0.0 < ahead < half[0] + size + FORKLIFT_SIGHT_M and aside < half[1] + size + 0.25:
                return 0.0, 0.0
        pace = min(pace, now + FORKLIFT_ACC_M_S2 * dt, speed)
        return ux * pace, uy * pace
    return 0.0, 0.0


@njit(cache=True)
def _advance_group(plan, phase, timer, leg, place, robot, v, pauses, dt):
    """Phase, pause left, leg, distance walked and signed speed of a crossing group after one more step.

    `plan` is line x, y, journey x, y, lead [s], travel [m], speed [m/s].
    """
    if phase == WAITING:
        short = (plan[0] - robot[0]) * plan[2] + (plan[1] - robot[1]) * plan[3]
        approach = v * (np.cos(robot[2]) * plan[2] + np.sin(robot[2]) * plan[3])
        if approach > 0.0 and short <= plan[4] * approach:
            phase = WALKING
    if phase == PAUSING:
        timer -= dt
        if timer <= 0.0:
            phase, place = WALKING, 0.0
    if phase == WALKING:
        pace = min(plan[6], (plan[5] - place) / dt)
        place += pace * dt
        signed = pace if leg % 2 == 0 else -pace
        if place >= plan[5] - 1e-9:
            phase, timer, leg = PAUSING, pauses[leg % pauses.shape[0]], leg + 1
        return phase, timer, leg, place, signed
    return phase, timer, leg, place, 0.0


@njit(cache=True)
def move(
    kinds,
    radii,
    halves,
    states,
    active,
    speeds,
    waypoints,
    pauses,
    counts,
    index,
    timers,
    blocked,
    waits,
    stops,
    has_group,
    group_plan,
    group_across,
    group_pauses,
    group_phase,
    group_timer,
    group_leg,
    group_place,
    robots,
    robot_v,
    hull,
    segments,
    num_static,
    dt,
    velocities,
):
    """Velocity each mover should have during the next control step.

    Args:
        kinds, radii, halves, states, active, speeds, waypoints, pauses, counts, index, timers, blocked, waits, stops:
            the arrays of `pedestrians.Movers`; `index`, `timers` and `blocked` change in place.
        has_group, group_*: the crossing group of each world; phase, timer, leg and place change in place.
        robots: (n, 3) true poses; robot_v: (n,) forward speeds [m/s]; hull: radius [m].
        segments, num_static: static lines of each world.
        dt: control step [s].
        velocities: (n, M, 2) out [m/s], world frame.
    """
    for i in range(kinds.shape[0]):
        group_speed = 0.0
        if has_group[i]:
            state = (group_phase[i], group_timer[i], group_leg[i], group_place[i])
            group_phase[i], group_timer[i], group_leg[i], group_place[i], group_speed = _advance_group(
                group_plan[i], *state, robots[i], robot_v[i], group_pauses[i], dt
            )
        others = (kinds[i], radii[i], states[i], active[i])
        for m in range(kinds.shape[1]):
            kind = kinds[i, m]
            velocities[i, m, 0] = velocities[i, m, 1] = 0.0
            if kind == CROSSING:
                velocities[i, m, 0] = group_speed * group_across[i, 0]
                velocities[i, m, 1] = group_speed * group_across[i, 1]
            elif kind == POP_UP and index[i, m] == SLIDING:
                dx, dy = stops[i, m, 0] - states[i, m, 0], stops[i, m, 1] - states[i, m, 1]
                left = np.sqrt(dx * dx + dy * dy)
                if left < 1e-9:
                    index[i, m] = STOPPED
                else:
                    pace = min(speeds[i, m], left / dt)
                    velocities[i, m, 0], velocities[i, m, 1] = dx / left * pace, dy / left * pace
            elif kind in (PEDESTRIAN, FORKLIFT, UNAWARE):
                if waits[i, m]:
                    if not has_group[i] or group_phase[i] == WAITING:
                        continue
                    waits[i, m] = False
                x, y, vx, vy = states[i, m, 0], states[i, m, 1], states[i, m, 3], states[i, m, 4]
                way = (waypoints[i, m], pauses[i, m], counts[i, m], index[i, m], timers[i, m])
                want_x, want_y, index[i, m], timers[i, m] = _towards_waypoint(x, y, speeds[i, m], *way, dt)
                if kind == PEDESTRIAN:
                    index[i, m], blocked[i, m] = _give_up(
                        vx, vy, index[i, m], timers[i, m], counts[i, m], blocked[i, m], dt
                    )
                    vx, vy = _pedestrian(
                        m, *others, want_x, want_y, speeds[i, m], robots[i], hull, segments[i], num_static[i], dt
                    )
                elif kind == UNAWARE:
                    vx, vy = want_x, want_y
                else:
                    vx, vy = _forklift(m, *others, want_x, want_y, speeds[i, m], halves[i, m], robots[i], hull, dt)
                velocities[i, m, 0], velocities[i, m, 1] = vx, vy
