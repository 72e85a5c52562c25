"""Ways through a room: distance fields over a whole grid, and the guide point along an A* path on the rolling map."""

import numpy as np

from dualnav_lite import config
from dualnav_lite.geometry import to_robot
from dualnav_lite.kernels import geodesic, paths

PATH_POINTS = 32  # of `path_robot`, each a cell apart
_MAX_POINTS = 512  # of a whole path


def distance_field(occupied, goal_cell, resolution):
    """Length of the shortest 8-connected way from every cell to the goal.

    Args:
        occupied: (H, W) bool, True where the robot's centre cannot be (inflate before), or float: a factor >= 1 on the
            length of a step, inf where blocked.
        goal_cell: (iy, ix); counts as free even where it is occupied.
        resolution: cell size [m].

    Returns:
        (H, W) f64 [m], inf where there is no way. Diagonal steps never squeeze past an occupied corner.

    Raises:
        ValueError: the goal lies outside the grid, or a factor is below 1.
    """
    occupied = np.asarray(occupied)
    if occupied.dtype == bool:
        cost = np.where(occupied, np.inf, 1.0)
    else:
        cost = np.ascontiguousarray(occupied, dtype=np.float64)
        if not (cost >= 1.0).all():
            raise ValueError("cost factors must be at least 1")
    goal_y, goal_x = int(goal_cell[0]), int(goal_cell[1])
    if not (0 <= goal_y < cost.shape[0] and 0 <= goal_x < cost.shape[1]):
        raise ValueError(f"goal cell {(goal_y, goal_x)} outside a grid of shape {cost.shape}")
    return geodesic.geodesic(cost, goal_y, goal_x) * resolution


class Guide:
    """Keeps a path to the goal for each of n worlds and says where on it the robot should head next.

    A straight line is taken where it is free with clearance; else A* runs on the map, dear near obstacles, with closed
    margins that are opened only where there is no other way. Where even that fails the path is the straight line.
    Worlds never influence each other.
    """

    def __init__(self, guide: config.Guide, grid: config.Map, num_envs: int):
        self.guide, self.resolution = guide, grid.resolution_m
        self._paths = np.zeros((num_envs, _MAX_POINTS, 2))
        self._counts = np.zeros(num_envs, np.int64)
        self._positions = np.zeros(num_envs, np.int64)
        self._goals = np.full((num_envs, 2), np.nan)

    def reset(self, indices) -> None:
        """Forget the paths of the worlds listed."""
        self._goals[indices] = np.nan

    def is_due(self, goals, step):
        """(n,) bool: worlds that want a new path now, so that the caller need not lay scans over other maps."""
        return (step % self.guide.replan_steps == 0) | (self._goals != goals).any(axis=1)

    def update(self, grids, poses, goals, step, due=None):
        """Guide points and paths, planned anew for the worlds that are due.

        Args:
            grids: (n, G, G) u8 `Cell` codes, toroidal: cell (iy, ix) of the map frame stands at [iy mod G, ix mod G].
                Only the rows of due worlds are read.
            poses: (n, 3) believed, map frame.
            goals: (n, 2) [m], map frame.
            step: (n,) control steps since the start of each episode.
            due: (n,) bool, or None for `is_due`. A world whose goal is new is always planned.

        Returns:
            guide_robot (n, 2), `guide.distance_m` ahead along the path (the goal itself if nearer, or if
            `guide.method` is "goal"); path_robot (n, 32, 2), points a cell apart from the robot on, the last repeated;
            path_length (n,), way left. Robot frame, metres, fresh arrays.
        """
        poses, goals = np.ascontiguousarray(poses, float), np.ascontiguousarray(goals, float)
        is_new = (self._goals != goals).any(axis=1)
        due = self.is_due(goals, np.asarray(step)) if due is None else np.asarray(due, bool) | is_new
        if due.any():
            paths.plan_paths(grids, self.resolution, poses, goals, due, self._paths, self._counts)
            self._positions[due] = 0
            self._goals[due] = goals[due]
        n = len(poses)
        guides, ahead, lengths = np.empty((n, 2)), np.empty((n, PATH_POINTS, 2)), np.empty(n)
        paths.follow_paths(
            self._paths,
            self._counts,
            self._positions,
            self.resolution,
            poses,
            self.guide.distance_m,
            guides,
            ahead,
            lengths,
        )
        if self.guide.method == "goal":
            guides = to_robot(goals, poses)
        return guides, ahead, lengths
