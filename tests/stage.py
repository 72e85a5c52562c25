"""A room in which people and boxes move as a test tells them, and the paths of a robot that scans it."""

import numpy as np

from dualnav_lite.config import Lidar as LidarSettings
from dualnav_lite.lidar import Lidar
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import Surface
from dualnav_lite.streams import stream_key

BRIGHT, DARK = 300.0, 5.0


class Stage:
    """A room in which circles and boxes move as told while a robot scans it."""

    def __init__(self, boxes=(), size=(10.0, 8.0), lux=BRIGHT, seed=1):
        self.room = Scene.empty(1)
        self.room.add_room(0, *size)
        self.room.add_boxes(0, np.reshape(boxes, (-1, 5)), Surface.FURNITURE)
        self.static = self.room.num_segments.copy()
        self.lidar = Lidar(LidarSettings(), 1)
        self.lux, self.key, self.step = np.array([lux]), np.array([stream_key(seed, "lidar")]), 0

    def scan(self, pose, people=(), boxes=(), phantoms=()):
        """(1, beams, 2) scan of the moment."""
        self.room.num_segments[:] = self.static
        self.room.num_circles[:] = 0
        self.room.add_circles(0, people, Surface.PERSON)
        self.room.add_circles(0, phantoms, Surface.PHANTOM)
        self.room.add_boxes(0, boxes, Surface.BOX)
        scans, _ = self.lidar.scan(np.array([pose], float), self.room, self.lux, self.key, np.array([self.step]))
        self.step += 1
        return scans


def arc(start, v, omega, steps):
    """(steps, 3) poses of a robot that keeps v and omega, 0.1 s apart."""
    poses = [np.array(start, float)]
    for _ in range(steps - 1):
        x, y, heading = poses[-1]
        poses.append(np.array([x + 0.1 * v * np.cos(heading), y + 0.1 * v * np.sin(heading), heading + 0.1 * omega]))
    return np.array(poses)
