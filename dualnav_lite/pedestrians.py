"""People and other movers of n worlds: what was planned for them at generation and what they do next."""

from dataclasses import dataclass, field

import numpy as np

from dualnav_lite.kernels import movers as kernel
from dualnav_lite.kernels.movers import (
    CROSSING,
    FORKLIFT,
    NONE,
    PEDESTRIAN,
    POP_UP,
    PUSHABLE,
    SLIDING,
    UNAWARE,
    WAITING,
)
from dualnav_lite.pop_ups import PopUpPlan
from dualnav_lite.scenario import MAX_MOVERS
from dualnav_lite.semantics import Surface

__all__ = ["CROSSING", "FORKLIFT", "NONE", "PEDESTRIAN", "POP_UP", "PUSHABLE", "UNAWARE", "CrowdPlan", "MoverPlan"]

SURFACE_OF_KIND = np.zeros(7, np.uint8)
SURFACE_OF_KIND[[PEDESTRIAN, CROSSING, UNAWARE]] = Surface.PERSON
SURFACE_OF_KIND[[POP_UP, PUSHABLE, FORKLIFT]] = Surface.BOX

MAX_WAYPOINTS = 8


@dataclass(frozen=True)
class MoverPlan:
    """One mover at the start of an episode; a circle where `radius` is positive, else a box.

    Attributes:
        pose: x, y [m], heading [rad], world frame.
        waypoints: (w, 2) visited in turn, for pedestrians and forklifts [m].
        pauses: (w,) rest at each waypoint [s].
        waits: stands until the crossing group starts.
    """

    kind: int
    pose: tuple
    radius: float = 0.0
    half_length: float = 0.0
    half_width: float = 0.0
    speed: float = 0.0
    mass: float = 70.0
    waypoints: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    pauses: np.ndarray = field(default_factory=lambda: np.zeros(0))
    waits: bool = False

    @property
    def reach(self) -> float:
        """Radius of the circle round the mover [m]."""
        return self.radius if self.radius > 0 else float(np.hypot(self.half_length, self.half_width))


@dataclass(frozen=True)
class CrowdPlan:
    """When and how a group crosses the robot's journey (SPEC 8, `crowd_crossing`).

    Attributes:
        line_point: (2,) where the group's middle meets the journey [m].
        journey, across: (2,) unit vectors of the robot's journey and the group's walk.
        lead_s: the group starts when the robot, at its present speed, is this short of the line.
        travel_m: length of one crossing.
        pauses: (8,) rests between crossings [s], used in turn.
    """

    line_point: np.ndarray
    journey: np.ndarray
    across: np.ndarray
    lead_s: float
    travel_m: float
    speed: float
    pauses: np.ndarray


class Movers:
    """Movers of n worlds as arrays; row [i, m] is mover m of world i.

    Attributes:
        kinds: (n, M) kind codes; radii: (n, M) radius of the circle round each; halves: (n, M, 2) of boxes, else 0.
        states: (n, M, 5) x, y, heading, vx, vy; written back by the world after each control step.
        active: (n, M) there to be seen and hit; a pop-up box is not before it fires.
        velocities: (n, M, 2) wanted in the next control step.
        events: (n,) events so far; first_event_s: (n,) time of the first, nan before it.
    """

    def __init__(self, num_envs: int):
        n, m = num_envs, MAX_MOVERS
        self.kinds = np.zeros((n, m), np.uint8)
        self.radii = np.zeros((n, m))
        self.halves = np.zeros((n, m, 2))
        self.states = np.zeros((n, m, 5))
        self.active = np.zeros((n, m), bool)
        self.speeds = np.zeros((n, m))
        self.waypoints = np.zeros((n, m, MAX_WAYPOINTS, 2))
        self.pauses = np.zeros((n, m, MAX_WAYPOINTS))
        self.counts = np.zeros((n, m), np.int64)
        self.index = np.zeros((n, m), np.int64)
        self.timers = np.zeros((n, m))
        self.blocked_s = np.zeros((n, m))
        self.waits = np.zeros((n, m), bool)
        self.stops = np.zeros((n, m, 2))
        self.velocities = np.zeros((n, m, 2))
        self.has_group = np.zeros(n, bool)
        self.group_plan = np.zeros((n, 7))
        self.group_across = np.zeros((n, 2))
        self.group_pauses = np.zeros((n, 8))
        self.group_phase = np.zeros(n, np.int64)
        self.group_timer = np.zeros(n)
        self.group_leg = np.zeros(n, np.int64)
        self.group_place = np.zeros(n)
        self.events = np.zeros(n, np.int64)
        self.first_event_s = np.full(n, np.nan)
        self._pop_ups: list[list[tuple[int, PopUpPlan]]] = [[] for _ in range(n)]

    def reset(self, world: int, layout) -> None:
        """Place the movers of a new layout."""
        self.kinds[world] = NONE
        self.active[world] = False
        self.states[world] = 0.0
        self.index[world] = 0
        self.timers[world] = 0.0
        self.blocked_s[world] = 0.0
        for m, plan in enumerate(layout.movers):
            self.kinds[world, m] = plan.kind
            self.radii[world, m] = plan.reach
            self.halves[world, m] = plan.half_length, plan.half_width
            self.states[world, m, :3] = plan.pose
            self.active[world, m] = plan.kind != POP_UP
            self.speeds[world, m] = plan.speed
            count = len(plan.waypoints)
            self.counts[world, m] = count
            self.waypoints[world, m, :count] = plan.waypoints
            self.pauses[world, m, :count] = plan.pauses[:count]
            self.waits[world, m] = plan.waits
        crowd = layout.crowd
        self.has_group[world] = crowd is not None
        self.group_phase[world] = WAITING
        self.group_timer[world] = self.group_place[world] = 0.0
        self.group_leg[world] = 0
        if crowd is not None:
            self.group_plan[world] = *crowd.line_point, *crowd.journey, crowd.lead_s, crowd.travel_m, crowd.speed
            self.group_across[world] = crowd.across
            self.group_pauses[world] = crowd.pauses
        boxes = [m for m, plan in enumerate(layout.movers) if plan.kind == POP_UP]
        self._pop_ups[world] = list(zip(boxes, layout.pop_ups, strict=True))
        is_standing = crowd is None and not layout.pop_ups  # light, radio, battery: the event is there from the start
        self.events[world] = 1 if is_standing else 0
        self.first_event_s[world] = 0.0 if is_standing else np.nan

    def disarm(self, world: int) -> None:
        """No pop-up box fires in this world any more: its twin that keeps them shows what they change."""
        self._pop_ups[world] = []

    def fire(self, world: int, odometer_m: float, pose, room, goal, goal_field, time_s: float):
        """Let the next due pop-up box appear if it is fair now.

        Returns:
            The mover's row if it has just appeared (its `states` hold where), else None.
        """
        waiting = self._pop_ups[world]
        if not waiting or odometer_m < waiting[0][1].trigger_m:
            return None
        m, plan = waiting[0]
        others = []
        for other in range(MAX_MOVERS):
            if self.active[world, other]:
                is_box = self.kinds[world, other] == POP_UP
                x, y = self.states[world, other, :2]
                gap = plan.settings.box_gap_m if is_box else 0.3
                others.append((x, y, self.radii[world, other], gap - (2 * self.radii[world, other] if is_box else 0.0)))
        placed = plan.place(pose, float(self.halves[world, m, 0]), room, goal, goal_field, others)
        if placed is None:
            return None
        begin, stop = placed
        waiting.pop(0)
        self.states[world, m] = *begin, pose[2], 0.0, 0.0
        self.stops[world, m] = stop
        self.speeds[world, m] = plan.settings.speed_m_s
        self.index[world, m] = SLIDING
        self.active[world, m] = True
        self._count_event(world, time_s)
        return m

    def move(self, robots, robot_v, hull: float, segments, num_static, dt: float, times_s) -> None:
        """Set `velocities` for the next control step.

        Args:
            robots: (n, 3) true poses; robot_v: (n,) forward speeds [m/s]; hull: radius [m].
            segments, num_static: (n, S, 4), (n,) static lines, world frame.
            dt: control step [s]; times_s: (n,) time since the reset [s].
        """
        waited = self.has_group & (self.group_phase == WAITING)
        kernel.move(
            self.kinds,
            self.radii,
            self.halves,
            self.states,
            self.active,
            self.speeds,
            self.waypoints,
            self.pauses,
            self.counts,
            self.index,
            self.timers,
            self.blocked_s,
            self.waits,
            self.stops,
            self.has_group,
            self.group_plan,
            self.group_across,
            self.group_pauses,
            self.group_phase,
            self.group_timer,
            self.group_leg,
            self.group_place,
            robots,
            robot_v,
            hull,
            segments,
            num_static,
            dt,
            self.velocities,
        )
        if waited.any():
            for world in np.flatnonzero(waited & (self.group_phase != WAITING)):
                self._count_event(world, times_s[world])

    def _count_event(self, world: int, time_s: float) -> None:
        if self.events[world] == 0:
            self.first_event_s[world] = time_s
        self.events[world] += 1

    def due(self, odometers_m) -> list[int]:
        """Worlds whose next pop-up box may fire at these odometer readings [m]."""
        return [i for i, waiting in enumerate(self._pop_ups) if waiting and odometers_m[i] >= waiting[0][1].trigger_m]
