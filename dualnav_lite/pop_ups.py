"""Pop-up boxes: when one may fire, and where it is fair."""

from dataclasses import dataclass

import cv2
import numpy as np

from dualnav_lite.kernels.clearance import line_clearance, point_clearance
from dualnav_lite.rooms import FIELD_RESOLUTION_M
from dualnav_lite.scenario import PopUp

# The place ahead is nearer to the goal by this share of its distance: a robot that is still turning has no way yet.
ON_THE_WAY = 0.75
FIRES_BEFORE_M = 1.0  # clear of the robot's own place when a passage is looked for
LAST_CHANCES_M = 2.0  # of way, the last on which a box may fire: on these one that found no cover comes in view


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

    def place(self, pose, half: float, room, goal, goal_field, others, must_hide: bool = False):
        """Where the box appears and stops for a robot at `pose`, or None where it would not be fair now.

        Args:
            pose: (3,) true robot pose.
            half: half size of the box [m].
            room: `rooms.StaticRoom`.
            goal: (2,) [m]; goal_field: (>= H, >= W) way to it from each cell of the room [m].
            others: (x, y, radius, gap) of things to keep `gap` from [m].
            must_hide: no box that comes from cover appears in view, not even in the last chances.

        Returns:
            (begin (2,), stop (2,)) of the box's centre, world frame, or None.
        """
        s, px, py = self.settings, float(pose[0]), float(pose[1])
        ahead_x, ahead_y = float(np.cos(pose[2])), float(np.sin(pose[2]))
        left_x, left_y, reach = -ahead_y, ahead_x, half * np.sqrt(2.0)
        way_here = goal_field[room.cell(pose)]
        hides = s.placement == "cover" and (must_hide or way_here > s.ahead_m + s.goal_gap_m + LAST_CHANCES_M)
        for side, aside, offset in zip(self.sides.tolist(), self.side_m.tolist(), self.stop_m.tolist(), strict=True):
            front = px + s.ahead_m * ahead_x + offset * left_x, py + s.ahead_m * ahead_y + offset * left_y
            if s.placement == "head_on":
                begin = blocked = front
                stop = front[0] - s.ahead_m * ahead_x, front[1] - s.ahead_m * ahead_y
            else:
                begin = front[0] + side * aside * left_x, front[1] + side * aside * left_y
                stop = blocked = front
            inside = 0.0 < blocked[0] < room.width and 0.0 < blocked[1] < room.height
            if not inside or np.hypot(blocked[0] - goal[0], blocked[1] - goal[1]) < s.goal_gap_m:
                continue
            if way_here - goal_field[room.cell(blocked)] < ON_THE_WAY * s.ahead_m:
                continue
            if line_clearance(*begin, *stop, room.boxes, room.width, room.height) < reach:
                continue
            if any(_near_line(x, y, begin, stop) < radius + reach + gap for x, y, radius, gap in others):
                continue
            if hides and line_clearance(px, py, *begin, room.boxes, room.width, room.height) >= 0.02:
                continue  # in view
            if self._leaves_passage(blocked, (left_x, left_y), half, room) and _goal_stays_reachable(
                pose, blocked, reach, room, goal
            ):
                return np.array(begin), np.array(stop)
        return None

    def _leaves_passage(self, blocked, left, half: float, room) -> bool:
        """At least one side of the box keeps a passage of the set width."""
        width = self.settings.passage_m
        for side in (-1.0, 1.0):
            x, y = (blocked[k] + side * (half + 0.5 * width) * left[k] for k in range(2))
            if point_clearance(x, y, room.boxes, room.width, room.height) >= 0.5 * width:
                return True
        return False


def _near_line(x, y, begin, end) -> float:
    """Distance of a point from the line begin-end [m]."""
    begin = np.asarray(begin)
    along = np.asarray(end) - begin
    share = np.clip(np.dot([x - begin[0], y - begin[1]], along) / max(np.dot(along, along), 1e-12), 0.0, 1.0)
    return float(np.hypot(x - begin[0] - share * along[0], y - begin[1] - share * along[1]))


def _goal_stays_reachable(pose, blocked, reach: float, room, goal) -> bool:
    """A way round the box to the goal exists that a hull of 0.30 m radius fits through."""
    solid = room.clearance < 0.30
    window, distance = _around(pose, FIRES_BEFORE_M, room)
    solid[window] &= distance > FIRES_BEFORE_M
    window, distance = _around(blocked, reach + 0.30, room)
    solid[window] |= distance < reach + 0.30
    here, there = room.cell(pose), room.cell(goal)
    solid[there] = False
    areas = cv2.connectedComponents((~solid).astype(np.uint8), connectivity=4)[1]
    return bool(areas[here] == areas[there])


def _around(point, radius: float, room):
    """The part of a room's grid that holds a disc, as slices, and how far its cells are from the middle [m]."""
    rows, columns = room.clearance.shape
    (x0, x1), (y0, y1) = (
        (max(int(begin / FIELD_RESOLUTION_M) - 1, 0), min(int(end / FIELD_RESOLUTION_M) + 2, count))
        for begin, end, count in (
            (point[0] - radius, point[0] + radius, columns),
            (point[1] - radius, point[1] + radius, rows),
        )
    )
    y = (np.arange(y0, y1)[:, None] + 0.5) * FIELD_RESOLUTION_M
    x = (np.arange(x0, x1)[None, :] + 0.5) * FIELD_RESOLUTION_M
    return (slice(y0, y1), slice(x0, x1)), np.hypot(x - point[0], y - point[1])
