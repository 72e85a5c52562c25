"""The room of one world from above with everything in it, drawn on a canvas. Reads the world, never changes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dualnav_lite.canvas import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WHITE,
    YELLOW,
    Canvas,
    Theme,
    coloured,
    mixed,
)
from dualnav_lite.geometry import beam_directions, box_corners, to_world
from dualnav_lite.pedestrians import CROSSING, FORKLIFT, PEDESTRIAN, POP_UP, PUSHABLE, UNAWARE
from dualnav_lite.semantics import Surface

if TYPE_CHECKING:
    from dualnav_lite.vector_env import DynamicNavVectorEnv

WALL_M = 0.14  # thickness drawn for the outer walls
VIEW_M = 6.4  # side of the observation
TRAIL_STEPS = 600  # of a three-hour run only the last minute is drawn
TRAIL_PIECES = 8  # of one colour each
JUMP_M = 0.3  # a robot that was carried away after a contact leaves no line
MOVING_M_S = 0.05
PHANTOM_DASHES = 12
COLOUR_OF_KIND = {
    PEDESTRIAN: ORANGE,
    CROSSING: ORANGE,
    UNAWARE: ORANGE,
    POP_UP: VERMILLION,
    PUSHABLE: SKY,
    FORKLIFT: YELLOW,
}
_UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # corners of a square


class FloorPlan:
    """Paints one world's room into a square of a canvas.

    Args:
        canvas: to draw on.
        env: after its first reset.
        world: which of its worlds.
        theme: colours.
        left, top, side: the square [points]; the room with its walls fills it in one direction and is in its middle
            in the other, or at its top left corner unless `centred`.
    """

    def __init__(
        self,
        canvas: Canvas,
        env: DynamicNavVectorEnv,
        world: int,
        theme: Theme,
        left: float,
        top: float,
        side: float,
        centred: bool = True,
    ):
        self.canvas, self.env, self.world, self.theme = canvas, env, world, theme
        self.room = env.sim.layouts[world].room
        self._size = np.array([self.room.width, self.room.height])
        self._scale = side / (self._size.max() + 2 * WALL_M)
        spare = (side - self._scale * (self._size + 2 * WALL_M)) * (0.5 if centred else 0.0)
        self._left = left + spare[0] + WALL_M * self._scale
        self._bottom = top + spare[1] + (self.room.height + WALL_M) * self._scale

    def _at(self, points) -> np.ndarray:
        """Points of the room (..., 2) [m] on the canvas, whose y grows downward."""
        points = np.asarray(points, float)
        return np.array([self._left, self._bottom]) + self._scale * points * [1.0, -1.0]

    def paint(self) -> None:
        """Everything, from the floor up."""
        env, world = self.env, self.world
        idle = bool(env.task.idle[world])
        self._paint_solids()
        if not idle:
            self._paint_goal()
        self._paint_trail(np.array(env.trails[world][-TRAIL_STEPS:])[:, :2])
        self._paint_phantoms()
        self._paint_movers()
        self._paint_scan(env.percept.scans[world])
        self._paint_frame()
        if not idle:
            self._paint_guide()
        self._paint_robot()

    def _paint_solids(self) -> None:
        canvas, theme, room = self.canvas, self.theme, self.room
        canvas.polygon(self._at(_UNIT * (self._size + 2 * WALL_M) - WALL_M), theme.wall)
        canvas.polygon(self._at(_UNIT * self._size), theme.floor)
        for x in range(1, int(np.ceil(room.width))):
            canvas.line(self._at([[x, 0.0], [x, room.height]]), theme.grid)
        for y in range(1, int(np.ceil(room.height))):
            canvas.line(self._at([[0.0, y], [room.width, y]]), theme.grid)
        fills = {Surface.WALL: theme.wall, Surface.DOOR: PURPLE, Surface.FURNITURE: theme.furniture}
        for corners, surface in zip(box_corners(room.boxes), room.surfaces, strict=True):
            edge = mixed(theme.furniture, theme.edge, 0.5) if surface == Surface.FURNITURE else None
            canvas.polygon(self._at(corners), fills[Surface(surface)], edge)

    def _paint_goal(self) -> None:
        sim, centre = self.env.sim, self._at(self.env.sim.goals[self.world])
        radius = sim.scenarios[self.world].goal_radius_m * self._scale
        self.canvas.circle(centre, radius, mixed(GREEN, self.theme.floor, 0.75), GREEN, 2.0)
        self.canvas.circle(centre, 3.0, GREEN)

    def _paint_trail(self, trail) -> None:
        """Where the robot has been, fading with age."""
        points, theme = self._at(trail), self.theme
        edges = np.linspace(0, len(points) - 1, TRAIL_PIECES + 1).round().astype(int)
        for k in range(TRAIL_PIECES):
            part = slice(edges[k], edges[k + 1] + 1)
            jumps = np.flatnonzero(np.hypot(*np.diff(trail[part], axis=0).T) > JUMP_M) + 1
            for piece in np.split(points[part], jumps):
                if len(piece) > 1:
                    self.canvas.line(piece, mixed(theme.floor, theme.trail, 0.25 + 0.65 * k / (TRAIL_PIECES - 1)), 2.5)

    def _paint_phantoms(self) -> None:
        scene, world = self.env.sim.scene, self.world
        ghosts = np.flatnonzero(scene.circle_surface[world, : scene.num_circles[world]] == Surface.PHANTOM)
        turn = np.linspace(0.0, 2.0 * np.pi, 4 * PHANTOM_DASHES + 1)
        for x, y, radius in scene.circles[world, ghosts]:
            ring = np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], axis=1)
            for k in range(0, 4 * PHANTOM_DASHES, 4):
                self.canvas.line(self._at(ring[k : k + 3]), PURPLE, 1.5)

    def _paint_movers(self) -> None:
        """People and boxes, each with the way it goes in one second."""
        movers, canvas, theme = self.env.sim.movers, self.canvas, self.theme
        rows = np.flatnonzero(movers.active[self.world])
        for m in rows:
            state, halves = movers.states[self.world, m], movers.halves[self.world, m]
            fill = COLOUR_OF_KIND[int(movers.kinds[self.world, m])]
            if halves[0] > 0:
                canvas.polygon(self._at(box_corners([*state[:3], *halves])), fill, theme.edge, 1.2)
            else:
                radius = movers.radii[self.world, m] * self._scale
                canvas.circle(self._at(state[:2]), radius, fill, theme.edge, 1.2)
        for x, y, _, vx, vy in movers.states[self.world, rows]:
            if np.hypot(vx, vy) > MOVING_M_S:
                canvas.arrow(self._at([x, y]), self._at([x + vx, y + vy]), theme.ink, 1.6, 7.0)

    def _paint_scan(self, scan) -> None:
        """Where beams ended, seen from the true pose: the sensor's noise shows, the drift of the odometry does not."""
        hit = (scan[:, 1] > 0.0) & (scan[:, 0] < self.env.config.lidar.range_max_m)
        directions = np.stack(beam_directions(len(scan)), axis=1)[hit]
        points = to_world(scan[hit, :1] * directions, self.env.sim.poses[self.world])
        inside = ((points > -WALL_M) & (points < self._size + WALL_M)).all(axis=1)
        # The palest colours of the map would vanish on the floor.
        shade = coloured(0.35 + 0.65 * scan[hit, 1], "intensity", self.theme.name)
        self.canvas.dots(self._at(points[inside]), shade[inside], 1.3, 0.75)

    def _paint_frame(self) -> None:
        """Border of what the observation covers, where it lies inside the room."""
        corners = to_world(VIEW_M * (_UNIT - 0.5), self.env.sim.poses[self.world])
        for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            points = begin + np.linspace(0.0, 1.0, 65)[:, None] * (end - begin)
            inside = ((points >= 0.0) & (points <= self._size)).all(axis=1)
            for k in range(0, 64, 2):
                if inside[k : k + 2].all():
                    self.canvas.line(self._at(points[k : k + 2]), self.theme.quiet, 0.8)

    def _paint_guide(self) -> None:
        """Planned way and guide point, turned from the robot's frame by its true pose."""
        percept, pose = self.env.percept, self.env.sim.poses[self.world]
        self.canvas.line(self._at(to_world(percept.path_robot[self.world], pose)), GREEN, 1.8, dash=4.0)
        point = self._at(to_world(percept.guide_robot[self.world], pose))
        self.canvas.polygon(point + np.array([[0, -6], [6, 0], [0, 6], [-6, 0]]), GREEN, WHITE, 1.2)

    def _paint_robot(self) -> None:
        pose, hull = self.env.sim.poses[self.world], self.env.config.robot.hull_radius_m
        self.canvas.circle(self._at(pose[:2]), hull * self._scale, BLUE, self.theme.rim, 1.2)
        nose = hull * np.array([[0.78, 0.0], [-0.45, 0.5], [-0.2, 0.0], [-0.45, -0.5]])
        self.canvas.polygon(self._at(to_world(nose, pose)), WHITE)
