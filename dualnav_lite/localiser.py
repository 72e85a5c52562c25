"""Where n robots believe they are: odometry from scan to scan, pulled back by how the scans fit the received map."""

import numpy as np

from dualnav_lite.config import Map
from dualnav_lite.geometry import beam_directions, to_robot, to_world
from dualnav_lite.kernels.matching import match_scans


class Localiser:
    """Believed poses of n robots.

    Odometry alone drifts: with a scale error of 1 % in turning, a robot is off by a quarter of a radian after four
    turns on the spot, and circles beside a goal that it believes to have reached. Its own map knows better.

    Args:
        settings: of the map; `match_steps` scans lie between two matches, 0 leaves odometry alone.
        beams, range_max: of the lidar.
        num_envs: number of worlds n.

    Attributes:
        poses: (n, 3), map frame; odometry's at a reset.
    """

    def __init__(self, settings: Map, beams: int, range_max: float, num_envs: int):
        self._settings, self._range_max = settings, range_max
        self._directions = beam_directions(beams)
        self.poses, self._odometry = np.zeros((num_envs, 3)), np.zeros((num_envs, 3))

    def reset(self, world: int, odometry) -> None:
        """Begin anew in one world, at its odometry's pose (3,)."""
        self.poses[world] = self._odometry[world] = odometry

    def follow(self, odometry) -> None:
        """Carry the poses along with the odometry, (n, 3)."""
        moved = to_robot(odometry[:, :2], self._odometry)
        self.poses[:, :2] = to_world(moved, self.poses)
        self.poses[:, 2] += odometry[:, 2] - self._odometry[:, 2]
        self._odometry = odometry.copy()

    def match(self, cells, corners, scans, steps, active) -> None:
        """Pull the poses of the active worlds whose turn it is towards where their scans fit their maps.

        Args:
            cells, corners: maps that the robots hold (`Mapper.received`, `received_corners`).
            scans: (n, beams, 2), the present ones.
            steps: (n,) since reset; active: (n,) bool.
        """
        every = self._settings.match_steps
        if every:
            due = active & (steps % every == 0)
            resolution = self._settings.resolution_m
            match_scans(cells, corners, scans, due, *self._directions, resolution, self._range_max, self.poses)
