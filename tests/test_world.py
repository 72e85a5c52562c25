"""One world's bodies: free motion is exact, contacts say what was hit, boxes can be pushed."""

import signal
import time

import numpy as np
import pytest

from dualnav_lite.config import Config
from dualnav_lite.geometry import box_corners
from dualnav_lite.kernels.clearance import static_clearance
from dualnav_lite.kernels.scene import place_movers, read_field, renew_phantoms
from dualnav_lite.layout import Layout
from dualnav_lite.pedestrians import CROSSING, FORKLIFT, PEDESTRIAN, PUSHABLE, MoverPlan
from dualnav_lite.robot import Robots
from dualnav_lite.rooms import FIELD_RESOLUTION_M, StaticRoom
from dualnav_lite.scenario import load_scenario
from dualnav_lite.semantics import Surface
from dualnav_lite.simulation import Simulation
from dualnav_lite.world import World


def empty_layout(boxes=(), surfaces=(), movers=(), start=(3.0, 3.0, 0.0)):
    boxes = np.array(boxes, float).reshape(-1, 5)
    room = StaticRoom(
        6.0, 6.0, boxes, np.array(surfaces, np.uint8), static_clearance(boxes, 6.0, 6.0, FIELD_RESOLUTION_M)
    )
    return Layout(
        seed=0,
        room=room,
        start=np.array(start),
        goals=np.array([[5.0, 5.0]]),
        goal_field=np.zeros((60, 60)),
        shortest_path_m=1.0,
        time_limit_s=60.0,
        charge=1.0,
        movers=tuple(movers),
    )


class PressedAtTouch(World):
    """Somebody presses Ctrl-C while pymunk tells of a contact, in a callback from C."""

    after = False

    def _touch(self, *said):
        signal.raise_signal(signal.SIGINT)
        self.after = True
        super()._touch(*said)


def touch_and_wait(world):
    world.advance(np.array([0.2, 0.0, 0.0]), np.zeros((0, 2)), 0.02, 5)
    time.sleep(5.0)


def test_ctrl_c_in_the_physics_is_neither_lost_nor_breaks_in(capfd):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        world = PressedAtTouch(empty_layout(start=(5.7, 3.0, 0.0)), 0.2, 4.0)
        with pytest.raises(KeyboardInterrupt):
            touch_and_wait(world)
    finally:
        signal.signal(signal.SIGINT, before)
    assert world.after
    assert world.contact == Surface.WALL
    assert "ignored" not in capfd.readouterr().err


def push_ahead(world, steps, speed=0.5, movers=1):
    pose, states = np.zeros(3), np.zeros((12, 5))
    for _ in range(steps):
        world.advance(np.array([0.1 * speed, 0.0, 0.0]), np.zeros((12, 2)), 0.02, 5)
        world.read(pose, states)
        if world.contact:
            break
    return pose, states[:movers]


def test_free_motion_is_what_the_wheels_say():
    config, robots = Config(), Robots(1, Config())
    world = World(empty_layout(), 0.2, 15.0)
    expected, pose, states = np.array([3.0, 3.0, 0.0]), np.zeros(3), np.zeros((12, 5))
    for k in range(40):
        robots.drive(expected[None, 2], np.array([[0.4, 0.9 if k % 20 < 10 else -0.9]]))
        world.advance(robots.displacement[0], np.zeros((12, 2)), config.physics_dt_s, config.substeps)
        expected += robots.displacement[0]
        world.read(pose, states)
        assert np.allclose(pose, expected, atol=1e-9)
    assert world.contact == Surface.NOTHING


@pytest.mark.parametrize(
    ("layout", "surface"),
    [
        (empty_layout(start=(5.0, 3.0, 0.0)), Surface.WALL),
        (empty_layout([(4.0, 3.0, 0.3, 0.3, 0.3)], [Surface.FURNITURE]), Surface.FURNITURE),
        (empty_layout([(4.0, 3.0, 0.0, 0.05, 0.06)], [Surface.DOOR]), Surface.DOOR),
        (empty_layout(movers=[MoverPlan(kind=PEDESTRIAN, radius=0.3, pose=(4.0, 3.0, 0.0))]), Surface.PERSON),
        (empty_layout(movers=[MoverPlan(kind=CROSSING, radius=0.3, pose=(4.0, 3.0, 0.0))]), Surface.PERSON),
        (
            empty_layout(movers=[MoverPlan(kind=FORKLIFT, half_length=0.6, half_width=0.4, pose=(4.5, 3.0, 0.0))]),
            Surface.BOX,
        ),
    ],
)
def test_a_contact_says_what_was_hit(layout, surface):
    world = World(layout, 0.2, 15.0)
    push_ahead(world, 60)
    assert world.contact == surface
    world.clear_contact()
    assert world.contact == Surface.NOTHING


def test_a_pushable_box_moves_when_pushed_and_stays_when_left():
    plan = MoverPlan(kind=PUSHABLE, half_length=0.15, half_width=0.15, pose=(3.5, 3.0, 0.0), mass=4.0)
    world = World(empty_layout(movers=[plan]), 0.2, 15.0)
    _, states = push_ahead(world, 60)
    assert world.contact == Surface.BOX
    pose, states = np.zeros(3), np.zeros((12, 5))
    for _ in range(5):
        world.advance(np.array([0.04, 0.0, 0.0]), np.zeros((12, 2)), 0.02, 5)
    world.read(pose, states)
    pushed = states[0, 0]
    assert pushed > 3.6
    for _ in range(20):
        world.advance(np.zeros(3), np.zeros((12, 2)), 0.02, 5)
    world.read(pose, states)
    assert states[0, 0] - pushed < 0.05  # friction with the floor stops it


def test_people_push_boxes_too_and_the_robot_is_not_asked():
    movers = [
        MoverPlan(kind=CROSSING, radius=0.3, pose=(1.0, 1.0, 0.0)),
        MoverPlan(kind=PUSHABLE, half_length=0.15, half_width=0.15, pose=(1.8, 1.0, 0.0), mass=4.0),
    ]
    world = World(empty_layout(movers=movers), 0.2, 15.0)
    velocities, pose, states = np.zeros((12, 2)), np.zeros(3), np.zeros((12, 5))
    velocities[0, 0] = 0.8
    for _ in range(10):
        world.advance(np.zeros(3), velocities, 0.02, 5)
    world.read(pose, states)
    assert states[0, :2] == pytest.approx([1.8, 1.0])
    assert states[1, 0] > 2.0
    assert world.contact == Surface.NOTHING


def test_movers_are_drawn_where_geometry_says():
    kinds = np.array([[1, 5, 3]], np.uint8)
    states = np.array([[[1.0, 2.0, 0.0, 0, 0], [3.0, 1.0, 0.7, 0, 0], [9.0, 9.0, 0.0, 0, 0]]])
    halves = np.array([[[0.0, 0.0], [0.6, 0.4], [0.2, 0.2]]])
    active = np.array([[True, True, False]])
    surfaces = np.array([0, 4, 4, 5, 5, 5], np.uint8)
    for function in (place_movers, place_movers.py_func):
        out = (
            np.zeros((1, 8, 4)),
            np.zeros((1, 8), np.uint8),
            np.zeros(1, np.int64),
            np.zeros((1, 4, 3)),
            np.zeros((1, 4), np.uint8),
            np.zeros(1, np.int64),
        )
        phantoms = np.array([[[5.0, 5.0, 0.1, 9.0, 0.0]]])
        radii = np.array([[0.3, 0.7, 0.3]])
        function(
            kinds,
            surfaces,
            active,
            states,
            radii,
            halves,
            np.zeros(1, np.int64),
            phantoms,
            np.ones(1, np.int64),
            7,
            *out,
        )
        assert out[2][0] == 4
        corners = box_corners([3.0, 1.0, 0.7, 0.6, 0.4])
        assert np.allclose(out[0][0, :4, :2], corners)
        assert np.allclose(out[0][0, :4, 2:], np.roll(corners, -1, axis=0))
        assert out[5][0] == 2
        assert np.allclose(out[3][0, :2], [[1.0, 2.0, 0.3], [5.0, 5.0, 0.1]])
        assert out[4][0, :2].tolist() == [4, 7]


def test_phantoms_stay_in_the_world_live_as_long_as_said_and_are_seen_by_beams_only():
    sim = Simulation(1, Config())
    sim.reset(0, load_scenario("low_light_phantoms"), 1_000_000)
    assert sim.num_phantoms[0] == 6
    lives, begun, places = [], sim.phantoms[0, :6, 3] * 0.0, sim.phantoms[0, :6, :2].copy()
    for _ in range(300):
        sim.advance(np.zeros((1, 2)), np.ones(1, bool))
        for k in range(6):
            x, y, radius = sim.phantoms[0, k, :3]
            if (x, y) != tuple(places[k]):
                lives.append(sim.times_s[0] - begun[k])
                begun[k], places[k] = sim.times_s[0], (x, y)
                away = np.hypot(x - sim.poses[0, 0], y - sim.poses[0, 1])
                assert 0.7 <= away <= 2.5
                assert 0.10 <= radius <= 0.25
    assert min(lives) >= 0.4
    assert max(lives) <= 2.6
    assert np.mean(lives) == pytest.approx(1.55, abs=0.25)
    assert sim.contacts[0] == Surface.NOTHING


def test_compiled_phantoms_equal_the_plain_function():
    results = []
    for function in (renew_phantoms, renew_phantoms.py_func):
        phantoms = np.zeros((1, 8, 5))
        bounds = np.array([[0.5, 2.5]]), np.array([[0.7, 2.5]]), np.array([[0.1, 0.25]])
        key = np.array([77], np.uint64)
        with np.errstate(over="ignore"):
            function(phantoms, np.array([6]), np.array([[1.0, 2.0, 0.5]]), np.zeros(1), key, *bounds, np.ones(1, bool))
        results.append(phantoms)
    assert np.allclose(*results, rtol=0, atol=1e-12)


def test_a_field_is_read_between_its_cells_and_beside_undefined_ones():
    y, x = np.mgrid[:10, :12] * 0.1 + 0.05
    plane = (2 * x + 3 * y)[None]
    points = np.array([[0.5, 0.6, 0.0]])
    out = np.empty(1)
    for function in (read_field, read_field.py_func):
        function(plane, points, 0.1, out)
        assert out[0] == pytest.approx(2.8, abs=1e-6)
    holed = plane.copy()
    holed[0, 5:7, 4] = np.inf
    read_field(holed, points, 0.1, out)
    assert np.isfinite(out[0])


def test_a_robot_is_re_placed_with_room_around_it():
    sim = Simulation(1, Config())
    sim.reset(0, load_scenario("battery"), 1_000_000)
    for _ in range(400):
        sim.advance(np.array([[0.8, 0.0]]), np.ones(1, bool))
        if sim.contacts[0]:
            break
    assert sim.contacts[0]
    assert sim.clearance[0] < 0.05
    sim.replace_robot(0)
    assert sim.clearance[0] > 0.3
    assert sim.robots.twist[0].tolist() == [0.0, 0.0]
