"""People, groups and pop-up boxes: who reacts, who starts when, and what is fair."""

import numpy as np
import pytest

from dualnav_lite.config import Config
from dualnav_lite.geometry import to_robot
from dualnav_lite.kernels.clearance import line_clearance, static_clearance
from dualnav_lite.kernels.movers import CROSSING, PEDESTRIAN, POP_UP, UNAWARE
from dualnav_lite.layout import generate, shortest_path
from dualnav_lite.pop_ups import _around
from dualnav_lite.rooms import FIELD_RESOLUTION_M, StaticRoom
from dualnav_lite.scenario import SCENARIO_FOLDER, all_scenarios, load_scenario
from dualnav_lite.semantics import Surface
from dualnav_lite.simulation import Simulation

FIRST = 1_000_000
BUSY_ROOM = str(SCENARIO_FOLDER.parent.parent / "training" / "scenarios" / "busy_room.yaml")


def simulate(name, seeds, steps, command=(0.0, 0.0), watch=lambda sim: None):
    """Drive every world blindly for some steps; the list of what `watch` saw."""
    sim = Simulation(len(seeds), Config())
    for i, seed in enumerate(seeds):
        sim.reset(i, load_scenario(name), seed)
    seen = []
    for _ in range(steps):
        sim.advance(np.tile(command, (len(seeds), 1)).astype(float), np.ones(len(seeds), bool))
        seen.append(watch(sim))
    return sim, seen


@pytest.mark.parametrize("name", ["navigation", "battery", "low_light"])
def test_nobody_walks_into_a_robot_that_stands(name):
    _, contacts = simulate(name, range(FIRST, FIRST + 25), 300, watch=lambda sim: sim.contacts.copy())
    assert not np.any(contacts)


def test_pedestrians_do_walk():
    sim, speeds = simulate("navigation", range(FIRST, FIRST + 20), 100, watch=lambda s: s.movers.states[..., 3:].copy())
    walks = np.linalg.norm(speeds, axis=-1)[:, sim.movers.kinds == PEDESTRIAN]
    assert walks.mean() > 0.25
    assert walks.max() < 1.3


def test_the_unaware_walk_straight_at_their_own_speed_and_only_the_training_room_has_them():
    sim, speeds = simulate(BUSY_ROOM, range(8), 60, watch=lambda s: s.movers.states[..., 3:5].copy())
    unaware = sim.movers.kinds == UNAWARE
    assert 0.3 < unaware.sum() / (sim.movers.kinds == PEDESTRIAN).sum() < 3
    walks = np.linalg.norm(speeds, axis=-1)[:, unaware]
    is_walking = walks > 0
    np.testing.assert_allclose(walks[is_walking], np.broadcast_to(sim.movers.speeds[unaware], walks.shape)[is_walking])
    assert 0.4 < is_walking.mean() < 1.0
    assert all(scenario.people.unaware_share == 0 for scenario in all_scenarios().values())


def test_pedestrians_stay_out_of_walls_and_furniture():
    def overlap(sim):
        worst = 0.0
        for i, layout in enumerate(sim.layouts):
            for m in np.flatnonzero(sim.movers.kinds[i] == PEDESTRIAN):
                gap = layout.room.clearance[layout.room.cell(sim.movers.states[i, m, :2])] - sim.movers.radii[i, m]
                worst = min(worst, gap)
        return worst

    _, gaps = simulate("navigation", range(FIRST, FIRST + 20), 200, watch=overlap)
    assert min(gaps) > -0.07  # half a cell of the clearance field


def test_a_crowd_waits_for_a_robot_that_stands_and_never_starts():
    sim, _ = simulate("crowd_crossing", range(FIRST, FIRST + 10), 100)
    assert (sim.movers.events == 0).all()
    assert np.isnan(sim.movers.first_event_s).all()
    assert not np.abs(sim.movers.states[..., 3:5]).any()


def test_a_crowd_meets_the_robot_that_drives_on_and_does_not_react():
    outcomes, gaps = [], []
    for seed in range(FIRST, FIRST + 30):
        sim = Simulation(1, Config())
        layout = sim.reset(0, load_scenario("crowd_crossing"), seed)
        toward = layout.goals[0] - layout.start[:2]
        bearing = np.arctan2(*toward[::-1])
        for _ in range(200):
            error = (bearing - sim.poses[0, 2] + np.pi) % (2 * np.pi) - np.pi
            sim.advance(np.array([[0.8 if abs(error) < 0.2 else 0.0, np.clip(3 * error, -1.2, 1.2)]]), np.ones(1, bool))
            if sim.contacts[0] or np.hypot(*(sim.goals[0] - sim.poses[0, :2])) < 0.4:
                break
        outcomes.append(int(sim.contacts[0]))
        start_line = (layout.crowd.line_point - layout.start[:2]) @ layout.crowd.journey
        gaps.append(start_line)
        assert sim.movers.events[0] == 1
        moving = sim.movers.states[0, :5, 3:5]
        assert np.ptp(moving, axis=0).max() < 1e-9  # one velocity for all: they react to nothing
    hit = np.mean([o == Surface.PERSON for o in outcomes])
    assert hit > 0.9


def test_a_crowd_turns_before_the_wall_and_comes_back():
    sim = Simulation(1, Config())
    layout = sim.reset(0, load_scenario("crowd_crossing"), FIRST)
    sim.movers.group_phase[0] = 1
    sides = []
    for _ in range(600):
        sim.advance(np.zeros((1, 2)), np.ones(1, bool))
        states = sim.movers.states[0, :5]
        ahead = (states[:, :2] - layout.crowd.line_point) @ layout.crowd.across
        sides.append(ahead.max())
        room = layout.room
        head = states[np.argmax(ahead), :2] + 1.4 * layout.crowd.across
        assert min(*head, room.width - head[0], room.height - head[1]) + 0.05 > -1e-6
    signs = np.sign(sides)
    assert (np.diff(signs) != 0).sum() >= 3  # there, back and there again


def test_pop_up_boxes_appear_as_the_article_says():
    """2 m ahead, 0.7 to 1.0 m to the side, 1.5 m/s, stopping within 0.15 m of the robot's line, at any speed."""
    fired = 0
    for seed in range(FIRST, FIRST + 40):
        for speed in (0.8, 0.29):
            sim = Simulation(1, Config())
            layout = sim.reset(0, load_scenario("pop_up"), seed)
            bearing = np.arctan2(*(layout.goals[0] - layout.start[:2])[::-1])
            pose, box, path = None, None, []
            for _ in range(250):
                before = sim.poses[0].copy()
                error = (bearing - sim.poses[0, 2] + np.pi) % (2 * np.pi) - np.pi
                turn = np.clip(3 * error, -1.2, 1.2)
                sim.advance(np.array([[speed if abs(error) < 0.2 else 0.0, turn]]), np.ones(1, bool))
                if box is None and sim.movers.events[0]:
                    pose, box = before, int(np.flatnonzero((sim.movers.kinds[0] == POP_UP) & sim.movers.active[0])[0])
                if box is not None:
                    path.append(sim.movers.states[0, box].copy())
                if sim.contacts[0] or len(path) > 12:
                    break
            if len(path) <= 12:
                continue
            fired += 1
            path = np.array(path)
            speeds = np.hypot(path[:, 3], path[:, 4])
            assert speeds[0] == pytest.approx(1.5)
            begin = path[0, :2] - 0.1 * path[0, 3:5]
            local = to_robot(np.array([begin, path[-1, :2]]), pose)
            assert local[:, 0] == pytest.approx([2.0, 2.0], abs=1e-6)
            assert abs(local[1, 1]) <= 0.15 + 1e-6
            assert 0.7 - 1e-6 <= abs(local[0, 1] - local[1, 1]) <= 1.0 + 1e-6
            assert speeds[-1] < 1e-9
            assert np.hypot(*(path[-1, :2] - layout.goals[0])) >= 0.9
            assert sim.movers.first_event_s[0] > 0
    assert fired > 20


def test_a_box_comes_from_cover_and_where_there_is_none_in_view_at_the_last():
    """Asked at each cell of the shortest path: hidden until 2 m of the way are left for it, then at any fair place."""
    hidden, in_view = 0, 0
    for seed in range(FIRST, FIRST + 30):
        layout = generate(load_scenario("pop_up_cover"), Config(), seed)
        room, path = layout.room, shortest_path(layout.room, layout.goal_field, layout.start[:2])
        for here, ahead in zip(path, path[4:], strict=False):
            pose = np.array([*here, np.arctan2(*(ahead - here)[::-1])])
            placed = layout.pop_ups[0].place(pose, 0.2, room, layout.goals[0], layout.goal_field, [])
            if placed is None:
                continue
            if line_clearance(*here, *placed[0], room.boxes, room.width, room.height) < 0.02:
                hidden += 1
            else:
                in_view += 1
                assert layout.goal_field[room.cell(pose)] <= 2.0 + 0.9 + 2.0
    assert hidden > 100
    assert in_view > 100


def test_the_disc_that_a_box_blocks_holds_the_cells_that_are_within_it():
    """In rooms that are no whole number of cells wide, as most are."""
    for width, height in ((12.0, 8.0), (19.91, 13.37), (8.05, 23.99)):
        clearance = static_clearance(np.zeros((0, 5)), width, height, FIELD_RESOLUTION_M)
        room = StaticRoom(width, height, np.zeros((0, 5)), np.zeros(0, np.uint8), clearance)
        iy, ix = np.indices(clearance.shape)
        for point in ((width - 1.0, height - 1.0), (0.1, 0.1), (0.5 * width, 0.9 * height)):
            expected = np.hypot(0.1 * (ix + 0.5) - point[0], 0.1 * (iy + 0.5) - point[1]) <= 0.7
            found = np.zeros_like(expected)
            window, distance = _around(point, 0.7, room)
            found[window] = distance <= 0.7
            assert (found == expected).all()
            assert distance[tuple(np.subtract(room.cell(point), [part.start for part in window]))] <= 0.0708


def test_a_pop_up_box_is_not_there_before_it_fires():
    sim, _ = simulate("pop_up", range(FIRST, FIRST + 10), 20)
    boxes = sim.movers.kinds == POP_UP
    assert boxes.any()
    assert not sim.movers.active[boxes].any()


def test_a_crossing_group_is_marked_as_people():
    sim, _ = simulate("crowd_crossing", [FIRST], 1)
    assert (sim.movers.kinds[0, :5] == CROSSING).all()
    assert sim.scene.num_circles[0] == 5
    assert (sim.scene.circle_surface[0, :5] == Surface.PERSON).all()


def test_a_pedestrian_who_gets_nowhere_turns_to_the_next_waypoint():
    sim = Simulation(1, Config())
    world, person = 0, 0
    seed = next(
        s
        for s in range(FIRST, FIRST + 50)
        if PEDESTRIAN in {m.kind for m in sim.reset(0, load_scenario("battery"), s).movers}
    )
    layout = sim.reset(0, load_scenario("battery"), seed)
    person = next(m for m, plan in enumerate(layout.movers) if plan.kind == PEDESTRIAN)
    sim.movers.waypoints[world, person, 0] = -5.0, -5.0  # behind the wall
    sim.movers.index[world, person] = 0
    for _ in range(400):
        sim.advance(np.zeros((1, 2)), np.ones(1, bool))
        if sim.movers.index[world, person] != 0:
            return
    pytest.fail("leans on the wall for ever")
