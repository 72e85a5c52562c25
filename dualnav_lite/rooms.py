"""A room with its walls and furniture, and how one is drawn."""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from dualnav_lite.geometry import box_segments
from dualnav_lite.kernels.clearance import line_clearance, point_clearance, static_clearance
from dualnav_lite.kernels.geodesic import geodesic
from dualnav_lite.scenario import DOOR_END_M, Range, Room
from dualnav_lite.semantics import Surface

FIELD_RESOLUTION_M = 0.1
WALL_HALF_THICKNESS_M = 0.06
JAMB_HALF_LENGTH_M = 0.05
POINT_TRIES = 60  # for a free point
PATH_MARGIN_M = 0.10  # kept free beside the hull where a way is asked for


@dataclass(frozen=True)
class StaticRoom:
    """Room [0, width] x [0, height] with its walls and furniture.

    Attributes:
        boxes: (b, 5) inner walls, jambs and furniture: x, y, angle, half length, half width.
        surfaces: (b,) `Surface` of each box.
        clearance: (H, W) distance from each 0.1 m cell's centre to the nearest solid [m].
    """

    width: float
    height: float
    boxes: np.ndarray
    surfaces: np.ndarray
    clearance: np.ndarray = field(repr=False)

    def cell(self, point) -> tuple[int, int]:
        """(iy, ix) of the field cell that holds a point, clipped to the room."""
        rows, columns = self.clearance.shape
        ix = min(max(int(point[0] / FIELD_RESOLUTION_M), 0), columns - 1)
        iy = min(max(int(point[1] / FIELD_RESOLUTION_M), 0), rows - 1)
        return iy, ix

    def areas(self, keep_m: float, circles=()) -> np.ndarray:
        """(H, W) number of the connected area each cell belongs to, 0 where it is nearer than `keep_m` to a solid.

        `circles` holds (x, y, radius) of things that stand in the room besides [m].
        """
        free = self.clearance >= keep_m
        rows, columns = np.indices(free.shape)
        for x, y, radius in circles:
            gap = np.hypot((columns + 0.5) * FIELD_RESOLUTION_M - x, (rows + 0.5) * FIELD_RESOLUTION_M - y) - radius
            free &= gap >= keep_m
        return cv2.connectedComponents(free.astype(np.uint8), connectivity=4)[1]

    def progress_field(self, goal, hull_radius: float) -> np.ndarray:
        """(H, W) way to the goal that is also defined close to solids, where it is dear [m].

        Cells the hull touches cost 20 times their length and cells within `PATH_MARGIN_M` more 3 times, so the field
        leads a robot that grazes something away from it; only solids themselves are undefined (inf).
        """
        cost = np.ones_like(self.clearance)
        cost[self.clearance < hull_radius + PATH_MARGIN_M] = 3.0
        cost[self.clearance < hull_radius] = 20.0
        cost[self.clearance <= 0.0] = np.inf
        return geodesic(cost, *self.cell(goal)) * FIELD_RESOLUTION_M

    def segments(self) -> np.ndarray:
        """(4 b, 4) sides of the boxes."""
        return box_segments(self.boxes).reshape(-1, 4)


def draw(rng: np.random.Generator, interval: Range) -> float:
    """Uniform number from an interval."""
    return float(rng.uniform(interval.low, interval.high))


def draw_count(rng: np.random.Generator, interval: Range) -> int:
    """Uniform whole number from an interval, both ends included."""
    return int(rng.integers(int(interval.low), int(interval.high) + 1))


def _room(width, height, boxes, surfaces) -> StaticRoom:
    boxes = np.array(boxes, float).reshape(-1, 5)
    clearance = static_clearance(boxes, width, height, FIELD_RESOLUTION_M)
    return StaticRoom(width, height, boxes, np.array(surfaces, np.uint8), clearance)


def draw_room(rng, settings: Room, is_walled: bool) -> StaticRoom:
    """A room, with an inner wall and its door if wanted; furniture too unless it is a hall."""
    width, height = draw(rng, settings.size_m), draw(rng, settings.size_m)
    boxes, surfaces, lanes = [], [], []
    if is_walled:
        for box, surface in _inner_wall(rng, width, height, draw(rng, settings.door_width_m)):
            boxes.append(box)
            surfaces.append(surface)
        lanes = [_doorway(*[box for box, surface in zip(boxes, surfaces, strict=True) if surface == Surface.DOOR])]
    room = _room(width, height, boxes, surfaces)
    return room if settings.hall else furnish(rng, room, settings, lanes)


def _doorway(jamb, other_jamb):
    """Strip through a door, 0.9 m to either side, as (x0, y0, x1, y1, half width)."""
    x, y = 0.5 * (jamb[0] + other_jamb[0]), 0.5 * (jamb[1] + other_jamb[1])
    half = 0.5 * math.hypot(jamb[0] - other_jamb[0], jamb[1] - other_jamb[1])
    dx, dy = (0.0, 0.9) if abs(jamb[1] - other_jamb[1]) < 1e-9 else (0.9, 0.0)
    return x - dx, y - dy, x + dx, y + dy, half


def _inner_wall(rng, width, height, door):
    """Boxes of a wall across the room with one door, each with its surface; the opening is free."""
    upright = rng.random() < 0.5
    length, across = (height, width) if upright else (width, height)
    position = rng.uniform(0.38, 0.62) * across
    left = rng.uniform(DOOR_END_M, max(DOOR_END_M, length - DOOR_END_M - door))
    frame = 2 * JAMB_HALF_LENGTH_M
    pieces = [
        (0.0, left - frame, Surface.WALL),
        (left - frame, left, Surface.DOOR),
        (left + door, left + door + frame, Surface.DOOR),
        (left + door + frame, length, Surface.WALL),
    ]
    for begin, end, surface in pieces:
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        centre = (position, middle) if upright else (middle, position)
        yield (*centre, np.pi / 2 if upright else 0.0, half, WALL_HALF_THICKNESS_M), surface


def furnish(rng, room: StaticRoom, settings: Room, lanes) -> StaticRoom:
    """The room with furniture: boxes at any angle that touch their neighbours or leave a passage, off the lanes.

    `lanes` holds (x0, y0, x1, y1, half width) strips that stay free.
    """
    boxes = list(map(tuple, room.boxes))
    surfaces = list(room.surfaces)
    for _ in range(draw_count(rng, settings.furniture)):
        half_length, half_width = rng.uniform(0.2, 0.75), rng.uniform(0.15, 0.4)
        reach = np.hypot(half_length, half_width)
        for _ in range(8):
            x = rng.uniform(0.2, room.width - 0.2)
            y = rng.uniform(0.2, room.height - 0.2)
            if any(distance_to_line(x, y, *lane[:4]) < lane[4] + reach for lane in lanes):
                continue
            gap = point_clearance(x, y, np.array(boxes, float).reshape(-1, 5), room.width, room.height)
            # Against a wall or another piece, or with a passage of 0.85 m: nothing in between to get stuck in.
            if gap < 0.6 * half_width or gap > reach + 0.85:
                boxes.append((x, y, rng.uniform(0, np.pi), half_length, half_width))
                surfaces.append(Surface.FURNITURE)
                break
    return _room(room.width, room.height, boxes, surfaces)


def distance_to_line(x, y, x0, y0, x1, y1) -> float:
    """Distance of the point (x, y) from the line between two others [m]."""
    ex, ey = x1 - x0, y1 - y0
    share = min(max(((x - x0) * ex + (y - y0) * ey) / max(ex * ex + ey * ey, 1e-12), 0.0), 1.0)
    return math.hypot(x - x0 - share * ex, y - y0 - share * ey)


def free_point(rng, room: StaticRoom, clearance: float):
    """A point at least `clearance` from every solid, or None."""
    for _ in range(POINT_TRIES):
        point = np.array([rng.uniform(0.0, room.width), rng.uniform(0.0, room.height)])
        if room.clearance[room.cell(point)] >= clearance:
            return point
    return None


def line_is_free(room: StaticRoom, begin, end, keep: float) -> bool:
    """Whether the line between two points keeps `keep` [m] from every solid."""
    return line_clearance(*begin, *end, room.boxes, room.width, room.height) >= keep
