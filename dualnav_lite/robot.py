"""The differential-drive robots of n worlds: wheels, power and battery, odometry."""

import numpy as np

from dualnav_lite import streams
from dualnav_lite.config import Config
from dualnav_lite.kernels import drive as kernel
from dualnav_lite.kernels.drive import LEFT, RIGHT, WHEEL_STATE


def drive_parameters(config: Config) -> np.ndarray:
    """(15,) parameter row of `kernels.drive`, from the configuration."""
    r, p, h = config.robot, config.power, config.hardware
    return np.array(
        [
            h.max_lin_vel,
            h.max_ang_vel,
            r.max_lin_acc_m_s2,
            r.max_ang_acc_rad_s2,
            r.track_width_m,
            r.motor_lag_s,
            r.pid_kp,
            r.pid_ki,
            r.pid_kd,
            r.mass_kg,
            p.idle_w,
            p.linear_w_s_m,
            p.quadratic_w_s2_m2,
            p.turn_w_s,
            p.turn_quadratic_w_s2,
        ]
    )


class Robots:
    """State of n robots.

    Attributes:
        twist: (n, 2) v [m/s], omega [rad/s] of the wheels at the end of the last control step.
        battery: (n,) charge left in [0, 1].
        energy_j: (n,) energy drawn in the last control step [J].
        displacement: (n, 3) dx, dy [m] in the world frame and turn [rad] of the last control step, wheels free.
        acceleration_square: (n,) mean (dv/dt)^2 of the last control step [m2/s4].
        pose_odom: (n, 3) where each robot believes it is; starts at the true pose and drifts.
    """

    def __init__(self, num_envs: int, config: Config):
        self.config = config
        self.parameters = drive_parameters(config)
        self.capacity_j = config.power.capacity_wh * 3600.0
        self.reference_joules = (
            kernel.power(config.hardware.max_lin_vel, 0.0, 0.0, self.parameters) * config.control_dt_s
        )
        self.wheels = np.zeros((num_envs, WHEEL_STATE))
        self.twist = np.zeros((num_envs, 2))
        self.battery = np.ones(num_envs)
        self.energy_j = np.zeros(num_envs)
        self.displacement = np.zeros((num_envs, 3))
        self.acceleration_square = np.zeros(num_envs)
        self.pose_odom = np.zeros((num_envs, 3))
        self._scale = np.ones((num_envs, 2))  # odometry's scale errors: distance, heading

    def reset(self, world: int, seed: int, pose: np.ndarray, charge: float) -> None:
        """Put one robot at rest at a true pose with a charge in [0, 1]."""
        self.wheels[world] = 0.0
        self.twist[world] = 0.0
        self.battery[world] = charge
        self.pose_odom[world] = pose
        r = self.config.robot
        draws = streams.stream(seed, "odometry").standard_normal(2)
        self._scale[world] = 1.0 + draws * [r.odometry_distance_drift, r.odometry_heading_drift]

    def stop(self, world: int) -> None:
        """Bring one robot's wheels to rest at once, as after a contact."""
        self.wheels[world] = 0.0
        self.twist[world] = 0.0

    def drive(self, headings: np.ndarray, commands: np.ndarray) -> None:
        """Turn the wheels for one control step and draw the energy.

        Args:
            headings: (n,) true headings [rad].
            commands: (n, 2) v [m/s], omega [rad/s] inside the hardware limits.
        """
        c = self.config
        kernel.drive(
            self.wheels,
            headings,
            commands,
            self.parameters,
            c.physics_dt_s,
            c.substeps,
            self.displacement,
            self.energy_j,
            self.acceleration_square,
        )
        left, right = self.wheels[:, LEFT], self.wheels[:, RIGHT]
        self.twist[:, 0] = 0.5 * (left + right)
        self.twist[:, 1] = (right - left) / c.robot.track_width_m
        self.battery = np.maximum(self.battery - self.energy_j / self.capacity_j, 0.0)

    def odometry(self, before: np.ndarray, after: np.ndarray) -> None:
        """Advance the believed poses by what the robots really did, with their scale errors.

        Args:
            before: (n, 3) true poses at the start of the control step.
            after: (n, 3) true poses at its end.
        """
        dx, dy = after[:, 0] - before[:, 0], after[:, 1] - before[:, 1]
        turn = after[:, 2] - before[:, 2]
        relative = self.pose_odom[:, 2] - before[:, 2]
        c, s = np.cos(relative) * self._scale[:, 0], np.sin(relative) * self._scale[:, 0]
        self.pose_odom[:, 0] += c * dx - s * dy
        self.pose_odom[:, 1] += s * dx + c * dy
        self.pose_odom[:, 2] += turn * self._scale[:, 1]
