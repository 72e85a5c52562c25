"""Claims about ways through grids, judged by scipy's Dijkstra and by brute force."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from dualnav_lite import routing
from dualnav_lite.config import Guide as GuideConfig
from dualnav_lite.config import Map
from dualnav_lite.kernels import geodesic, paths
from dualnav_lite.kernels import routing as kernels
from dualnav_lite.semantics import Cell


def scipy_geodesic(cost, goal):
    """The same distances by scipy on an explicit graph, in cells."""
    height, width = cost.shape
    rows, columns, lengths = [], [], []
    for y in range(height):
        for x in range(width):
            for dy, dx in [(0, 1), (1, 0), (1, 1), (1, -1)]:
                v, u = y + dy, x + dx
                if not (0 <= v < height and 0 <= u < width):
                    continue
                ends = [cost[y, x], cost[v, u]]
                ends = [1.0 if cell == goal else value for cell, value in zip([(y, x), (v, u)], ends, strict=True)]
                if not np.isfinite(ends).all() or (dx and dy and not np.isfinite([cost[y, u], cost[v, x]]).all()):
                    continue
                rows.append(y * width + x)
                columns.append(v * width + u)
                lengths.append(np.hypot(dy, dx) * np.mean(ends))
    graph = coo_matrix((lengths, (rows, columns)), shape=(cost.size, cost.size)).tocsr()
    return dijkstra(graph, directed=False, indices=goal[0] * width + goal[1]).reshape(height, width)


def random_room(seed, height=17, width=23, share=0.3):
    rng = np.random.default_rng(seed)
    return rng.random((height, width)) < share


@pytest.mark.parametrize("seed", range(4))
def test_distance_field_equals_scipy_dijkstra(seed):
    occupied = random_room(seed)
    occupied[3, 5] = False
    expected = 0.1 * scipy_geodesic(np.where(occupied, np.inf, 1.0), (3, 5))
    np.testing.assert_allclose(routing.distance_field(occupied, (3, 5), 0.1), expected, rtol=1e-12)


def test_distance_field_with_cost_factors_equals_scipy_dijkstra():
    rng = np.random.default_rng(7)
    cost = np.where(random_room(7), np.inf, 1.0 + 9.0 * rng.random((17, 23)))
    cost[8, 11] = 1.0
    np.testing.assert_allclose(routing.distance_field(cost, (8, 11), 1.0), scipy_geodesic(cost, (8, 11)), rtol=1e-12)


def test_compiled_geodesic_equals_its_python_source():
    cost = np.where(random_room(2), np.inf, 1.0)
    np.testing.assert_array_equal(geodesic.geodesic(cost, 3, 5), geodesic.geodesic.py_func(cost, 3, 5))


def test_walled_off_part_is_infinitely_far():
    occupied = np.zeros((20, 20), bool)
    occupied[:, 10] = True
    field = routing.distance_field(occupied, (5, 5), 0.1)
    assert np.isinf(field[:, 10:]).all()
    assert np.isfinite(field[:, :10]).all()


def test_goal_outside_the_grid_and_cheap_factors_are_refused():
    with pytest.raises(ValueError, match="outside"):
        routing.distance_field(np.zeros((4, 5), bool), (4, 0), 0.1)
    with pytest.raises(ValueError, match="at least 1"):
        routing.distance_field(np.full((4, 5), 0.5), (0, 0), 0.1)


def levels_reference(grid, origin_y, origin_x):
    """`clearance_levels` by comparing every cell with every solid one."""
    window = np.roll(grid, (-origin_y, -origin_x), (0, 1))
    solid_y, solid_x = np.nonzero(window >= Cell.DOOR)
    y, x = np.mgrid[: grid.shape[0], : grid.shape[1]]
    squared = ((y[..., None] - solid_y) ** 2 + (x[..., None] - solid_x) ** 2).min(axis=-1)
    levels = np.where(window == Cell.UNKNOWN, 1, 0)
    for level, limit in [(2, 18), (3, 10), (4, 6), (5, 2), (6, 0)]:
        levels[squared <= limit] = level
    return levels


def random_map(seed, size=40, share=0.02):
    rng = np.random.default_rng(seed)
    codes = np.array([Cell.FREE, Cell.UNKNOWN, Cell.DOOR, Cell.FURNITURE, Cell.WALL], np.uint8)
    return rng.choice(codes, size=(size, size), p=[0.7 - share, 0.3, share / 4, share / 4, share / 2])


@pytest.mark.parametrize(("origin_y", "origin_x"), [(0, 0), (13, -7), (-1003, 999)])
def test_levels_equal_brute_force_wherever_the_window_lies_on_the_torus(origin_y, origin_x):
    grid = random_map(3)
    levels = kernels.clearance_levels(grid, origin_y, origin_x)
    np.testing.assert_array_equal(levels, levels_reference(grid, origin_y, origin_x))
    np.testing.assert_array_equal(levels, kernels.clearance_levels.py_func(grid, origin_y, origin_x))


@pytest.mark.parametrize("relaxed", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_astar_is_as_short_as_scipy_dijkstra(seed, relaxed):
    levels = levels_reference(random_map(seed), 0, 0).astype(np.uint8)
    start, goal = (4, 5), (33, 30)
    y, x = np.mgrid[:40, :40]
    near_an_end = np.minimum(*((y - a) ** 2 + (x - b) ** 2 for a, b in (start, goal))) <= 16
    factor = np.choose(levels, [1.0, 1.3, 1.6, 3.0, 20.0, 20.0, np.inf])
    factor[(levels == kernels.CORE) & ~near_an_end] = np.inf
    if not relaxed:
        factor[(levels == kernels.HARD) & ~near_an_end] = np.inf
    factor[start] = min(factor[start], 20.0)
    factor[goal] = min(factor[goal], 20.0)
    expected = scipy_corner_rule(factor, levels, goal)[start]
    cost, came_from = np.empty((40, 40), np.float32), np.empty((40, 40), np.uint8)
    found = kernels.astar(levels, *start, *goal, relaxed, cost, came_from)
    assert found == np.isfinite(expected)
    if found:
        assert cost[goal] == pytest.approx(expected, rel=1e-5)


def scipy_corner_rule(factor, levels, goal):
    """Dijkstra by scipy where only SOLID corners forbid a diagonal."""
    height, width = factor.shape
    rows, columns, lengths = [], [], []
    for y in range(height):
        for x in range(width):
            for dy, dx in [(0, 1), (1, 0), (1, 1), (1, -1)]:
                v, u = y + dy, x + dx
                if not (0 <= v < height and 0 <= u < width) or not np.isfinite([factor[y, x], factor[v, u]]).all():
                    continue
                if dx and dy and kernels.SOLID in (levels[y, u], levels[v, x]):
                    continue
                rows.append(y * width + x)
                columns.append(v * width + u)
                lengths.append(np.hypot(dy, dx) * 0.5 * (factor[y, x] + factor[v, u]))
    graph = coo_matrix((lengths, (rows, columns)), shape=(factor.size, factor.size)).tocsr()
    return dijkstra(graph, directed=False, indices=goal[0] * width + goal[1]).reshape(height, width)


RESOLUTION = 0.1


def painted_map(segments=(), boxes=(), size=160):
    """A map with walls as points every centimetre and solid axis-aligned boxes x0, y0, x1, y1 [m]; toroidal."""
    grid = np.zeros((size, size), np.uint8)
    for x0, y0, x1, y1 in segments:
        share = np.linspace(0, 1, max(2, int(100 * np.hypot(x1 - x0, y1 - y0))))[:, None]
        points = np.array([x0, y0]) + share * np.array([x1 - x0, y1 - y0])
        cells = np.floor(points / RESOLUTION).astype(int) % size
        grid[cells[:, 1], cells[:, 0]] = Cell.WALL
    for x0, y0, x1, y1 in boxes:
        x, y = np.meshgrid(np.arange(x0, x1, 0.05), np.arange(y0, y1, 0.05))
        cells = np.floor(np.stack([x, y], -1) / RESOLUTION).astype(int) % size
        grid[cells[..., 1], cells[..., 0]] = Cell.FURNITURE
    return grid


def furnished_map(seed, offset=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(1.5, 7.5, (9, 2)) + offset
    boxes = np.concatenate([corners, corners + rng.uniform(0.2, 1.0, (9, 2))], axis=1)
    x, y = offset
    walls = [(x, y, x + 10, y), (x, y + 10, x + 10, y + 10), (x, y, x, y + 10), (x + 10, y, x + 10, y + 10)]
    return painted_map(walls, boxes), boxes


def planned(grids, poses, goals, **guide):
    """Guide points, paths and lengths at the first step."""
    poses = np.atleast_2d(np.asarray(poses, float))
    guide = routing.Guide(GuideConfig(**guide), Map(), len(poses))
    return guide.update(np.atleast_3d(grids), poses, np.atleast_2d(np.asarray(goals, float)), np.zeros(len(poses), int))


def whole_path(grid, pose, goal):
    out, counts = np.zeros((1, 512, 2)), np.zeros(1, np.int64)
    poses, goals = np.atleast_2d(np.asarray(pose, float)), np.atleast_2d(np.asarray(goal, float))
    paths.plan_paths(grid[None], RESOLUTION, poses, goals, np.ones(1, bool), out, counts)
    return out[0, : counts[0]]


def distance_to_rectangles(points, boxes):
    low, high = boxes[None, :, :2] - points[:, None], points[:, None] - boxes[None, :, 2:]
    return np.linalg.norm(np.maximum(np.maximum(low, high), 0.0), axis=-1)


@pytest.mark.parametrize("seed", range(12))
def test_paths_keep_the_hull_off_furniture_and_are_nearly_as_short_as_the_geodesic(seed):
    grid, boxes = furnished_map(seed)
    pose, goal = [0.8, 0.9, 0.3], [7.0 + 0.1 * seed, 9.2]
    path = whole_path(grid, pose, goal)
    np.testing.assert_allclose(path[[0, -1]], [pose[:2], goal], atol=1e-12)
    assert distance_to_rectangles(path, boxes).min() > 0.2
    inflated = RESOLUTION * distance_transform_edt(grid[:101, :101] < Cell.DOOR) < 0.35
    goal_cell = int(goal[1] / RESOLUTION), int(goal[0] / RESOLUTION)
    shortest = routing.distance_field(inflated, goal_cell, RESOLUTION)[9, 8]
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() < 1.15 * shortest


@pytest.mark.parametrize("offset", [0.0, 0.02, 0.05, 0.08])
@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4])
def test_path_goes_through_an_opening_of_85_centimetres(offset, angle):
    centre, along = np.array([4.0 + offset, 4.0]), np.array([-np.sin(angle), np.cos(angle)])
    jambs = [centre + side * 0.425 * along for side in (-1, 1)]
    grid = painted_map(
        [(*jamb, *(jamb + side * 12 * along)) for side, jamb in zip((-1, 1), jambs, strict=True)], size=512
    )
    normal = np.array([np.cos(angle), np.sin(angle)])
    path = whole_path(grid, [*(centre - 2 * normal - 1.5 * along), 0.0], centre + 3 * normal + along)
    side = (path - centre) @ normal
    across = (path - centre) @ along
    at_the_wall = np.abs(side) < 0.15
    assert at_the_wall.any()
    assert np.abs(across[at_the_wall]).max() < 0.425 - 0.2


def test_closed_in_goal_gets_a_straight_line_and_not_an_error():
    grid = painted_map([(5, 4, 7, 4), (5, 6, 7, 6), (5, 4, 5, 6), (7, 4, 7, 6)])
    path = whole_path(grid, [1.0, 1.0, 0.0], [6.0, 5.0])
    normal = np.array([-4.0, 5.0]) / np.hypot(5.0, 4.0)
    assert np.abs((path - [1.0, 1.0]) @ normal).max() < 1e-9


def test_guide_point_lies_at_its_distance_along_the_path_round_a_wall():
    grid = painted_map([(3, 0, 3, 6)])
    guide, ahead, length = planned(grid[None], [2.0, 2.0, 0.0], [6.0, 2.0])
    path = whole_path(grid, [2.0, 2.0, 0.0], [6.0, 2.0])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    expected = [np.interp(2.5, along, path[:, axis]) - 2.0 for axis in (0, 1)]
    np.testing.assert_allclose(guide[0], expected, atol=0.05)
    assert 2.0 < np.linalg.norm(np.diff(ahead[0, :26], axis=0), axis=1).sum() <= 2.5 + 1e-9
    assert length[0] == pytest.approx(along[-1], abs=0.05)  # chords cut the corners
    assert length[0] > np.hypot(1, 2) + np.hypot(3, 2)  # round the wall's nearer end at (3, 0)


def test_guide_method_goal_points_at_the_goal_itself():
    grid = painted_map([(3, 0, 3, 6)])
    guide, _, _ = planned(grid[None], [2.0, 2.0, np.pi / 2], [6.0, 2.0], method="goal")
    np.testing.assert_allclose(guide[0], [0.0, -4.0], atol=1e-12)


def test_moving_the_whole_world_by_whole_cells_changes_no_guide_point():
    answers = []
    for offset in [(0.0, 0.0), (-25.6, 51.2), (3.2, -6.4)]:
        grid, _ = furnished_map(5, offset)
        answers.append(planned(grid[None], [0.85 + offset[0], 0.95 + offset[1], 0.3], np.array([8.65, 9.15]) + offset))
    for answer in answers[1:]:
        for got, expected in zip(answer, answers[0], strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-9)


def test_worlds_in_a_batch_do_not_influence_each_other():
    grids = np.stack([furnished_map(seed)[0] for seed in range(5)])
    poses = np.array([[0.8, 0.9, 0.1 * i] for i in range(5)])
    goals = np.array([[9.0, 9.0 - 0.3 * i] for i in range(5)])
    together = planned(grids, poses, goals)
    for i in range(5):
        alone = planned(grids[i : i + 1], poses[i : i + 1], goals[i : i + 1])
        for batched, single in zip(together, alone, strict=True):
            np.testing.assert_array_equal(batched[i], single[0])


def test_way_left_shrinks_by_what_the_robot_drives_along_its_path():
    grid = painted_map([(3, 0, 3, 6)])
    guide = routing.Guide(GuideConfig(replan_steps=1000), Map(), 1)
    goal = np.array([[6.0, 2.0]])
    path = whole_path(grid, [2.0, 2.0, 0.0], goal)
    lengths = []
    for step, point in enumerate(path):
        _, ahead, length = guide.update(grid[None], np.array([[*point, 0.0]]), goal, np.array([step]))
        np.testing.assert_allclose(ahead[0, 0], [0.0, 0.0], atol=1e-9)
        lengths.append(length[0])
    np.testing.assert_allclose(-np.diff(lengths), np.linalg.norm(np.diff(path, axis=0), axis=1), atol=0.05)
    assert lengths[-1] == 0.0


def test_new_goal_or_new_episode_is_planned_at_once():
    grid = np.zeros((1, 160, 160), np.uint8)
    guide = routing.Guide(GuideConfig(), Map(), 1)
    pose = np.array([[2.0, 2.0, 0.0]])
    guide.update(grid, pose, np.array([[6.0, 2.0]]), np.array([0]))
    point, _, _ = guide.update(grid, pose, np.array([[2.0, 6.0]]), np.array([1]))
    np.testing.assert_allclose(point[0], [0.0, 2.5], atol=1e-9)
    wall = painted_map([(0, 3, 5, 3)])[None]
    guide.reset([0])
    point, _, _ = guide.update(wall, pose, np.array([[2.0, 6.0]]), np.array([1]))
    assert abs(point[0, 0]) > 0.5
