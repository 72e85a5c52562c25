"""Drivers other than the ceiling, in a plane of posts with a scan by a formula of its own."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.geometry import to_robot, to_world
from dualnav_lite.kernels import dwa as dwa_kernel
from dualnav_lite.kernels import routing as levels_kernel
from dualnav_lite.kernels import rrtstar as rrtstar_kernel
from dualnav_lite.kernels import sampling as sampling_kernel
from dualnav_lite.planners import ARMS, make_planner
from dualnav_lite.planners.sampling import way_fields
from dualnav_lite.planners.surroundings import CELLS, ORIGIN_M, RESOLUTION_M, clearance_around, occupied_cells
from dualnav_lite.routing import distance_field
from dualnav_lite.semantics import Cell
from tests.kernels_in_python import in_python

BEAMS, RANGE_MAX, HULL = 1080, 10.0, 0.2
BEARINGS = -np.pi + 2 * np.pi * np.arange(BEAMS) / BEAMS


def scan_of(circles, pose):
    """(1080, 2) ranges and intensities of round posts by the law of cosines."""
    ranges = np.full(BEAMS, RANGE_MAX)
    for x, y, radius in circles:
        px, py = to_robot([x, y], pose)
        distance, off = np.hypot(px, py), BEARINGS - np.arctan2(py, px)
        aside = distance * np.sin(off)
        inside = radius**2 - aside**2
        hit = (inside > 0) & (np.cos(off) > 0)
        ranges[hit] = np.minimum(ranges[hit], distance * np.cos(off[hit]) - np.sqrt(inside[hit]))
    return np.stack([ranges, np.where(ranges < RANGE_MAX, 0.5, 0.0)], axis=1).astype(np.float32)


class Plane:
    """A robot with the real one's limits among posts, some of which walk and are tracked; no walls, no drift."""

    def __init__(self, goal, posts=(), walkers=(), walks=(), start=(0.0, 0.0, 0.0), path=None):
        self.pose, self.twist, self.goal = np.array(start, float), np.zeros(2), np.array(goal, float)
        self.posts = np.array(posts, float).reshape(-1, 3)
        self.walkers, self.walks = np.array(walkers, float).reshape(-1, 3), np.array(walks, float).reshape(-1, 2)
        self.path = np.linspace(self.pose[:2], self.goal, 120) if path is None else np.array(path, float)
        self.time_s, self.trail = 0.0, [self.pose.copy()]

    def info(self):
        """What the environment would put into a world's info."""
        nearest = np.hypot(*(self.path - self.pose[:2]).T).argmin()
        step = max(1, round(0.1 / np.hypot(*(self.path[1] - self.path[0]))))
        ahead = self.path[np.minimum(nearest + step * np.arange(32), len(self.path) - 1)]
        path_robot = to_robot(ahead, self.pose)
        tracks = {
            "positions": np.zeros((8, 2)),
            "velocities": np.zeros((8, 2)),
            "radii": np.zeros(8),
            "ages": np.zeros(8, int),
            "valid": np.arange(8) < len(self.walkers),
        }
        turned = [0.0, 0.0, self.pose[2]]
        for k, (walker, walk) in enumerate(zip(self.walkers, self.walks, strict=True)):
            tracks["positions"][k] = to_robot(walker[:2], self.pose)
            tracks["velocities"][k] = to_robot(walk, turned)
            tracks["radii"][k] = walker[2]
        return {
            "scan": scan_of(np.concatenate([self.posts, self.walkers]), self.pose),
            "pose": self.pose.copy(),
            "twist": self.twist.copy(),
            "goal_robot": to_robot(self.goal, self.pose),
            "guide_robot": path_robot[25],
            "path_robot": path_robot,
            "map": np.zeros((64, 64), np.float32),
            "received_map": np.zeros((160, 160), np.uint8),
            "tracks": tracks,
            "time_s": self.time_s,
            "idle": False,
            "truth": self._truth(),
        }

    def _truth(self):
        return {
            "pose": np.add(self.pose, [6.0, 6.0, 0.0]),
            "twist": self.twist.copy(),
            "goal": self.goal + 6.0,
            "static_field": np.full((120, 120), 5.0, np.float32),
            "circles": np.add(self.walkers, [6.0, 6.0, 0.0]),
            "circle_velocities": self.walks,
            "num_circles": len(self.walkers),
            "boxes": np.zeros((0, 5)),
            "box_velocities": np.zeros((0, 2)),
            "num_boxes": 0,
        }

    def move(self, command):
        """One control step of unicycle kinematics within the acceleration limits."""
        self.twist += np.clip(np.asarray(command) - self.twist, [-0.1, -0.25], [0.1, 0.25])
        middle = self.pose[2] + 0.05 * self.twist[1]
        self.pose += 0.1 * np.array([self.twist[0] * np.cos(middle), self.twist[0] * np.sin(middle), self.twist[1]])
        self.walkers[:, :2] += 0.1 * self.walks
        self.time_s += 0.1
        self.trail.append(self.pose.copy())

    def drive(self, planner, seconds):
        """Least gap from the hull to anything [m], and whether the goal was reached."""
        planner.reset([0])
        least = np.inf
        for _ in range(round(10 * seconds)):
            self.move(planner.act(None, [self.info()])[0])
            things = np.concatenate([self.posts, self.walkers])
            gaps = np.hypot(*(things[:, :2] - self.pose[:2]).T) - things[:, 2] - HULL
            least = min(least, *gaps) if len(gaps) else least
            if np.hypot(*(self.pose[:2] - self.goal)) < 0.4:
                return least, True
        return least, False


def made(arm, **knobs):
    """The arm, or a skip where its package is missing."""
    if arm.startswith("orca"):
        pytest.importorskip("pyrvo")
    return make_planner(arm, Config(), **knobs)


def assorted_planes():
    return [
        Plane((4.0, 0.5)),
        Plane((2.0, -3.0), [(1.5, -1.0, 0.3), (0.6, 0.6, 0.2)], start=(0.0, 0.0, 2.0)),
        Plane((-3.0, 1.0), [(1.0, 0.0, 0.5)], [(2.0, 1.0, 0.3)], [(-0.8, -0.4)]),
    ]


@pytest.mark.parametrize("arm", ARMS)
def test_every_arm_gives_finite_commands_inside_the_hardware_box_whoever_else_is_in_the_batch(arm):
    planes, planner = assorted_planes(), made(arm)
    planner.reset(range(3))
    alone = [made(arm) for _ in planes]
    for _ in range(6):
        infos = [plane.info() for plane in planes]
        commands = planner.act(None, infos)
        assert commands.shape == (3, 2)
        assert np.isfinite(commands).all()
        assert (np.abs(commands) <= [0.8, 1.2]).all()
        for i, (one, info) in enumerate(zip(alone, infos, strict=True)):
            np.testing.assert_array_equal(one.act(None, [info])[0], commands[i])
        for plane, command in zip(planes, commands, strict=True):
            plane.move(command)


@pytest.mark.parametrize("arm", ARMS)
def test_an_idle_world_is_commanded_to_stand(arm):
    info = assorted_planes()[1].info() | {"idle": True}
    np.testing.assert_array_equal(made(arm).act(None, [info]), [[0.0, 0.0]])


@pytest.mark.parametrize("arm", ARMS)
def test_a_reset_forgets_the_episode_before(arm):
    used, fresh = made(arm), made(arm)
    for _ in range(3):
        used.act(None, [assorted_planes()[2].info()])
    used.reset([0])
    plane = assorted_planes()[1]
    np.testing.assert_array_equal(used.act(None, [plane.info()]), fresh.act(None, [plane.info()]))


def test_unknown_arms_and_knobs_are_refused_with_the_known_ones():
    with pytest.raises(UnusableInput, match=r"unknown arm 'a-star'.*astar"):
        make_planner("a-star")
    with pytest.raises(UnusableInput, match=r"unknown knob 'speed'.*max_speed"):
        make_planner("astar", speed=0.5)
    with pytest.raises(UnusableInput, match="share"):
        make_planner("drive_wait_straight", share=1.5)


@pytest.mark.parametrize(
    "arm", ["ceiling@max_speed=nan", "astar@max_speed=-1", "crawl@speed=inf", "cv_sampling@calm=-1"]
)
def test_knobs_that_are_negative_or_not_finite_are_refused_by_name(arm):
    with pytest.raises(UnusableInput, match=rf"'{arm}': [a-z_]+ must be a finite number of at least 0"):
        make_planner(arm)


def test_who_samples_commands_needs_a_speed_to_sample():
    for arm in ("ceiling@max_speed=0", "cv_sampling@max_speed=0", "dwa@max_speed=0"):
        with pytest.raises(UnusableInput, match="max_speed above 0"):
            make_planner(arm)


def test_blind_drivers_do_what_they_are_called():
    ahead, behind = Plane((4.0, 0.0)), Plane((-4.0, 0.1))
    assert made("stand_still").act(None, [ahead.info()])[0].tolist() == [0.0, 0.0]
    assert made("straight").act(None, [ahead.info()])[0].tolist() == [0.8, 0.0]
    assert made("straight").act(None, [behind.info()])[0].tolist() == [0.0, 1.2]
    assert made("crawl").act(None, [ahead.info()])[0].tolist() == [0.29, 0.0]


def test_waiting_drivers_wait_when_and_for_as_long_as_they_say():
    def speeds(planner, goal_m):
        plane = Plane((goal_m, 0.0))
        planner.reset([0])
        for _ in range(120):
            plane.move(planner.act(None, [plane.info()])[0])
        return np.array(plane.trail)[:, 0]

    x = speeds(made("wait_then_straight", wait_s=3.0), 20.0)
    assert x[30] == 0.0
    assert x[32] > 0.0
    x = speeds(made("drive_wait_straight", share=0.25, wait_s=4.0), 8.0)
    stood = np.flatnonzero(np.diff(x) == 0.0)
    assert x[stood[0]] == pytest.approx(0.25 * 8.0 + 0.4, abs=0.15)  # it brakes from 0.8 m/s within 0.4 m
    assert len(stood) == pytest.approx(40 - 8, abs=2)


def test_pursuit_keeps_to_a_path_with_a_right_angle():
    corner = np.concatenate([np.linspace([0, 0], [3, 0], 31), np.linspace([3, 0.1], [3, 3], 30)])
    plane = Plane((3.0, 3.0), path=corner)
    _, arrived = plane.drive(made("astar"), 15)
    assert arrived
    trail = np.array(plane.trail)[:, None, :2]
    assert np.hypot(*np.moveaxis(trail - corner, -1, 0)).min(axis=1).max() < 0.3


def test_pursuit_stops_before_a_post_on_its_path_and_two_stray_beams_do_not_stop_it():
    plane = Plane((6.0, 0.0), [(3.0, 0.0, 0.3)])
    least, arrived = plane.drive(made("astar"), 12)
    assert not arrived
    assert 0.0 < least < 0.3
    plane = Plane((6.0, 0.0))
    info = plane.info()
    info["scan"][540:542, 0] = 0.4
    assert made("astar").act(None, [info])[0, 0] == 0.8
    info["scan"][539:542, 0] = 0.4
    assert made("astar").act(None, [info])[0, 0] < 0.4


@pytest.mark.parametrize("arm", ["dwa", "cv_sampling", "rrtstar", "orca"])
def test_drivers_that_look_go_round_a_post(arm):
    plane = Plane((6.0, 0.0), [(2.5, 0.1, 0.3), (4.2, -0.9, 0.2)])
    least, arrived = plane.drive(made(arm), 25)
    assert arrived
    assert least > 0.0


@pytest.mark.parametrize("arm", ["cv_sampling", "orca"])
def test_drivers_that_track_do_not_meet_somebody_who_crosses_and_the_blind_one_does(arm):
    def scene():
        return Plane((6.0, 0.0), walkers=[(3.0, -3.3, 0.3)], walks=[(0.0, 0.8)])

    least, _ = scene().drive(made("straight"), 12)
    assert least < 0.0
    least, arrived = scene().drive(made(arm), 20)
    assert arrived
    assert least > 0.05


def test_a_cap_on_the_speed_is_kept_by_every_arm_that_takes_one():
    for arm in ["astar", "rrtstar", "dwa", "cv_sampling", "orca", "ceiling"]:
        plane = Plane((5.0, 0.0))
        plane.drive(made(arm, max_speed=0.4), 4)
        steps = np.hypot(*np.diff(np.array(plane.trail)[:, :2], axis=0).T)
        assert 0.03 < steps.max() <= 0.04 + 1e-9, arm


def test_clearance_around_the_robot_equals_brute_force_on_the_hits_themselves():
    rng = np.random.default_rng(4)
    points = rng.uniform(-4.0, 4.0, (60, 2))
    centre = ORIGIN_M + (np.arange(CELLS) + 0.5) * RESOLUTION_M
    x, y = np.meshgrid(centre, centre)
    inside = points[(np.abs(points) < 3.2).all(axis=1)]
    expected = np.hypot(x[..., None] - inside[:, 0], y[..., None] - inside[:, 1]).min(axis=-1)
    # The nearest cell need not hold the nearest hit: off by less than a cell's diagonal, and rarely.
    error = np.abs(clearance_around(points) - expected)
    assert error.max() < 0.15
    assert np.median(error) < 0.01


def test_a_solid_cell_of_the_map_crop_lies_where_the_map_says():
    crop = np.zeros((64, 64), np.float32)
    crop[10, 40] = 1.0  # x ahead (31.5 - 10) * 0.1, y left (31.5 - 40) * 0.1
    cells = occupied_cells(crop, 0.3)
    iy, ix = np.argwhere(cells)[0]
    assert ORIGIN_M + (ix + 0.5) * RESOLUTION_M == pytest.approx(2.15)
    assert ORIGIN_M + (iy + 0.5) * RESOLUTION_M == pytest.approx(-0.85)


def cluttered_levels(seed, size=160):
    rng = np.random.default_rng(seed)
    grid = np.zeros((size, size), np.uint8)
    for x, y in rng.integers(20, size - 20, (14, 2)):
        grid[y : y + 9, x : x + 6] = Cell.FURNITURE
    start, goal = np.array([10.5, 12.5]), np.array([146.5, 140.5])
    return grid, levels_kernel.clearance_levels(grid, 0, 0), start, goal


@pytest.mark.parametrize("seed", range(5))
def test_rrtstar_ways_are_free_short_and_the_same_for_the_same_key(seed):
    grid, levels, start, goal = cluttered_levels(seed)
    corners, again = np.empty((64, 2)), np.empty((64, 2))
    count = rrtstar_kernel.rrt_star(levels, start, goal, np.uint64(seed), 1200, corners)
    assert count >= 2
    np.testing.assert_array_equal(corners[[0, count - 1]], [start, goal])
    solid_y, solid_x = np.nonzero(grid)
    length = 0.0
    for begin, end in pairwise(corners[:count]):
        points = np.linspace(begin, end, 200)
        gap = np.hypot(points[:, :1] - solid_x - 0.5, points[:, 1:] - solid_y - 0.5).min()
        assert gap > 2.0 - 0.3  # HARD lies 2.4 cells from a solid cell's middle; a line is looked at every half cell
        length += np.hypot(*(end - begin))
    inflated = levels >= levels_kernel.HARD
    shortest = distance_field(inflated, (int(goal[1]), int(goal[0])), 1.0)[int(start[1]), int(start[0])]
    assert length < 1.2 * shortest
    assert rrtstar_kernel.rrt_star(levels, start, goal, np.uint64(seed), 1200, again) == count
    np.testing.assert_array_equal(corners[:count], again[:count])


def test_rrtstar_says_so_where_there_is_no_way():
    grid = np.zeros((160, 160), np.uint8)
    grid[:, 80] = Cell.WALL
    levels = levels_kernel.clearance_levels(grid, 0, 0)
    ends = np.array([20.5, 20.5]), np.array([140.5, 20.5])
    assert rrtstar_kernel.rrt_star(levels, *ends, np.uint64(1), 400, np.empty((64, 2))) == 0


def scoring_case():
    """A robot between a wall, somebody who walks and a box, and what `score_commands` takes."""
    y, x = (np.mgrid[:60, :60] + 0.5) * 0.1
    clearance = np.minimum(np.minimum(x, 6.0 - x), np.minimum(y, 6.0 - y))
    fields = way_fields(clearance, (30, 52), 0.1, HULL)
    circles = np.array([[3.5, 1.5, 0.3, 0.0, 0.7], [4.5, 4.5, 0.25, 0.0, 0.0]])
    boxes = np.array([[3.2, 3.3, 0.8, 0.6, 0.2, 0.15, 0.0, 0.0]])
    planner = make_planner("ceiling")
    return np.array([1.5, 2.8, 0.2]), np.array([0.4, 0.1]), fields, circles, boxes, planner._parameters.copy()


def scored(commands, parameters, case, cap):
    pose, twist, fields, circles, boxes, _ = case
    parameters[sampling_kernel.CAP] = cap
    headings = np.linspace(-np.pi, np.pi, 8, endpoint=False)
    costs = np.empty(len(commands))
    goal, grid = np.array([5.25, 3.05]), (0.0, 0.0, 0.1)
    sampling_kernel.score_commands(
        pose, twist, commands, headings, goal, fields.copy(), grid, circles, boxes, parameters, costs
    )
    return costs


def test_costs_within_the_cap_are_what_they_are_without_a_cap():
    case = scoring_case()
    commands = make_planner("ceiling").grid.reshape(-1, 2).copy()
    capped, full = (scored(commands, case[-1].copy(), case, cap) for cap in (1.0, 1e9))
    near = full < full.min() + 0.9
    assert 10 < near.sum() < len(full)
    np.testing.assert_allclose(capped[near], full[near], atol=1e-9)
    assert (capped[~near] > full.min() + 0.5).all()


def test_compiled_scores_windows_and_trees_equal_their_python_source(monkeypatch):
    case = scoring_case()
    commands = make_planner("ceiling").grid[::4, ::5].reshape(-1, 2).copy()
    compiled = scored(commands, case[-1].copy(), case, 3.0)
    twist, goal, limits = np.array([0.3, 0.2]), np.array([2.0, 1.0]), np.array([0.8, 1.2, 1.0, 2.5])
    clearance = clearance_around(np.array([[1.0, 0.1], [1.5, -0.4]]))[None]
    window = (twist, goal, clearance, (ORIGIN_M, ORIGIN_M, RESOLUTION_M), 0.28, limits, 0.25)
    best = dwa_kernel.best_in_window(*window)
    _, levels, start, _ = cluttered_levels(0)
    corners, python_corners = np.empty((64, 2)), np.empty((64, 2))
    tree = (levels[:40, :40].copy(), start, np.array([30.5, 30.5]), np.uint64(3), 60)
    count = rrtstar_kernel.rrt_star(*tree, corners)
    in_python(monkeypatch, sampling_kernel, dwa_kernel, rrtstar_kernel)
    np.testing.assert_allclose(scored(commands, case[-1].copy(), case, 3.0), compiled, rtol=1e-9)
    np.testing.assert_allclose(dwa_kernel.best_in_window(*window), best, rtol=1e-12)
    with np.errstate(over="ignore"):  # the hash wraps around, as uint64 should
        assert rrtstar_kernel.rrt_star(*tree, python_corners) == count
    np.testing.assert_allclose(python_corners[:count], corners[:count])


def test_fields_are_read_as_scipy_interpolates_them():
    rng = np.random.default_rng(2)
    fields = rng.random((1, 30, 40))
    for x, y in rng.uniform(0.3, 2.5, (50, 2)):
        expected = map_coordinates(fields[0], [[(y - 0.1) / 0.1 - 0.5], [(x + 0.2) / 0.1 - 0.5]], order=1)[0]
        assert sampling_kernel.read_bilinear(fields, 0, x, y, (-0.2, 0.1, 0.1), 9.0) == pytest.approx(expected)
    assert sampling_kernel.read_bilinear(fields, 0, -5.0, 1.0, (-0.2, 0.1, 0.1), 9.0) == 9.0


def test_planes_scan_is_the_distance_to_a_post_straight_ahead():
    plane = Plane((4.0, 0.0), [(2.0, 0.0, 0.5)], start=(0.0, 0.0, 0.0))
    assert plane.info()["scan"][540, 0] == pytest.approx(1.5)
    np.testing.assert_allclose(to_world(plane.info()["path_robot"][10], plane.pose), [1.0, 0.0], atol=0.06)
