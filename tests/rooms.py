"""Rooms that several tests look at, with what is true about them worked out without beams or grids."""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.geometry import to_robot
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import Surface


def distance_to_boxes(points, boxes):
    """Distance from each point to each oriented box, 0 inside.

    Args:
        points: (p, 2) [m].
        boxes: (b, 5) as in `box_corners`.

    Returns:
        (p, b) [m].
    """
    points, boxes = np.atleast_2d(np.asarray(points, float)), np.asarray(boxes, float).reshape(-1, 5)
    local = np.abs(to_robot(points[:, None, :], boxes[None, :, :3]))
    outside = np.maximum(local - boxes[None, :, 3:5], 0.0)
    return np.hypot(outside[..., 0], outside[..., 1])


@dataclass
class Room:
    """A rectangle [0, width] x [0, height] with boxes (b, 5) and standing circles (c, 3), and their surfaces."""

    width: float
    height: float
    boxes: np.ndarray
    box_surface: np.ndarray
    circles: np.ndarray

    def scene(self, num_envs: int = 1) -> Scene:
        """The room as a scene, the same in every world."""
        scene = Scene.empty(num_envs)
        for world in range(num_envs):
            scene.add_room(world, self.width, self.height)
            scene.add_boxes(world, self.boxes, self.box_surface)
            scene.add_circles(world, self.circles, Surface.PERSON)
        return scene

    def depth(self, points) -> np.ndarray:
        """Distance of (p, 2) points to the nearest solid but the people, negative outside the room, 0 in a box."""
        points = np.asarray(points, float)
        size = np.array([self.width, self.height])
        to_walls = np.minimum(points, size - points).min(axis=1)
        return np.minimum(to_walls, distance_to_boxes(points, self.boxes).min(axis=1))


def furnished_room(people: int = 6, boxes: int = 15, seed: int = 3) -> Room:
    """10 x 8 m with boxes at any angle and standing people; the lane 3.5 <= y <= 4.5 is left free for the robot."""
    rng = np.random.default_rng(seed)
    furniture = []
    while len(furniture) < boxes:
        box = np.array([*rng.uniform([0.5, 0.5], [9.5, 7.5]), rng.uniform(0, np.pi), *rng.uniform(0.1, 0.5, 2)])
        if abs(box[1] - 4) > 0.5 + np.hypot(box[3], box[4]):
            furniture.append(box)
    circles = np.column_stack([rng.uniform([1, 5], [9, 7], (people, 2)), rng.uniform(0.25, 0.3, people)])
    return Room(10.0, 8.0, np.array(furniture), np.full(boxes, Surface.FURNITURE), circles)


def divided_room() -> Room:
    """10 x 8 m, a wall at x = 5 with a door 1 m wide around y = 4, four pieces of furniture, nobody in it."""
    boxes = [
        ([5.0, 1.7, 0, 0.1, 1.7], Surface.WALL),
        ([5.0, 3.45, 0, 0.1, 0.05], Surface.DOOR),
        ([5.0, 4.55, 0, 0.1, 0.05], Surface.DOOR),
        ([5.0, 6.3, 0, 0.1, 1.7], Surface.WALL),
        ([2.2, 6.2, 0.4, 0.5, 0.3], Surface.FURNITURE),
        ([1.5, 1.5, 0.0, 0.4, 0.4], Surface.FURNITURE),
        ([8.0, 2.0, 1.0, 0.6, 0.2], Surface.FURNITURE),
        ([7.5, 6.5, 0.2, 0.3, 0.3], Surface.FURNITURE),
    ]
    shapes, surfaces = zip(*boxes, strict=True)
    return Room(10.0, 8.0, np.array(shapes), np.array(surfaces), np.empty((0, 3)))
