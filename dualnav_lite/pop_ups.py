"""Pop-up boxes: when one may fire, and where it is fair."""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.kernels.clearance import line_clearance, point_clearance
from dualnav_lite.kernels.geodesic import geodesic
from dualnav_lite.scenario import PopUp

# The place ahead is nearer to the goal by this share of its distance: a robot that is still turning has no way yet.
ON_THE_WAY = 0.75
FIRES_BEFORE_M = 1.0  # clear of the robot's own place when a passage is looked for


@dataclass(frozen=True)
class PopUpPlan:
    """One pop-up box: when it fires, and four draws of where, tried in order until one is fair.

    Attributes:
        trigger_m: odometer reading from which it may fire.
        sides: (4,) +1 from the left, -1 from the right.
        side_m: (4,) how far beside its stopping place it hides [m].
        stop_m: (4,) where it stops, left of the robot's line [m].
    """

    trigger_m: float
    sides: np.ndarray
    side_m: np.ndarray
    stop_m: np.ndarray
    settings: PopUp

    def place(self, pose, half: float, room, goal, goal_field, others):
        """Where the box appears and stops for a robot at `pose`, or None where it would not be fair now.

        Args:
            pose: (3,) true robot pose.
            half: half size of the box [m].
            room: `rooms.StaticRoom`.
            goal: (2,) [m]; goal_field: (>= H, >= W) way to it from each cell of the room [m].
            others: (x, y, radius, gap) of things to keep `gap` from [m].

        Returns:
            (begin (2,), stop (2,)) of the box's centre, world frame, or None.
        """
        s = self.settings
        ahead = np.array([np.cos(pose[2]), np.sin(pose[2])])
        left = np.array([-ahead[1], ahead[0]])
        for side, aside, offset in zip(self.sides, self.side_m, self.stop_m, strict=True):
            if s.placement == "head_on":
                begin = pose[:2] + s.ahead_m * ahead + offset * left
                stop = begin - s.ahead_m * ahead
                blocked = begin
            else:
                stop = pose[:2] + s.ahead_m * ahead + offset * left
                begin = stop + side * aside * left
                blocked = stop
            inside = 0.0 < blocked[0] < room.width and 0.0 < blocked[1] < room.height
            if not inside or np.hypot(*(blocked - goal)) < s.goal_gap_m:
                continue
            if goal_field[room.cell(pose)] - goal_field[room.cell(blocked)] < ON_THE_WAY * s.ahead_m:
                continue
            reach = half * np.sqrt(2.0)
            if line_clearance(*begin, *stop, room.boxes, room.width, room.height) < reach:
                continue
            if any(_near_line(x, y, begin, stop) < radius + reach + gap for x, y, radius, gap in others):
                continue
            hidden = line_clearance(*pose[:2], *begin, room.boxes, room.width, room.height) < 0.02
            if s.placement == "cover" and not hidden:
                continue
            if self._leaves_passage(blocked, left, half, room) and _goal_stays_reachable(
                pose, blocked, reach, room, goal
            ):
                return begin, stop
        return None

    def _leaves_passage(self, blocked, left, half: float, room) -> bool:
        """At least one side of the box keeps a passage of the set width."""
        width = self.settings.passage_m
        for side in (-1.0, 1.0):
            middle = blocked + side * (half + 0.5 * width) * left
            if point_clearance(*middle, room.boxes, room.width, room.height) >= 0.5 * width:
                return True
        return False


def _near_line(x, y, begin, end) -> float:
    """Distance of a point from the line begin-end [m]."""
    along = end - begin
    share = np.clip(np.dot([x - begin[0], y - begin[1]], along) / max(np.dot(along, along), 1e-12), 0.0, 1.0)
    return float(np.hypot(x - begin[0] - share * along[0], y - begin[1] - share * along[1]))


def _goal_stays_reachable(pose, blocked, reach: float, room, goal) -> bool:
    """A way round the box to the goal exists that a hull of 0.30 m radius fits through."""
    rows, columns = room.clearance.shape
    resolution = room.width / columns
    y = (np.arange(rows)[:, None] + 0.5) * resolution
    x = (np.arange(columns)[None, :] + 0.5) * resolution
    solid = (room.clearance < 0.30) & (np.hypot(x - pose[0], y - pose[1]) > FIRES_BEFORE_M)
    solid |= np.hypot(x - blocked[0], y - blocked[1]) < reach + 0.30
    field_cells = geodesic(np.where(solid, np.inf, 1.0), *room.cell(goal))
    return bool(np.isfinite(field_cells[room.cell(pose)]))
