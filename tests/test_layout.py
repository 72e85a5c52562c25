"""Layouts: drawn from the seed alone, solvable, and their events can happen."""

import contextlib
import itertools

import numpy as np
import pytest

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.kernels.clearance import hull_clearance, line_clearance, point_clearance, static_clearance
from dualnav_lite.layout import generate
from dualnav_lite.rooms import FIELD_RESOLUTION_M
from dualnav_lite.scenario import Scenario as ScenarioModel
from dualnav_lite.scenario import all_scenarios, load_scenario, validated
from tests.rooms import distance_to_boxes

SEEDS = range(1_000_000, 1_000_030)
SHORT = [name for name in all_scenarios() if name != "battery"]


@pytest.fixture(scope="module")
def layouts():
    config = Config()
    return {name: [generate(load_scenario(name), config, seed) for seed in SEEDS] for name in SHORT}


@pytest.mark.parametrize("name", SHORT)
def test_start_and_goal_have_room_and_lie_the_wished_distance_apart(layouts, name):
    wished = load_scenario(name).room.goal_distance_m
    for layout in layouts[name]:
        room = layout.room
        for point in (layout.start[:2], layout.goals[0]):
            walls = min(*point, room.width - point[0], room.height - point[1])
            boxes = distance_to_boxes(point, room.boxes).min(initial=np.inf)
            assert min(walls, boxes) > 0.30
        beeline = np.hypot(*(layout.goals[0] - layout.start[:2]))
        assert wished.low - 1e-9 <= beeline <= wished.high + 1e-9
        assert layout.shortest_path_m >= beeline - 2 * FIELD_RESOLUTION_M
        assert layout.time_limit_s == pytest.approx(2 * layout.shortest_path_m / 0.8 + 15)


@pytest.mark.parametrize("name", SHORT)
def test_same_seed_same_layout_and_other_seed_another(layouts, name):
    again = generate(load_scenario(name), Config(), SEEDS[0])
    first, second = layouts[name][:2]
    assert np.array_equal(first.start, again.start)
    assert np.array_equal(first.room.boxes, again.room.boxes)
    assert [m.pose for m in first.movers] == [m.pose for m in again.movers]
    assert not np.array_equal(first.start, second.start)


def test_pedestrians_walk_lines_that_are_free(layouts):
    for layout in layouts["navigation"]:
        for mover in layout.movers:
            if mover.radius > 0:
                loop = np.vstack([mover.pose[:2], mover.waypoints])
                for begin, end in itertools.pairwise(loop):
                    gap = line_clearance(*begin, *end, layout.room.boxes, layout.room.width, layout.room.height)
                    assert gap > mover.radius


def test_a_crowd_is_five_people_less_than_half_a_metre_apart(layouts):
    for layout in layouts["crowd_crossing"]:
        poses = np.array([m.pose[:2] for m in layout.movers])
        radii = np.array([m.radius for m in layout.movers])
        assert len(poses) == 5
        assert ((radii >= 0.25) & (radii <= 0.30)).all()
        gaps = np.linalg.norm(poses[:, None] - poses[None], axis=-1) - radii[:, None] - radii[None]
        np.fill_diagonal(gaps, np.inf)
        assert (gaps.min(axis=1) <= 0.5 + 1e-9).all()
        assert gaps.min() > 0.0
        # Nobody stands on the robot's line, and nobody stands in furniture or in a wall.
        across = np.abs((poses - layout.crowd.line_point) @ layout.crowd.across)
        assert across.min() > 0.6
        for pose, radius in zip(poses, radii, strict=True):
            assert point_clearance(*pose, layout.room.boxes, layout.room.width, layout.room.height) > radius - 0.06


def test_a_crowd_aims_at_a_robot_that_drives_on(layouts):
    errors = []
    for layout in layouts["crowd_crossing"]:
        crowd = layout.crowd
        poses = np.array([m.pose[:2] for m in layout.movers])
        depth = (crowd.line_point - poses) @ crowd.across
        errors.append(0.5 * (depth.min() + depth.max()) / crowd.speed - crowd.lead_s)
        assert 1.5 <= crowd.lead_s <= 5.5
    assert np.abs(errors).max() <= 0.6 + 1e-9
    assert np.std(errors) > 0.1


def test_dispatched_goals_are_one_a_period_and_the_wished_distance_apart():
    layout = generate(load_scenario("battery"), Config(), SEEDS[0])
    assert len(layout.goals) == 540
    steps = np.hypot(*np.diff(layout.goals, axis=0).T)
    assert steps.min() >= 5
    assert steps.max() <= 9
    assert layout.charge == 1.0


def test_an_impossible_layout_is_said_in_one_line():
    values = load_scenario("navigation").model_dump()
    values["room"]["goal_distance_m"] = {"low": 40, "high": 50}
    with pytest.raises(UnusableInput, match=r"'navigation', seed 7: no layout fits"):
        generate(validated(ScenarioModel, values, "test"), Config(), 7)


@pytest.mark.parametrize(
    "room",
    [
        {"hall": True, "size_m": (5.0, 5.0), "goal_distance_m": (3.55, 9.0)},  # 5 cm to begin the journey
        {"hall": True, "size_m": (4.0, 4.0), "goal_distance_m": (2.0, 2.6)},  # one line along which it runs
        {"size_m": (3.3, 3.3), "door_width_m": (1.7, 1.7), "walled_share": 1.0, "goal_distance_m": (1.0, 3.0)},
    ],
)
def test_the_tightest_rooms_that_a_scenario_file_may_ask_for_are_drawn(room):
    pairs = {key: {"low": v[0], "high": v[1]} if isinstance(v, tuple) else v for key, v in room.items()}
    nothing = {"low": 0, "high": 0}
    values = {"id": "tight", "title": "t", "title_zh": "t", "people": {"count": nothing, "forklift_share": 0.0}}
    values["room"] = {"walled_share": 0.0, "furniture": nothing, "pushable_boxes": nothing} | pairs
    scenario = validated(ScenarioModel, values, "test")
    for seed in SEEDS:
        layout = generate(scenario, Config(), seed)
        gap = np.hypot(*(layout.goals[0] - layout.start[:2]))
        assert scenario.room.goal_distance_m.low - 1e-9 <= gap <= scenario.room.goal_distance_m.high


def test_clearance_kernels_agree_with_geometry(layouts):
    room = layouts["navigation"][0].room
    rng = np.random.default_rng(0)
    points = rng.uniform(0, [room.width, room.height], (200, 2))
    walls = np.minimum.reduce([points[:, 0], points[:, 1], room.width - points[:, 0], room.height - points[:, 1]])
    expected = np.minimum(walls, distance_to_boxes(points, room.boxes).min(axis=1))
    found = [point_clearance(*p, room.boxes, room.width, room.height) for p in points]
    assert np.allclose(found, expected, atol=1e-12)
    small = room.boxes[:2]
    args = (small, 2.0, 1.5, 0.1)
    assert np.array_equal(static_clearance(*args), static_clearance.py_func(*args))
    field = static_clearance(room.boxes, room.width, room.height, 0.1)
    iy, ix = np.indices(field.shape)
    centres = np.stack([(ix.ravel() + 0.5) * 0.1, (iy.ravel() + 0.5) * 0.1], axis=1)
    walls = np.minimum.reduce([centres[:, 0], centres[:, 1], room.width - centres[:, 0], room.height - centres[:, 1]])
    expected = np.minimum(np.maximum(walls, 0), distance_to_boxes(centres, room.boxes).min(axis=1))
    assert np.allclose(field.ravel(), expected, atol=1e-9)


def test_hull_clearance_is_the_gap_to_the_nearest_line_or_person():
    segments = np.array([[[0.0, 0.0, 4.0, 0.0], [0, 0, 0, 0]]])
    circles = np.array([[[2.0, 3.0, 0.25], [2.0, 1.1, 0.2]]])
    surfaces = np.array([[4, 7]], np.uint8)
    poses = np.array([[2.0, 1.0, 0.3]])
    out = np.empty(1)
    args = (poses, 0.2, segments, np.array([1]), circles, surfaces, np.array([2]), np.uint8(7), out)
    hull_clearance(*args)
    assert out[0] == pytest.approx(0.8)  # the wall; the phantom in front of the hull is not there
    poses[0, 1] = 2.2
    hull_clearance.py_func(*args)
    assert out[0] == pytest.approx(0.35)  # the person


def test_a_hall_just_long_enough_for_its_journey_is_drawn_or_refused_by_name():
    values = {"id": "exact", "title": "t", "title_zh": "t", "room": {"hall": True, "furniture": {"low": 0, "high": 0}}}
    for goal in np.linspace(2.6, 9.0, 65).round(1).tolist():
        size = {"low": round(goal + 1.4, 1), "high": round(goal + 1.4, 1)}
        values["room"] |= {"size_m": size, "goal_distance_m": {"low": goal, "high": goal}}
        with contextlib.suppress(UnusableInput):  # a length may come out a last digit short
            generate(validated(ScenarioModel, values, "test"), Config(), SEEDS[0])
