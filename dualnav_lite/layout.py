"""Everything drawn for one episode, from the scenario and the seed alone: room, journey, movers, events."""

from dataclasses import dataclass, field, replace

import numpy as np

from dualnav_lite import streams
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.occupants import draw_crowd, draw_people, draw_pushables, hall_lanes
from dualnav_lite.pedestrians import POP_UP, PUSHABLE, CrowdPlan, MoverPlan
from dualnav_lite.pop_ups import PopUpPlan
from dualnav_lite.rooms import (
    FIELD_RESOLUTION_M,
    PATH_MARGIN_M,
    StaticRoom,
    draw,
    draw_count,
    draw_room,
    free_point,
    furnish,
)
from dualnav_lite.scenario import HALL_END_M, HALL_SIDE_M, Range, Scenario

CORNER_MARGIN_M = 0.45  # start and goal keep this from every solid
MAX_TRIES = 300
# Places on the shortest path, 0.2 m apart, where the first pop-up box must be able to fire. A hiding place is seen
# from few places, and a driver need not follow the shortest path, so that variant asks for more of them.
POP_UP_CHANCES = {"beside": 1, "head_on": 1, "cover": 6}


@dataclass(frozen=True)
class Layout:
    """One episode before its first step. Positions in the world frame [m].

    Attributes:
        start: (3,) robot pose.
        goals: (g, 2) goals in their order; one in a short run.
        goal_field: (H, W) `StaticRoom.progress_field` of the first goal [m].
        shortest_path_m: from start to the first goal.
        time_limit_s: of a short run, or the whole duration of a long one.
        charge: battery at the start in [0, 1].
    """

    seed: int
    room: StaticRoom
    start: np.ndarray
    goals: np.ndarray
    goal_field: np.ndarray = field(repr=False)
    shortest_path_m: float
    time_limit_s: float
    charge: float
    movers: tuple[MoverPlan, ...] = ()
    crowd: CrowdPlan | None = None
    pop_ups: tuple[PopUpPlan, ...] = ()


def generate(scenario: Scenario, config: Config, seed: int) -> Layout:
    """Layout of a scenario for a seed, re-drawn from the seed until its events can happen.

    Raises:
        UnusableInput: no layout fits the scenario's numbers within `MAX_TRIES` draws.
    """
    rng = streams.stream(seed, "layout")
    for _ in range(MAX_TRIES):
        layout = _attempt(rng, scenario, config, seed)
        if layout is not None:
            return layout
    raise UnusableInput(
        f"scenario '{scenario.id}', seed {seed}: no layout fits after {MAX_TRIES} draws; "
        "give it a larger room, less furniture or a nearer goal"
    )


def _attempt(rng, scenario: Scenario, config: Config, seed: int) -> Layout | None:
    is_walled = streams.stream(seed, "inner wall").random() < scenario.room.walled_share
    room = draw_room(rng, scenario.room, is_walled)
    keep = config.robot.hull_radius_m + PATH_MARGIN_M
    journey = _draw_journey(rng, room, scenario)
    if journey is None:
        return None
    start, goal = journey
    crowd, movers = None, []
    if scenario.crowd is not None:
        formation = int(streams.stream(seed, "formation").integers(3))
        drawn = draw_crowd(rng, room, scenario, start, goal, config.hardware.max_lin_vel, formation)
        if drawn is None:
            return None
        crowd, movers = drawn
    if scenario.room.hall:
        room = furnish(rng, room, scenario.room, hall_lanes(start, goal, movers))
    draw_people(rng, room, scenario, start, movers)
    draw_pushables(rng, room, scenario.room, start, goal, movers)
    # The way must be open without pushing anything.
    areas = room.areas(keep, [(*m.pose[:2], m.reach) for m in movers if m.kind == PUSHABLE])
    if not areas[room.cell(start)] == areas[room.cell(goal)] != 0:
        return None
    goal_field = room.progress_field(goal, config.robot.hull_radius_m)
    shortest = float(goal_field[room.cell(start)])
    layout = Layout(
        seed=seed,
        room=room,
        start=start,
        goals=goal[None],
        goal_field=goal_field,
        shortest_path_m=shortest,
        time_limit_s=scenario.time_limit_paths * shortest / config.hardware.max_lin_vel + scenario.time_limit_extra_s,
        charge=draw(streams.stream(seed, "charge"), scenario.start_charge),
        movers=tuple(movers),
        crowd=crowd,
    )
    if scenario.pop_up is not None:
        layout = _with_pop_ups(rng, layout, scenario)
    if layout is not None and scenario.dispatcher is not None:
        layout = _with_dispatched_goals(rng, layout, scenario, keep)
    return layout


def _draw_journey(rng, room: StaticRoom, scenario: Scenario):
    """Start pose and goal the wished distance apart; in a hall along one of its axes."""
    settings = scenario.room
    distance = settings.goal_distance_m
    for _ in range(60):
        if settings.hall:
            start, goal = _hall_journey(rng, room, distance)
        else:
            start, goal = free_point(rng, room, CORNER_MARGIN_M), free_point(rng, room, CORNER_MARGIN_M)
        if start is None or goal is None:
            return None
        if distance.low <= np.hypot(*(goal - start)) <= distance.high:
            towards = np.arctan2(goal[1] - start[1], goal[0] - start[0])
            error = settings.heading_error_rad
            heading = towards + rng.uniform(-error, error)
            return np.array([*start, heading]), goal
    return None


def _hall_journey(rng, room: StaticRoom, distance: Range):
    """Two points on a line along the hall's length or width, in either direction."""
    along_x = rng.random() < 0.5
    length, across = (room.width, room.height) if along_x else (room.height, room.width)
    # The longest journey may come out a last digit too long, where one place is left to begin it.
    journey = rng.uniform(distance.low, max(distance.low, min(distance.high, length - 2 * HALL_END_M)))
    begin = rng.uniform(HALL_END_M, max(HALL_END_M, length - HALL_END_M - journey))
    lateral = rng.uniform(HALL_SIDE_M, across - HALL_SIDE_M)
    ends = np.array([[begin, lateral], [begin + journey, lateral]])
    if not along_x:
        ends = ends[:, ::-1]
    return (ends[0], ends[1]) if rng.random() < 0.5 else (ends[1], ends[0])


def _with_pop_ups(rng, layout: Layout, scenario: Scenario) -> Layout | None:
    """The layout with armed pop-up boxes; None where the first could hardly fire on the shortest path."""
    settings = scenario.pop_up
    plans, movers, odometer = [], [], 0.0
    for k in range(draw_count(rng, settings.count)):
        odometer += draw(rng, settings.first_trigger_m if k == 0 else settings.next_trigger_m)
        half = draw(rng, settings.half_size_m)
        plans.append(
            PopUpPlan(
                trigger_m=odometer,
                sides=rng.choice([-1.0, 1.0], 4),
                side_m=rng.uniform(settings.side_m.low, settings.side_m.high, 4),
                stop_m=rng.uniform(-settings.stop_within_m, settings.stop_within_m, 4),
                settings=settings,
            )
        )
        movers.append(MoverPlan(kind=POP_UP, half_length=half, half_width=half, pose=(-100.0 - 10 * k, -100.0, 0.0)))
    path = shortest_path(layout.room, layout.goal_field, layout.start[:2])
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    half, chances = movers[0].half_length, 0
    for odometer in np.arange(plans[0].trigger_m, length[-1] - settings.ahead_m, 0.2):
        k = int(np.searchsorted(length, odometer))
        if k + 4 >= len(path):
            break
        heading = np.arctan2(*(path[k + 4] - path[k])[::-1])
        pose = np.array([*path[k], heading])
        found = plans[0].place(pose, half, layout.room, layout.goals[0], layout.goal_field, [], must_hide=True)
        chances += found is not None
        if chances >= POP_UP_CHANCES[settings.placement]:
            return replace(layout, pop_ups=tuple(plans), movers=layout.movers + tuple(movers))
    return None


def shortest_path(room: StaticRoom, goal_field: np.ndarray, start) -> np.ndarray:
    """(p, 2) cell centres down the goal field from a point [m]."""
    iy, ix = room.cell(start)
    cells = [(iy, ix)]
    while goal_field[iy, ix] > 0 and len(cells) < goal_field.size:
        y0, x0 = max(iy - 1, 0), max(ix - 1, 0)
        window = goal_field[y0 : iy + 2, x0 : ix + 2]
        dy, dx = np.unravel_index(np.argmin(window), window.shape)
        if (y0 + dy, x0 + dx) == (iy, ix):
            break
        iy, ix = int(y0 + dy), int(x0 + dx)
        cells.append((iy, ix))
    return (np.array(cells)[:, ::-1] + 0.5) * FIELD_RESOLUTION_M


def _with_dispatched_goals(rng, layout: Layout, scenario: Scenario, keep: float) -> Layout | None:
    """The layout with one goal a period for the whole run, each the wished distance from the one before."""
    settings = scenario.dispatcher
    room = layout.room
    areas = room.areas(keep)
    reachable = (areas == areas[room.cell(layout.goals[0])]) & (room.clearance >= settings.goal_clearance_m)
    rows, columns = np.nonzero(reachable)
    if len(rows) < 50:
        return None
    points = (np.stack([columns, rows], axis=1) + 0.5) * FIELD_RESOLUTION_M
    distance = scenario.room.goal_distance_m
    goals = [layout.goals[0]]
    for _ in range(round(settings.duration_s / settings.period_s) - 1):
        # A length is drawn first, then a place so far away: drawn among all places, large rooms would cost more energy.
        gap = np.hypot(*(points - goals[-1]).T)
        is_apart = (gap >= distance.low) & (gap <= distance.high)
        if not is_apart.any():
            return None
        off = np.where(is_apart, np.abs(gap - draw(rng, distance)), np.inf)
        near = np.flatnonzero(off <= off.min() + 0.25)
        goals.append(points[near[rng.integers(len(near))]])
    return replace(layout, goals=np.array(goals), time_limit_s=settings.duration_s, charge=scenario.start_charge.high)
