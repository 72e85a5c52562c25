"""Believed poses against the simulator's truth, and the matcher against maps drawn by hand."""

import numpy as np
import pytest

from dualnav_lite.config import Config, with_overrides
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels import matching
from dualnav_lite.localiser import Localiser
from dualnav_lite.semantics import Cell
from tests.kernels_in_python import in_python

BEAMS, SIZE = 360, 160
FIRST = 1_000_000


def square_room():
    """A map of a room of 6 x 5 m around the origin, and its scan from the middle."""
    cells = np.full((1, SIZE, SIZE), Cell.FREE, np.uint8)
    corner = np.array([[-SIZE // 2, -SIZE // 2]])
    for x in range(-30, 31):
        for y in range(-25, 26):
            if abs(x) == 30 or abs(y) == 25:
                cells[0, y % SIZE, x % SIZE] = Cell.WALL
    cos, sin = beam_directions(BEAMS)
    ranges = np.minimum(3.05 / np.maximum(np.abs(cos), 1e-9), 2.55 / np.maximum(np.abs(sin), 1e-9))
    # Cell k spans 0.1 k to 0.1 (k + 1): the walls' middles lie at +3.05 and -2.95, +2.55 and -2.45.
    ranges = np.where(cos < 0, np.minimum(ranges, 2.95 / np.maximum(-cos, 1e-9)), ranges)
    ranges = np.where(sin < 0, np.minimum(ranges, 2.45 / np.maximum(-sin, 1e-9)), ranges)
    scan = np.stack([ranges, np.full(BEAMS, 0.5)], axis=-1).astype(np.float32)
    return cells, corner, scan[None]


def matched(cells, corner, scans, pose, times=1):
    poses = np.array([pose], float)
    for _ in range(times):
        matching.match_scans(cells, corner, scans, np.ones(1, bool), *beam_directions(BEAMS), 0.1, 10.0, poses)
    return poses[0]


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.05), (0.06, 0.0, 0.0), (0.0, -0.06, 0.0), (0.05, 0.05, -0.04)])
def test_a_pose_that_is_off_comes_back(off):
    back = matched(*square_room(), off, times=20)
    assert np.abs(back[:2]).max() < 0.02
    assert abs(back[2]) < 0.006


def test_one_match_moves_no_farther_than_its_window_allows():
    moved = matched(*square_room(), (0.2, -0.2, 0.1)) - (0.2, -0.2, 0.1)
    assert np.abs(moved[:2]).max() <= matching.GAIN * matching.SHIFT_M + 1e-12
    assert abs(moved[2]) <= matching.GAIN * matching.TURN_RAD + 1e-12


def test_where_the_map_is_unknown_or_no_beam_returns_nothing_moves():
    cells, corner, scan = square_room()
    pose = (0.03, 0.01, 0.02)
    assert matched(np.full_like(cells, Cell.UNKNOWN), corner, scan, pose).tolist() == list(pose)
    lost = np.zeros_like(scan) + np.array([10.0, 0.0], np.float32)
    assert matched(cells, corner, lost, pose).tolist() == list(pose)


def test_odometry_carries_the_pose_along_in_the_robot_s_own_frame():
    localiser = Localiser(Config().map, BEAMS, 10.0, 1)
    localiser.reset(0, np.zeros(3))
    localiser.poses[0] = [5.0, 5.0, np.pi / 2]  # as if matches had turned it
    localiser.follow(np.array([[1.0, 0.0, 0.1]]))
    assert np.allclose(localiser.poses, [[5.0, 6.0, np.pi / 2 + 0.1]])
    localiser.follow(np.array([[1.0, 0.0, 0.1]]))
    assert np.allclose(localiser.poses, [[5.0, 6.0, np.pi / 2 + 0.1]])


def errors(match_steps, scenario):
    """(steps, n) distance between the goal that robots believe in and the true one, while they turn on the spot."""
    config = with_overrides(Config(), {"map.match_steps": match_steps, "robot.odometry_heading_drift": 0.03})
    env = DynamicNavVectorEnv(4, config, scenario, truth=True)
    _, infos = env.reset(seed=FIRST)
    found = []
    for _ in range(120):
        _, _, _, _, infos = env.step(np.full((4, 2), [0.0, 1.0]))
        truth = infos["truth"]
        away = truth["goal"] - truth["pose"][:, :2]
        c, s = np.cos(truth["pose"][:, 2]), np.sin(truth["pose"][:, 2])
        true_goal = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)
        found.append(np.hypot(*(infos["goal_robot"] - true_goal).T))
    return np.array(found)


@pytest.mark.parametrize("scenario", ["navigation", "comms_dropout", "low_light_phantoms"])
def test_matching_keeps_the_goal_where_it_is(scenario):
    alone, matched = errors(0, scenario), errors(3, scenario)
    assert alone[-20:].mean() > 0.5
    assert matched[-20:].mean() < 0.35 * alone[-20:].mean()


def test_compiled_matcher_is_the_python_text(monkeypatch):
    room, pose = square_room(), (0.03, -0.04, 0.02)
    compiled = matched(*room, pose)
    in_python(monkeypatch, matching)
    assert np.allclose(matched(*room, pose), compiled, atol=1e-12)
