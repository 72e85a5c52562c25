"""What the worlds look like right now, as arrays: every line and circle that a beam or a hull can meet."""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.geometry import box_segments
from dualnav_lite.semantics import Surface

MAX_SEGMENTS = 160
MAX_CIRCLES = 24


@dataclass
class Scene:
    """Lines and circles of n worlds, world frame, in metres. Rows past `num_*` are unused.

    Attributes:
        segments: (n, S, 4) x0, y0, x1, y1 with the solid on the left of the direction of travel.
        segment_surface: (n, S) `Surface` of each line.
        num_segments: (n,) lines in use; the static ones come first.
        circles: (n, C, 3) x, y, radius.
        circle_surface: (n, C) `Surface` of each circle; `PHANTOM` is met by beams only.
        num_circles: (n,) circles in use.
    """

    segments: np.ndarray
    segment_surface: np.ndarray
    num_segments: np.ndarray
    circles: np.ndarray
    circle_surface: np.ndarray
    num_circles: np.ndarray

    @classmethod
    def empty(cls, num_envs: int) -> "Scene":
        """A scene with nothing in it."""
        return cls(
            np.zeros((num_envs, MAX_SEGMENTS, 4)),
            np.zeros((num_envs, MAX_SEGMENTS), np.uint8),
            np.zeros(num_envs, np.int64),
            np.zeros((num_envs, MAX_CIRCLES, 3)),
            np.zeros((num_envs, MAX_CIRCLES), np.uint8),
            np.zeros(num_envs, np.int64),
        )

    def add_segments(self, world: int, segments, surface) -> None:
        """Append (k, 4) lines of one surface (or one surface a line) to a world."""
        segments = np.asarray(segments, float).reshape(-1, 4)
        start = self.num_segments[world]
        stop = start + len(segments)
        if stop > MAX_SEGMENTS:
            raise ValueError(f"a scene holds at most {MAX_SEGMENTS} segments a world, asked for {stop}")
        self.segments[world, start:stop] = segments
        self.segment_surface[world, start:stop] = surface
        self.num_segments[world] = stop

    def add_boxes(self, world: int, boxes, surface) -> None:
        """Append the sides of (k, 5) oriented boxes (x, y, angle, half length, half width)."""
        boxes = np.asarray(boxes, float).reshape(-1, 5)
        surfaces = np.repeat(np.broadcast_to(surface, len(boxes)), 4)
        self.add_segments(world, box_segments(boxes).reshape(-1, 4), surfaces)

    def add_room(self, world: int, width: float, height: float) -> None:
        """Append the four outer walls of the room [0, width] x [0, height]."""
        w, h = width, height
        self.add_segments(world, [[0, 0, 0, h], [0, h, w, h], [w, h, w, 0], [w, 0, 0, 0]], Surface.WALL)

    def add_circles(self, world: int, circles, surface) -> None:
        """Append (k, 3) circles of one surface to a world."""
        circles = np.asarray(circles, float).reshape(-1, 3)
        start = self.num_circles[world]
        stop = start + len(circles)
        if stop > MAX_CIRCLES:
            raise ValueError(f"a scene holds at most {MAX_CIRCLES} circles a world, asked for {stop}")
        self.circles[world, start:stop] = circles
        self.circle_surface[world, start:stop] = surface
        self.num_circles[world] = stop
