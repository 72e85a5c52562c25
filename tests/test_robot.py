"""Robot: the wheel loop follows commands within its limits, power and energy are what the formula says."""

import numpy as np
import pytest

from dualnav_lite.config import Config, with_overrides
from dualnav_lite.kernels.drive import drive, power
from dualnav_lite.robot import Robots, drive_parameters


def driven(command, steps, config=None, heading=0.0):
    robots = Robots(1, config or Config())
    twists, energy, displacement = [], [], []
    for _ in range(steps):
        robots.drive(np.array([heading]), np.array([command], float))
        heading += robots.displacement[0, 2]
        twists.append(robots.twist[0].copy())
        energy.append(robots.energy_j[0])
        displacement.append(robots.displacement[0].copy())
    return np.array(twists), np.array(energy), np.array(displacement), robots


def test_power_is_the_formula_of_the_contract():
    p = drive_parameters(Config())
    assert power(0.0, 0.0, 0.0, p) == 5.0
    assert power(0.5, 0.0, 0.0, p) == pytest.approx(5 + 8 * 0.5 + 20 * 0.25)
    assert power(-0.5, -1.0, 0.0, p) == pytest.approx(5 + 4 + 5 + 6 + 4)
    assert power(0.4, 0.0, 1.0, p) == pytest.approx(5 + 3.2 + 3.2 + 15 * 0.4)
    assert power(0.4, 0.0, -1.0, p) == pytest.approx(5 + 3.2 + 3.2)  # braking gives nothing back


def test_there_is_a_best_speed_and_standing_still_is_not_free():
    p = drive_parameters(Config())
    speeds = np.linspace(0.05, 0.8, 751)
    per_metre = [power(v, 0.0, 0.0, p) / v for v in speeds]
    assert speeds[int(np.argmin(per_metre))] == pytest.approx(np.sqrt(5 / 20), abs=2e-3)


def test_the_robot_reaches_its_command_within_the_acceleration_limits():
    for command in ((0.8, 0.0), (-0.6, 0.0), (0.4, 1.2), (0.0, -1.0)):
        twists, *_ = driven(command, 40)
        assert np.allclose(twists[-1], command, atol=0.01)
        rates = np.abs(np.diff(np.vstack([[0.0, 0.0], twists]), axis=0)) / 0.1
        assert rates[:, 0].max() <= 1.0 * 1.15  # the loop may overshoot its reference a little
        assert rates[:, 1].max() <= 2.5 * 1.15
        assert np.abs(twists[:, 0]).max() <= 0.8 + 1e-9
        assert np.abs(twists[:, 1]).max() <= 1.2 + 1e-9


def test_steady_energy_is_power_times_time():
    _, energy, displacement, _ = driven((0.5, 0.0), 60)
    assert energy[-1] == pytest.approx(14.0 * 0.1, rel=1e-3)
    assert displacement[-1, 0] == pytest.approx(0.05, rel=1e-3)


def test_the_battery_loses_what_was_drawn_and_ends_at_zero():
    config = with_overrides(Config(), {"power.capacity_wh": 0.01})
    _, energy, _, robots = driven((0.8, 0.0), 10, config)
    assert robots.battery[0] == pytest.approx(1 - energy.sum() / 36.0)
    _, _, _, robots = driven((0.8, 0.0), 60, config)
    assert robots.battery[0] == 0.0


def test_a_turning_robot_drives_a_circle():
    _, _, displacement, _ = driven((0.5, 0.8), 140)
    lap = displacement[-79:]  # 2 pi / 0.8 rad/s = 78.5 steps
    assert np.hypot(*lap[:, :2].sum(axis=0)) < 0.05
    assert np.hypot(lap[:, 0], lap[:, 1]).sum() == pytest.approx(0.5 * 7.9, rel=0.01)


def test_odometry_is_exact_without_drift_and_off_by_its_scale_with_it():
    config = with_overrides(Config(), {"robot.odometry_distance_drift": 0.0, "robot.odometry_heading_drift": 0.0})
    before, after = np.array([[1.0, 2.0, 0.3]]), np.array([[1.4, 2.3, 0.5]])
    robots = Robots(1, config)
    robots.reset(0, 5, before[0], 1.0)
    robots.odometry(before, after)
    assert np.allclose(robots.pose_odom, after)
    drifting = Robots(200, with_overrides(Config(), {"robot.odometry_distance_drift": 0.05}))
    for i in range(200):
        drifting.reset(i, i, before[0], 1.0)
    drifting.odometry(np.repeat(before, 200, axis=0), np.repeat(after, 200, axis=0))
    length = np.hypot(*(drifting.pose_odom[:, :2] - before[0, :2]).T) / 0.5
    assert length.std() == pytest.approx(0.05, rel=0.2)
    assert length.mean() == pytest.approx(1.0, abs=0.015)


def test_compiled_drive_equals_the_plain_function():
    rng = np.random.default_rng(3)
    outputs = []
    for function in (drive, drive.py_func):
        wheels = np.zeros((2, 8))
        out = np.empty((2, 3)), np.empty(2), np.empty(2)
        rng = np.random.default_rng(3)
        for _ in range(5):
            function(
                wheels, np.array([0.2, -1.0]), rng.uniform(-1, 1, (2, 2)), drive_parameters(Config()), 0.02, 5, *out
            )
        outputs.append(np.concatenate([wheels.ravel(), *(o.ravel() for o in out)]))
    assert np.allclose(*outputs, rtol=0, atol=1e-12)
