import numpy as np
import pytest

from dualnav_lite.config import Config
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.kernels import braking
from dualnav_lite.safety import MARGIN_M, FilteredDriver, SafetyFilter

CONFIG = Config()
BEAMS = 360
HULL = CONFIG.robot.hull_radius_m


def scan_of(*points, noise=0.0, seed=0):
    """A scan whose beams towards the points [m] end there, as wide as a hand each, and nowhere else."""
    scan = np.zeros((BEAMS, 2), np.float32)
    scan[:, 0] = CONFIG.lidar.range_max_m
    bearings = -np.pi + 2 * np.pi * np.arange(BEAMS) / BEAMS
    for x, y in points:
        off = np.abs((bearings - np.arctan2(y, x) + np.pi) % (2 * np.pi) - np.pi)
        scan[off < 0.03] = [np.hypot(x, y), 0.8]
    return scan


def filtered(command, scan, twist=(0.0, 0.0)):
    return SafetyFilter(CONFIG)(np.array([command], float), scan[None], np.array([twist], float))[0]


def test_nothing_near_leaves_every_command_as_it_is():
    rng = np.random.default_rng(0)
    commands = rng.uniform([-0.8, -1.2], [0.8, 1.2], (200, 2))
    scans = np.repeat(scan_of((3.0, 0.0))[None], 200, axis=0)
    assert np.array_equal(SafetyFilter(CONFIG)(commands, scans, commands), commands)


@pytest.mark.parametrize("speed", [0.3, 0.5, 0.8])
def test_full_speed_is_allowed_just_as_far_as_it_can_be_braked_from(speed):
    # One control step and v^2 / 2a to brake, from the hull's front.
    needed = HULL + MARGIN_M + 0.1 * speed + speed**2 / (2 * CONFIG.robot.max_lin_acc_m_s2)
    assert filtered((speed, 0.0), scan_of((needed + 0.04, 0.0)), (speed, 0.0))[0] == pytest.approx(speed)
    assert filtered((speed, 0.0), scan_of((needed - 0.04, 0.0)), (speed, 0.0))[0] < speed


def test_a_robot_that_obeys_never_touches_a_wall():
    rng = np.random.default_rng(1)
    for _ in range(30):
        x = y = heading = v = 0.0
        omega = rng.uniform(-1.2, 1.2)
        wall = rng.uniform(0.5, 1.5)
        for _ in range(60):
            # The wall x = wall as the robot sees it.
            bearings = -np.pi + 2 * np.pi * np.arange(BEAMS) / BEAMS
            towards = np.cos(bearings + heading)
            with np.errstate(divide="ignore"):
                ranges = np.where(towards > 1e-6, (wall - x) / towards, 10.0)
            scan = np.stack([np.minimum(ranges, 10.0), np.full(BEAMS, 0.5)], axis=1).astype(np.float32)
            command = filtered((0.8, omega), scan, (v, omega))
            for _ in range(5):
                v += np.clip(command[0] - v, -0.02, 0.02)
                heading += 0.02 * omega
                x, y = x + 0.02 * v * np.cos(heading), y + 0.02 * v * np.sin(heading)
            assert wall - x > HULL


def test_things_beside_the_path_and_behind_do_not_slow_the_robot():
    for point in ((0.6, 0.35), (0.6, -0.35), (-0.3, 0.0)):
        assert filtered((0.5, 0.0), scan_of(point), (0.5, 0.0))[0] == 0.5
    assert filtered((-0.5, 0.0), scan_of((-0.3, 0.0)), (-0.5, 0.0))[0] > -0.5  # but backing off into it does


def test_turning_on_the_spot_is_always_allowed():
    scan = scan_of((0.21, 0.0), (0.0, 0.21), (-0.21, 0.0))
    assert filtered((0.0, 1.2), scan).tolist() == [0.0, 1.2]
    assert filtered((0.8, 1.2), scan)[1] == 1.2


def test_a_robot_that_stands_too_close_may_back_off_but_not_go_on():
    scan = scan_of((HULL + 0.01, 0.0))
    assert filtered((-0.5, 0.0), scan)[0] == -0.5
    assert filtered((0.0, 0.5), scan)[1] == 0.5
    assert filtered((0.5, 0.0), scan)[0] == 0.0


def test_lost_beams_are_no_obstacles():
    scan = scan_of((0.4, 0.0))
    scan[:, 1] = 0.0
    assert filtered((0.8, 0.0), scan, (0.8, 0.0))[0] == 0.8


def test_ghosts_are_no_obstacles_and_dark_surfaces_are():
    scan = scan_of((0.4, 0.0))
    scan[scan[:, 1] > 0.0, 1] = 0.07
    assert filtered((0.8, 0.0), scan, (0.8, 0.0))[0] == 0.8
    scan[scan[:, 1] > 0.0, 1] = 0.09
    assert filtered((0.8, 0.0), scan, (0.8, 0.0))[0] < 0.8


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_robot_that_stands_before_a_corner_turns_to_the_free_side(side):
    corner = [(0.205, side * (0.01 + 0.03 * k)) for k in range(8)]
    assert filtered((0.4, 0.1), scan_of(*corner)).tolist() == [0.0, -side * CONFIG.hardware.max_ang_vel]
    assert filtered((0.4, 0.1), scan_of(*corner), (0.3, 0.0)).tolist() == [0.0, 0.1]  # it brakes first
    assert filtered((0.4, 0.6), scan_of(*corner))[1] == 0.6  # a driver who turns is left alone


def test_compiled_braking_agrees_with_plain_python():
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(60):
        points = rng.uniform(-0.8, 0.8, (12, 2))
        points = points[np.hypot(*points.T) > 0.22]
        settings = (*rng.uniform(-0.8, 0.8, 2), *rng.uniform(-0.8, 0.8, 2), 1.0, 2.5, 0.1, 0.02, 0.22)
        found = braking.is_braking_safe(points, len(points), *settings)
        assert found == braking.is_braking_safe.py_func(points, len(points), *settings)
        seen.add(found)
    assert seen == {False, True}


class Blind:
    """Drives straight on at full speed."""

    needs_truth = needs_full_map = False
    training_seed, fingerprint = 3, "abc"

    def reset(self, indices):
        pass

    def act(self, observations, infos):
        return np.tile([0.8, 0.0], (len(infos), 1))


def test_a_blind_driver_behind_the_filter_hits_no_wall_and_no_furniture():
    from dualnav_lite.env import split_infos

    env = DynamicNavVectorEnv(8, CONFIG, "battery", autoreset=False)
    observations, infos = env.reset(seed=list(range(100, 108)))
    driver = FilteredDriver(Blind(), CONFIG)
    assert driver.training_seed == 3
    contacts, slowed = 0, 0
    for _ in range(120):
        commands = driver.act(observations, split_infos(infos, 8))
        slowed += int((commands[:, 0] < 0.8).sum())
        observations, _, _, _, infos = env.step(commands)
        contacts += int(env.journal.contacts.sum())
    assert slowed > 0
    assert contacts == 0
