"""RRT* on the received map with the present scan laid over it, followed by pure pursuit."""

import numpy as np

from dualnav_lite import streams
from dualnav_lite.config import Config
from dualnav_lite.geometry import to_robot, to_world
from dualnav_lite.kernels.paths import resample
from dualnav_lite.kernels.routing import HARD, clearance_levels
from dualnav_lite.kernels.rrtstar import rrt_star
from dualnav_lite.planners.pursuit import Pursuit, scan_points
from dualnav_lite.semantics import Cell

REPLAN_STEPS = 5  # 2 Hz
SAMPLES = 1200
_AHEAD = 20  # points of the path in which the robot is looked for
_MAX_POINTS = 512


class RrtStar(Pursuit):
    """Sees the received map, its believed pose, and the scan: for its map and to stop.

    Twice a second it grows a new tree from a named random stream; if none finds a way the old path stays, and where
    there never was one it heads straight for the goal.
    """

    needs_full_map = True

    def __init__(self, settings: Config, max_speed: float | None = None):
        super().__init__(settings, max_speed)
        self._key = streams.stream_key(0, "rrtstar")
        self._paths: dict[int, np.ndarray] = {}  # (p, 2) map frame
        self._steps: dict[int, int] = {}

    def reset(self, indices):
        """Forget the paths of the worlds listed."""
        for i in indices:
            self._paths.pop(int(i), None)
            self._steps.pop(int(i), None)

    def path(self, i, info):
        """What is left of the present path, renewed when it is due or leads to another goal."""
        pose = np.asarray(info["pose"], float)
        goal = to_world(info["goal_robot"], pose)
        step = self._steps.get(i, 0)
        self._steps[i] = step + 1
        kept = self._paths.get(i)
        is_old = kept is None or np.hypot(*(kept[-1] - goal)) > 0.3
        if is_old or step % REPLAN_STEPS == 0:
            path = self._plan(info["received_map"], info["scan"], pose, goal, step)
            if path is None:
                path = np.array([pose[:2], goal]) if is_old else kept
            self._paths[i] = path
        path = self._paths[i]
        distance = np.hypot(*(path - pose[:2]).T)
        nearest = int(np.argmin(distance[:_AHEAD]))
        self._paths[i] = path[nearest:]
        return to_robot(self._paths[i], pose)

    def _plan(self, received, scan, pose, goal, step):
        """(p, 2) points a cell apart from the robot to the goal [m], or None."""
        resolution, size = self.settings.map.resolution_m, len(received)
        grid = received.copy()
        hits = np.floor(to_world(scan_points(scan, self.settings.lidar.range_max_m), pose) / resolution).astype(int)
        origin = np.floor(pose[:2] / resolution).astype(int) - size // 2
        hits = hits[((hits >= origin) & (hits < origin + size)).all(axis=1)] % size
        grid[hits[:, 1], hits[:, 0]] = Cell.FURNITURE
        levels = clearance_levels(grid, int(origin[1]), int(origin[0]))
        start, end = pose[:2] / resolution - origin, goal / resolution - origin
        inner = np.clip(end, 2.0, size - 3.0)
        if (inner != end).any():
            share = np.linspace(1.0, 0.3, 30)[:, None]
            along = start + share * (end - start)  # a goal beyond the map is drawn in along the line to it
            fits = ((along > 1) & (along < size - 2)).all(axis=1)
            cells = along.astype(int).clip(0, size - 1)
            usable = along[fits & (levels[cells[:, 1], cells[:, 0]] < HARD)]
            if not len(usable):
                return None
            inner = usable[0]
        corners = np.empty((64, 2))
        count = rrt_star(levels, start, inner, np.uint64(int(self._key) + step), SAMPLES, corners)
        if count == 0:
            return None
        corners = (corners[:count] + origin) * resolution
        if (inner != end).any():
            corners = np.concatenate([corners, goal[None]])
        path = np.empty((_MAX_POINTS, 2))
        return path[: resample(corners, resolution, path)]
