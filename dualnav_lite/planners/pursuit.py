"""Pure pursuit of a planned path, with a stop for whatever the scan shows close ahead."""

from abc import abstractmethod

import numpy as np

from dualnav_lite.config import Config
from dualnav_lite.geometry import beam_directions
from dualnav_lite.planners.base import Planner

LOOKAHEAD_M = 0.6
SIDE_GAP_M = 0.05  # beside the hull, of the strip that must be free
STOP_GAP_M = 0.12  # before the hull
BRAKING_M_S2 = 0.6  # below the motors' 1.0, for the delay of one control step
STRAYS = 2  # nearest beams that may be noise


def scan_points(scan, range_max: float):
    """(p, 2) points that the beams of a (beams, 2) scan have met [m], robot frame."""
    cosines, sines = beam_directions(len(scan))
    ranges = scan[:, 0].astype(float)
    points = np.stack([ranges * cosines, ranges * sines], axis=1)
    return points[ranges < range_max - 1e-3]


class Pursuit(Planner):
    """Drives after a point `LOOKAHEAD_M` ahead on a path; subclasses say which path.

    It slows so that it can stop short of the nearest beam inside the strip its hull will sweep towards that point, and
    has no idea that things move.

    Args:
        settings: the configuration.
        max_speed: [m/s]; the hardware's limit if None.
    """

    def __init__(self, settings: Config, max_speed: float | None = None):
        super().__init__(settings)
        self.speed = self.max_v if max_speed is None else min(max_speed, self.max_v)

    @abstractmethod
    def path(self, i: int, info: dict):
        """(p, 2) points of the path from the robot on, robot frame [m]."""

    def command(self, i, info):
        """Along the circle through the point ahead."""
        path = self.path(i, info)
        distance = np.hypot(path[:, 0], path[:, 1])
        beyond = np.flatnonzero(distance >= LOOKAHEAD_M)
        x, y = path[beyond[0] if len(beyond) else -1]
        if x < 0.5 * abs(y):  # more than 63 degrees aside
            return self.turn_then_drive((x, y), 0.0)
        curvature = 2.0 * y / max(x * x + y * y, 1e-6)
        v = min(self.speed, self.max_omega / max(abs(curvature), 1e-6), self._speed_to_stop(info["scan"], x, y))
        return v, curvature * v if v > 0.05 else 2.0 * float(np.arctan2(y, x))

    def _speed_to_stop(self, scan, x, y) -> float:
        """Speed from which the robot stops before what lies in the strip towards (x, y)."""
        points = scan_points(scan, self.settings.lidar.range_max_m)
        length = max(np.hypot(x, y), 1e-6)
        ahead, aside = points @ [x / length, y / length], points @ [-y / length, x / length]
        hull = self.settings.robot.hull_radius_m
        near = np.sort(ahead[(np.abs(aside) < hull + SIDE_GAP_M) & (ahead > 0.0)])
        if len(near) <= STRAYS:
            return np.inf
        return float(np.sqrt(2.0 * BRAKING_M_S2 * max(near[STRAYS] - hull - STOP_GAP_M, 0.0)))


class AStar(Pursuit):
    """Pure pursuit on the guide's A* path: sees the received or cached map through it, and the scan to stop.

    At 0.5 m/s it is the reference driver by which the battery is calibrated.
    """

    def path(self, i, info):
        """The path that the guide planned."""
        return info["path_robot"]
