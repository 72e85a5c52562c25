"""People, a crossing group, a forklift and pushable boxes, drawn for one episode."""

import numpy as np

from dualnav_lite.pedestrians import CROSSING, FORKLIFT, PEDESTRIAN, PUSHABLE, UNAWARE, CrowdPlan, MoverPlan
from dualnav_lite.rooms import StaticRoom, distance_to_line, draw, draw_count, free_point, line_is_free
from dualnav_lite.scenario import Room, Scenario

FILE, RANK, STAGGERED = range(3)
PLACE_TRIES = 5  # for each person: a small room is soon full


def _formation(rng, kind: int, count: int, spacing: np.ndarray):
    """Places of a group's members behind its head: (count, 2) depth along the way and sideways [m].

    `spacing` holds the (count - 1,) distances between neighbours' centres [m].
    """
    steps = np.concatenate([[0.0], np.cumsum(spacing)])
    if kind == FILE:
        return np.stack([steps, rng.uniform(-0.05, 0.05, count)], axis=1)
    if kind == RANK:
        return np.stack([np.zeros(count), steps - steps.mean()], axis=1)
    depth = 0.45
    sideways = np.concatenate([[0.0], np.cumsum(np.sqrt(np.maximum(spacing**2 - depth**2, 0.01)))])
    return np.stack([depth * (np.arange(count) % 2), sideways - sideways.mean()], axis=1)


def draw_crowd(rng, room: StaticRoom, scenario: Scenario, start, goal, top_speed: float, kind: int):
    """The crossing group, aimed to meet a robot that drives on; None where it does not fit the hall."""
    settings = scenario.crowd
    journey = goal - start[:2]
    length = float(np.hypot(*journey))
    ahead = journey / length
    side = 1.0 if rng.random() < 0.5 else -1.0
    across = side * np.array([-ahead[1], ahead[0]])  # the group's walking direction
    line_distance = draw(rng, settings.line_share) * length
    line_point = start[:2] + line_distance * ahead
    extent = np.array([room.width, room.height])
    # Room on either side of the journey, along the group's way.
    axis = int(np.argmax(np.abs(across)))
    if across[axis] > 0:
        before, behind = line_point[axis], extent[axis] - line_point[axis]
    else:
        before, behind = extent[axis] - line_point[axis], line_point[axis]
    radii = np.array([draw(rng, settings.radius_m) for _ in range(settings.count)])
    for _ in range(12):
        lead = draw(rng, settings.lead_s)
        gaps = np.array([draw(rng, settings.gap_m) for _ in range(settings.count - 1)])
        places = _formation(rng, kind, settings.count, radii[:-1] + radii[1:] + gaps)
        aim = settings.speed_m_s * (lead + rng.uniform(-settings.aim_error_s, settings.aim_error_s))
        head = aim - 0.5 * places[:, 0].max()  # distance of the head from the robot's line: the middle meets it
        tail = head + places[:, 0].max()
        fits = head >= 0.7 and tail <= before - 0.4 and line_distance >= top_speed * lead + 0.6
        if fits and np.abs(places[:, 1]).max() + 0.8 < min(line_distance, length - line_distance) + 0.6:
            break
    else:
        return None
    travel = head + behind - settings.wall_gap_m
    if travel < tail + settings.clear_line_m:
        return None
    origins = line_point - np.outer(head + places[:, 0], across) + np.outer(places[:, 1], ahead)
    inside = (origins > 0.3).all() and (origins < extent - 0.3).all()
    if not inside:
        return None
    pauses = rng.uniform(settings.pause_s.low, settings.pause_s.high, 8)
    movers = [
        MoverPlan(
            kind=PEDESTRIAN if settings.reactive else CROSSING,
            radius=float(radius),
            pose=(*origin, float(np.arctan2(across[1], across[0]))),
            speed=settings.speed_m_s,
            waypoints=np.array([origin + travel * across, origin]),
            pauses=pauses[:2],
            waits=True,
        )
        for origin, radius in zip(origins, radii, strict=True)
    ]
    plan = CrowdPlan(
        line_point=line_point,
        journey=ahead,
        across=across,
        lead_s=lead,
        travel_m=float(travel),
        speed=settings.speed_m_s,
        pauses=pauses,
    )
    return plan, movers


def hall_lanes(start, goal, movers) -> list:
    """Strips of a hall that furniture must not block: the journey's ends and the lane of every walker."""
    lanes = [(*start[:2].tolist(), *goal.tolist(), 0.5)]
    for mover in movers:
        lanes.append((*mover.waypoints[0].tolist(), *mover.waypoints[1].tolist(), mover.radius + 0.25))
    return lanes


def _is_apart(movers, point, reach: float) -> bool:
    """Whether a circle keeps 0.2 m from every mover's place."""
    return all(np.hypot(*np.subtract(point, m.pose[:2])) >= reach + m.reach + 0.2 for m in movers)


def draw_people(rng, room: StaticRoom, scenario: Scenario, start, movers: list[MoverPlan]) -> None:
    """Add pedestrians on loops of waypoints, and now and then a forklift-sized mover on its lane."""
    people = scenario.people
    for _ in range(draw_count(rng, people.count)):
        radius = draw(rng, people.radius_m)
        waypoints = _entrance(rng, room, start, movers, radius)
        if waypoints is None:
            continue
        is_unaware = people.unaware_share > 0 and rng.random() < people.unaware_share
        movers.append(
            MoverPlan(
                kind=UNAWARE if is_unaware else PEDESTRIAN,
                radius=radius,
                pose=(*waypoints[0], 0.0),
                speed=draw(rng, people.speed_m_s),
                waypoints=np.roll(waypoints, -1, axis=0),
                pauses=rng.uniform(0.0, 2.0, len(waypoints)),
            )
        )
    if rng.random() < people.forklift_share:
        movers += _draw_forklift(rng, room, start, movers)


def _entrance(rng, room: StaticRoom, start, movers, radius: float):
    """Waypoints whose first is apart from the robot and from everybody else; None if a few draws found none."""
    for _ in range(PLACE_TRIES):
        waypoints = _walk(rng, room, radius + 0.15)
        if waypoints is None:
            return None
        if np.hypot(*(waypoints[0] - start[:2])) >= 1.5 and _is_apart(movers, waypoints[0], radius):
            return waypoints
    return None


def _walk(rng, room: StaticRoom, keep: float):
    """Closed loop of three to five points with free lines between them, or None."""
    points: list[np.ndarray] = []
    wanted = int(rng.integers(3, 6))
    for _ in range(40):
        point = free_point(rng, room, keep)
        if point is None:
            return None
        if not points or line_is_free(room, points[-1], point, keep):
            points.append(point)
        if len(points) >= wanted:
            break
    if len(points) < 2:
        return None
    if not line_is_free(room, points[-1], points[0], keep):
        points += points[-2:0:-1]  # no free line back to the first point: walk back the same way
    return np.array(points)


def _draw_forklift(rng, room: StaticRoom, start, movers) -> list[MoverPlan]:
    """A forklift-sized mover that goes to and fro on a straight lane, if one fits."""
    half_length, half_width = 0.6, 0.4
    for _ in range(20):
        begin, end = free_point(rng, room, 0.8), free_point(rng, room, 0.8)
        if begin is None or end is None:
            return []
        away = distance_to_line(*start[:2], *begin, *end) > 1.6
        away &= _is_apart(movers, begin, float(np.hypot(half_length, half_width)))
        if away and np.hypot(*(end - begin)) > 2.5 and line_is_free(room, begin, end, 0.75):
            heading = float(np.arctan2(end[1] - begin[1], end[0] - begin[0]))
            return [
                MoverPlan(
                    kind=FORKLIFT,
                    half_length=half_length,
                    half_width=half_width,
                    pose=(*begin, heading),
                    speed=0.5,
                    waypoints=np.array([end, begin]),
                    pauses=np.array([2.0, 2.0]),
                )
            ]
    return []


def draw_pushables(rng, room: StaticRoom, settings: Room, start, goal, movers: list[MoverPlan]) -> None:
    """Add light boxes on the floor that give way when pushed, off the lane of a forklift."""
    lanes = [(*m.pose[:2], *m.waypoints[0]) for m in movers if m.kind == FORKLIFT]
    boxes: list[MoverPlan] = []
    for _ in range(draw_count(rng, settings.pushable_boxes)):
        half = rng.uniform(0.12, 0.2)
        point = free_point(rng, room, half * np.sqrt(2) + 0.42)
        angle = rng.uniform(0, np.pi / 2)
        if point is None or min(np.hypot(*(point - start[:2])), np.hypot(*(point - goal))) < 1.2:
            continue
        if any(distance_to_line(*point, *lane) < 1.0 for lane in lanes) or not _is_apart(movers, point, half * 1.42):
            continue
        if all(np.hypot(*(point - np.array(m.pose[:2]))) > 1.3 for m in boxes):
            boxes.append(MoverPlan(kind=PUSHABLE, half_length=half, half_width=half, pose=(*point, angle), mass=4.0))
    movers += boxes
