"""Analytic safety filter: no command is passed on from which the robot could not brake in front of what it sees.

It stands behind any driver, knows nothing of the policy, and reads the raw scan alone: no map, no tracks, no learning.
What it cannot do: a person who walks into a robot, a thing below the lidar, a beam lost to noise. It is always reported
apart (`ppo_filter`), since it hides what a policy has not learned.
"""

import numpy as np

from dualnav_lite.config import Config
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels import braking

SHARES = np.linspace(1.0, 0.0, 6)  # of a command's speed that are tried
TURNS = np.deg2rad([15, -15, 30, -30, 45, -45, 60, -60, 75, -75, 90, -90])  # headings looked at from a standstill
MARGIN_M = 0.02  # beyond the hull; twice the range noise in daylight
STEP_S = 0.02  # of the integration


class SafetyFilter:
    """Slows commands down until braking distance and swept hull are free; from a standstill it turns to a free heading.

    Args:
        config: hull, accelerations, control step and lidar.
    """

    def __init__(self, config: Config):
        self._robot, self._range_max = config.robot, config.lidar.range_max_m
        self._max_omega = config.hardware.max_ang_vel
        self._control_dt = config.control_dt_s
        self._hull = config.robot.hull_radius_m + MARGIN_M

    def __call__(self, commands, scans, twists):
        """Commands that can be braked from.

        Args:
            commands: (n, 2) v [m/s], omega [rad/s].
            scans: (n, beams, 2) ranges [m] and intensities.
            twists: (n, 2) measured.

        Returns:
            (n, 2), v between 0 and the commanded one; omega as commanded, but where the robot stands and cannot go on.
        """
        commands = np.asarray(commands, float)
        cosines, sines = beam_directions(scans.shape[1])
        safe = np.empty((len(commands), 2))
        braking.safe_commands(
            commands,
            np.asarray(scans, np.float32),
            np.asarray(twists, float),
            cosines,
            sines,
            self._range_max,
            SHARES,
            TURNS,
            self._robot.max_lin_acc_m_s2,
            self._robot.max_ang_acc_rad_s2,
            self._max_omega,
            self._control_dt,
            STEP_S,
            self._hull,
            safe,
        )
        return safe


class FilteredDriver:
    """A driver behind the filter; to `evaluate` a driver like any other."""

    def __init__(self, driver, config: Config):
        self._driver, self._filter = driver, SafetyFilter(config)
        self.needs_truth, self.needs_full_map = driver.needs_truth, driver.needs_full_map
        self.training_seed = getattr(driver, "training_seed", None)
        self.fingerprint = f"filtered and turned {MARGIN_M} {getattr(driver, 'fingerprint', '')}"

    def own_config(self, config: Config) -> Config:
        """The driver's, where it has one."""
        return self._driver.own_config(config) if hasattr(self._driver, "own_config") else config

    def reset(self, indices) -> None:
        """Pass on."""
        self._driver.reset(indices)

    def act(self, observations, infos) -> np.ndarray:
        """(n, 2) commands of the driver, slowed down where they must be; reads `scan` and `twist` of the infos."""
        scans, twists = (np.stack([info[name] for info in infos]) for name in ("scan", "twist"))
        return self._filter(self._driver.act(observations, infos), scans, twists)
