"""The dynamic window approach on the observed scan: no map, no memory, no notion of motion."""

import numpy as np

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.kernels.dwa import best_in_window
from dualnav_lite.planners.base import Planner
from dualnav_lite.planners.pursuit import scan_points
from dualnav_lite.planners.surroundings import ORIGIN_M, RESOLUTION_M, clearance_around

GAP_M = 0.08  # beside the hull
WINDOW_S = 0.25
GRID = (ORIGIN_M, ORIGIN_M, RESOLUTION_M)


class DynamicWindow(Planner):
    """Sees the scan as it is now and the goal. Source: Fox, Burgard, Thrun (IEEE RA Magazine 4, 1997).

    Args:
        settings: the configuration.
        max_speed: [m/s]; the hardware's limit if None.

    Raises:
        UnusableInput: `max_speed` is 0, of which no speed is a share.
    """

    def __init__(self, settings: Config, max_speed: float | None = None):
        super().__init__(settings)
        if max_speed == 0.0:
            raise UnusableInput("dwa weighs shares of its top speed: it needs a max_speed above 0")
        robot = settings.robot
        speed = self.max_v if max_speed is None else min(max_speed, self.max_v)
        self._limits = np.array([speed, self.max_omega, robot.max_lin_acc_m_s2, robot.max_ang_acc_rad_s2])
        self._keep = robot.hull_radius_m + GAP_M

    def command(self, i, info):
        """The best command of the window."""
        clearance = clearance_around(scan_points(info["scan"], self.settings.lidar.range_max_m))
        twist, goal = np.asarray(info["twist"], float), np.asarray(info["goal_robot"], float)
        return best_in_window(twist, goal, clearance[None], GRID, self._keep, self._limits, WINDOW_S)
