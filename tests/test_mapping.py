"""The map agrees with the room, forgets people and ghosts, and comes over the link as late and as often as asked."""

from itertools import pairwise

import numpy as np
import pytest

from dualnav_lite import config
from dualnav_lite.geometry import beam_directions, box_segments, to_world
from dualnav_lite.kernels import crop as crop_kernels
from dualnav_lite.kernels import grid as grid_kernels
from dualnav_lite.kernels import link as link_kernels
from dualnav_lite.lidar import Lidar
from dualnav_lite.mapping import CROP_CELLS, Mapper
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import CELL_VALUE, LABEL, Cell, Surface
from dualnav_lite.streams import stream_key
from tests.kernels_in_python import in_python
from tests.rooms import divided_room

RESOLUTION, CELLS = 0.1, 160
DT = 0.1
BEAMS = 1080
BEARINGS = -np.pi + 2 * np.pi * np.arange(BEAMS) / BEAMS
ROOM = divided_room()


class Robot:
    """One or more robots with lidar and map, driven along given poses; the step counts by itself."""

    def __init__(self, pose, lux=300.0, cache=True, delay_s=0.0, loss=0.0, burst_mean_s=0.0, seed=0, confusion=0.02):
        poses = np.atleast_2d(np.asarray(pose, float))
        self.n = len(poses)
        sensor = config.Lidar(label_confusion=confusion)
        self.lidar = Lidar(sensor, self.n)
        self.mapper = Mapper(config.Map(cache=cache), sensor, self.n, DT)
        self.lux, self.step = np.full(self.n, float(lux)), np.zeros(self.n, np.int64)
        self.keys = np.array([stream_key(seed + i, "lidar") for i in range(self.n)])
        links = np.array([stream_key(seed + i, "link") for i in range(self.n)])
        self.mapper.reset(np.arange(self.n), poses, delay_s, loss, burst_mean_s, links)

    def look(self, pose, scene):
        """Scan from (n, 3) poses, update the map, and keep the scan as what `crops` and `plan_grids` are given."""
        poses = np.atleast_2d(np.asarray(pose, float))
        self.seen = (poses, *self.lidar.scan(poses, scene, self.lux, self.keys, self.step))
        self.mapper.update(*self.seen, self.step, np.ones(self.n, bool))
        self.step += 1
        return self

    def map(self, world=0):
        """(G, G) cell codes from the window's lowest cell on, and the (G, G, 2) middles of its cells [m]."""
        corner = self.mapper.received_corners[world]
        codes = np.roll(self.mapper.received[world], (-corner[1], -corner[0]), (0, 1))
        return codes, np.stack(np.meshgrid(*((corner[:, None] + np.arange(CELLS) + 0.5) * RESOLUTION)), axis=-1)

    def code_at(self, x, y, world=0):
        column, row = np.floor(np.array([x, y]) / RESOLUTION).astype(int) % CELLS
        return self.mapper.received[world, row, column]

    def crop(self):
        return self.mapper.crops(*self.seen)[0]


def drive(*waypoints, speed=0.6):
    """(steps, 3) poses along straight lines between waypoints, facing ahead."""
    legs = []
    for begin, end in pairwise(waypoints):
        way = np.subtract(end, begin)
        count = int(np.hypot(*way) / (speed * DT))
        places = begin + np.arange(count)[:, None] / count * way
        legs.append(np.column_stack([places, np.full(count, np.arctan2(way[1], way[0]))]))
    return np.concatenate(legs)


TOUR = drive((3, 4), (3, 2.5), (3.5, 5.5), (2, 4), (5, 4), (8, 4), (8, 5.3), (6, 5.5), (6, 2), (5.8, 4), (3, 4))


def map_after_tour(lux):
    robot, scene = Robot(TOUR[0], lux), ROOM.scene()
    for pose in TOUR:
        robot.look(pose, scene)
    return robot.map()


def surface_points(surface):
    """Points every 5 cm along what the room shows of one surface."""
    outline = [[0, 0, 0, 8], [0, 8, 10, 8], [10, 8, 10, 0], [10, 0, 0, 0]] if surface == Surface.WALL else []
    sides = box_segments(ROOM.boxes[ROOM.box_surface == surface]).reshape(-1, 4)
    points = []
    for line in [*np.array(outline, float), *sides]:
        count = int(np.hypot(*(line[2:] - line[:2])) / 0.05)
        points.append(line[:2] + (np.arange(count)[:, None] + 0.5) / count * (line[2:] - line[:2]))
    return np.concatenate(points)


def share_shown(codes, middles, points, wanted):
    """Share of points with a cell of a wanted code at most one cell off."""
    found = middles[np.isin(codes, wanted)]
    return (np.abs(points[:, None] - found[None]).max(axis=2).min(axis=1) <= 1.5 * RESOLUTION).mean()


@pytest.mark.parametrize(("lux", "right", "stray"), [(300, 0.97, 0), (5, 0.97, 5)])
def test_map_after_a_tour_agrees_with_the_room(lux, right, stray):
    codes, middles = map_after_tour(lux)
    depth = ROOM.depth(middles.reshape(-1, 2)).reshape(codes.shape)
    open_floor = depth > RESOLUTION
    assert (codes[open_floor] == Cell.FREE).mean() > right  # the rest is out of sight behind furniture
    assert (codes[open_floor] >= Cell.DOOR).sum() <= stray
    assert not np.any((codes == Cell.FREE) & (depth < -2 * RESOLUTION))  # nobody sees through a wall
    assert share_shown(codes, middles, surface_points(Surface.WALL), [Cell.WALL]) > 0.98
    assert share_shown(codes, middles, surface_points(Surface.DOOR), [Cell.DOOR]) > 0.95
    furniture = share_shown(codes, middles, surface_points(Surface.FURNITURE), [Cell.FURNITURE])
    assert furniture > 0.65  # some sides are out of sight


def test_each_occupied_cell_carries_the_label_of_what_stands_there():
    codes, middles = map_after_tour(300)
    for surface, cell in ((Surface.WALL, Cell.WALL), (Surface.DOOR, Cell.DOOR), (Surface.FURNITURE, Cell.FURNITURE)):
        places = middles[codes == cell]
        off = np.abs(places[:, None] - surface_points(surface)[None]).max(axis=2).min(axis=1)
        assert (off <= 1.5 * RESOLUTION).mean() > 0.99


def with_person(x, y):
    scene = ROOM.scene()
    scene.add_circles(0, [[x, y, 0.28]], Surface.PERSON)
    return scene


def test_a_person_walking_past_is_not_burnt_into_the_map():
    robot, marked = Robot([1.5, 4, 0]), 0
    for step in range(80):
        scene = with_person(3.6, 2.0 + 0.05 * step)
        robot.look([1.5, 4, 0], scene)
        codes, middles = robot.map()
        lane = (np.abs(middles[..., 0] - 3.6) < 0.5) & (np.abs(middles[..., 1] - 4) < 2.5)
        marked = max(marked, (codes[lane] >= Cell.DOOR).sum())
    assert marked <= 1
    assert np.all(codes[lane & (middles[..., 1] < 5)] < Cell.DOOR)


def test_a_person_who_stands_for_ten_seconds_is_not_burnt_into_the_map():
    robot, scene = Robot([1.5, 4, 0]), with_person(3.0, 4.0)
    for _ in range(100):
        codes, middles = robot.look([1.5, 4, 0], scene).map()
    near = np.hypot(middles[..., 0] - 3.0, middles[..., 1] - 4.0) < 0.5
    assert (codes[near] >= Cell.DOOR).sum() <= 1


def test_ghosts_at_five_lux_are_rarely_marked():
    robot, scene, pose = Robot([3, 4, 0], lux=5), ROOM.scene(), np.array([3, 4, 0.0])
    clean = robot.lidar.cast(pose[None], scene)[0][0].copy()
    ghosts, marked = 0, 0
    for _ in range(300):
        robot.look(pose, scene)
        scan = robot.seen[1][0]
        is_ghost = (scan[:, 1] > 0) & (scan[:, 0] < clean - 0.35)
        ends = to_world(np.column_stack([np.cos(BEARINGS), np.sin(BEARINGS)]) * scan[:, :1], pose)[is_ghost]
        ghosts += is_ghost.sum()
        marked += sum(robot.code_at(*end) >= Cell.DOOR for end in ends)
    assert ghosts > 1500
    assert marked < 0.005 * ghosts


def test_a_lost_beam_says_nothing():
    robot, lost = Robot([5, 4, 0]), np.zeros((1, BEAMS, 2), np.float32)
    lost[..., 0] = 10.0
    robot.mapper.update(np.array([[5.0, 4, 0]]), lost, np.zeros((1, BEAMS), np.uint8), np.array([0]), np.array([True]))
    assert np.all(robot.mapper.received == Cell.UNKNOWN)


def test_a_faint_return_frees_the_way_to_it_and_marks_nothing():
    robot, scan = Robot([5.05, 4.05, 0]), np.zeros((1, BEAMS, 2), np.float32)
    scan[..., 0], scan[..., 1] = 2.0, 0.04
    for step in range(6):
        robot.mapper.update(
            np.array([[5.05, 4.05, 0]]), scan, np.full((1, BEAMS), 3, np.uint8), np.array([step]), np.array([True])
        )
    assert robot.code_at(6.5, 4.05) == Cell.FREE
    assert robot.code_at(7.05, 4.05) == Cell.UNKNOWN


def test_what_was_moved_away_is_forgotten_and_what_came_is_marked():
    robot, empty, with_box = Robot([2, 4, 0]), ROOM.scene(), ROOM.scene()
    with_box.add_boxes(0, [[3.5, 4, 0, 0.2, 0.2]], Surface.BOX)
    for _ in range(20):
        robot.look([2, 4, 0], empty)
    assert robot.code_at(3.35, 4.05) == Cell.FREE
    for _ in range(4):
        robot.look([2, 4, 0], with_box)
    assert robot.code_at(3.35, 4.05) == Cell.FURNITURE
    for _ in range(100):
        robot.look([2, 4, 0], with_box)
    for _ in range(30):
        robot.look([2, 4, 0], empty)
    assert robot.code_at(3.35, 4.05) == Cell.FREE


def test_the_window_forgets_what_it_leaves_and_never_shows_it_elsewhere():
    corridor = Scene.empty(1)
    corridor.add_segments(0, [[0, 0, 0, 2], [0, 2, 60, 2], [60, 2, 60, 0], [60, 0, 0, 0]], Surface.WALL)
    corridor.add_boxes(
        0, [[x, 0.2, 0, 0.2, 0.2] for x in range(3, 60, 3)], Surface.FURNITURE
    )  # 3 m does not divide the window
    robot = Robot([1, 1.2, 0])
    there, back = drive((1, 1.2), (45, 1.0), speed=5), drive((45, 1.0), (20, 1.2), speed=5)
    for step, pose in enumerate([*there, *back]):
        robot.look(pose, corridor)
        if step % 10 == 0:
            codes, middles = robot.map()
            assert np.all(np.abs(middles.mean(axis=(0, 1)) - pose[:2]) <= 1.01 * RESOLUTION)
            x, y = middles[codes >= Cell.DOOR].T
            beside_box = (np.abs((x - 1.5) % 3 - 1.5) < 0.4) & (y < 0.6)
            assert np.all((y < 0.15) | (y > 1.85) | (np.abs(x) < 0.15) | beside_box)
            x, y = middles[codes == Cell.FREE].T
            assert np.all((x > 0) & (y > 0) & (y < 2))


def test_a_jump_out_of_the_window_forgets_everything():
    robot = Robot([3, 4, 0]).look([3, 4, 0], ROOM.scene())
    lost = np.zeros((1, BEAMS, 2), np.float32)
    lost[..., 0] = 10.0
    robot.mapper.update(np.array([[3.0, 44, 0]]), lost, np.zeros((1, BEAMS), np.uint8), np.array([1]), np.array([True]))
    assert np.all(robot.mapper.received == Cell.UNKNOWN)


# The link.


def ages(steps=4000, **link):
    """Age [s] of the received map after each step on a link."""
    robot = Robot([3, 4, 0], **link)
    scan = np.zeros((1, BEAMS, 2), np.float32)
    scan[..., 0] = 10.0
    labels, seen = np.zeros((1, BEAMS), np.uint8), []
    for step in range(steps):
        robot.mapper.update(np.array([[3.0, 4, 0]]), scan, labels, np.array([step]), np.array([True]))
        seen.append(robot.mapper.age_s[0])
    return np.array(seen)


def test_without_trouble_the_map_is_never_old():
    assert np.all(ages(50) == 0)


def test_delay_is_exact():
    np.testing.assert_allclose(ages(30, delay_s=1.0), np.minimum(np.arange(1, 31) * DT, 1.0))
    robot = Robot([3, 4, 0], delay_s=0.5)
    first, second = ROOM.scene(), ROOM.scene()
    second.add_boxes(0, [[3.55, 4.05, 0, 0.2, 0.2]], Surface.FURNITURE)
    for step in range(40):
        robot.look([2, 4, 0], first if step < 20 else second)
        if step >= 22 and robot.code_at(3.37, 4.05) == Cell.FURNITURE:
            break
    undelayed = Robot([3, 4, 0])
    for sooner in range(40):
        undelayed.look([2, 4, 0], first if sooner < 20 else second)
        if sooner >= 20 and undelayed.code_at(3.37, 4.05) == Cell.FURNITURE:
            break
    assert step - sooner == 5


def test_a_late_map_is_the_map_as_it_was():
    late, prompt, sent = Robot(TOUR[0], delay_s=0.7), Robot(TOUR[0]), []
    for pose in TOUR[:40]:
        late.look(pose, ROOM.scene())
        prompt.look(pose, ROOM.scene())
        sent.append((prompt.mapper.received.copy(), prompt.mapper.received_corners.copy()))
    np.testing.assert_array_equal(late.mapper.received, sent[-8][0])
    np.testing.assert_array_equal(late.mapper.received_corners, sent[-8][1])


@pytest.mark.parametrize("delay_s", [0.0, 1.0])
def test_loss_is_what_was_asked(delay_s):
    arrived = ages(8000, loss=0.3, delay_s=delay_s)[20:] == delay_s
    assert 1 - arrived.mean() == pytest.approx(0.3, abs=0.015)
    assert (~arrived[1:] & ~arrived[:-1]).mean() == pytest.approx(0.09, abs=0.015)  # independent


def test_bursts_are_as_long_as_asked_at_the_same_loss():
    lost = ages(30000, loss=0.3, burst_mean_s=1.0) > 0
    starts, ends = np.flatnonzero(np.diff(lost.astype(int)) == 1), np.flatnonzero(np.diff(lost.astype(int)) == -1)
    lengths = ends[ends > starts[0]][: len(starts)] - starts[: len(ends[ends > starts[0]])]
    assert lost.mean() == pytest.approx(0.3, abs=0.03)
    assert lengths.mean() * DT == pytest.approx(1.0, abs=0.09)
    assert lengths.std() * DT == pytest.approx(np.sqrt(0.9), abs=0.1)  # geometric


def test_age_grows_by_a_step_for_every_lost_map():
    seen = ages(500, loss=0.5)
    assert np.all((seen == 0) | np.isclose(seen, np.concatenate([[0], seen[:-1]]) + DT))
    assert seen.max() > 2 * DT


@pytest.mark.parametrize("link", [{"loss": 1.0}, {"loss": -0.1}, {"loss": 0.9, "burst_mean_s": 0.2}, {"delay_s": -1}])
def test_a_link_that_cannot_be_is_refused(link):
    with pytest.raises(ValueError, match="link"):
        Robot([0, 0, 0], **link)


# What the robot sees of it.


def test_a_wall_ahead_appears_in_the_top_rows():
    robot, scene = Robot([8, 4, 0]), Scene.empty(1)
    scene.add_room(0, 10.0, 8.0)
    for _ in range(5):
        robot.look([8, 4, 0], scene)
    rows = np.flatnonzero((robot.crop() == CELL_VALUE[Cell.WALL]).mean(axis=1) > 0.9)
    assert np.all(np.abs((31.5 - rows) * RESOLUTION - 2.0) <= 0.15)  # a row is x_ahead = (31.5 - row) 0.1
    assert len(rows)


def test_what_stands_to_the_left_appears_in_the_left_columns():
    robot, scene = Robot([5, 4, np.pi / 2]), Scene.empty(1)  # facing +y, so left is -x
    scene.add_room(0, 10.0, 8.0)
    scene.add_boxes(0, [[3.5, 4, 0, 0.2, 0.2]], Surface.FURNITURE)
    for _ in range(5):
        robot.look([5, 4, np.pi / 2], scene)
    row, column = np.argwhere(robot.crop() == CELL_VALUE[Cell.FURNITURE]).T
    assert np.median((31.5 - column) * RESOLUTION) == pytest.approx(1.3, abs=0.15)  # its near side
    assert np.median((31.5 - row) * RESOLUTION) == pytest.approx(0.0, abs=0.15)


def crop_reference(received, corner, pose):
    """The map around a pose, cell by cell."""
    image = np.empty((CROP_CELLS, CROP_CELLS), np.float32)
    for row in range(CROP_CELLS):
        for column in range(CROP_CELLS):
            x, y = to_world(np.array([31.5 - row, 31.5 - column]) * RESOLUTION, pose)
            cell = np.floor(np.array([x, y]) / RESOLUTION).astype(int)
            is_held = np.all((cell >= corner) & (cell < corner + CELLS))
            image[row, column] = CELL_VALUE[received[cell[1] % CELLS, cell[0] % CELLS] if is_held else Cell.UNKNOWN]
    return image


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.33, -0.21, 2.2), (6, 1, -1), (-30, 7, 3)])
def test_crop_is_what_cell_by_cell_look_up_gives(offset):
    robot = Robot(TOUR[0])
    for pose in TOUR[:60]:
        robot.look(pose, ROOM.scene())
    received, corner = robot.mapper.received[0], robot.mapper.received_corners[0]
    pose, image = TOUR[60] + offset, np.empty((CROP_CELLS, CROP_CELLS), np.float32)
    crop_kernels.crop_map(received, corner, pose, RESOLUTION, CELL_VALUE, image)
    assert (image == crop_reference(received, corner, pose)).mean() > 0.999  # but for middles on a cell's very edge


def test_the_cache_turns_an_old_map_to_the_present_pose_and_lays_the_scan_over_it():
    robot = Robot([2, 4, 0], delay_s=1.0, confusion=0.0)
    for _ in range(40):
        robot.look([2, 4, 0], ROOM.scene())
    pose = [2.4, 4.3, 0.5]
    crop = robot.look(pose, with_person(3.4, 4.6)).crop()
    ahead, left = (np.array([3.4, 4.6]) - pose[:2]) @ np.array(
        [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]
    )
    row, column = int(32 - (ahead - 0.27) / RESOLUTION), int(32 - left / RESOLUTION)
    assert np.any(crop[row - 1 : row + 2, column - 1 : column + 2] == CELL_VALUE[Cell.FURNITURE])
    assert robot.mapper.age_s[0] == pytest.approx(1.0)
    expected = crop_reference(robot.mapper.received[0], robot.mapper.received_corners[0], np.array(pose))
    assert (crop == expected).mean() > 0.93


def test_an_old_map_is_freed_where_the_present_scan_sees_through():
    robot = Robot([2, 4, 0], delay_s=1.0).look([2, 4, 0], ROOM.scene())  # nothing has arrived yet
    crop = robot.crop()
    assert (crop == CELL_VALUE[Cell.FREE]).mean() > 0.3
    assert crop[20, 32] == CELL_VALUE[Cell.FREE]


def test_without_the_cache_the_view_is_the_stale_one():
    late, prompt = Robot(TOUR[0], cache=False, delay_s=1.0), Robot(TOUR[0], cache=False)
    views = []
    for step, pose in enumerate(TOUR[:60]):
        views.append(prompt.look(pose, ROOM.scene()).crop())
        late.look(pose, ROOM.scene())
        if step >= 10:
            np.testing.assert_array_equal(late.crop(), views[step - 10])
    expected = crop_reference(prompt.mapper.received[0], prompt.mapper.received_corners[0], pose)
    assert (views[-1] == expected).mean() > 0.999


def test_the_planner_gets_the_map_with_people_on_it_in_a_window_around_the_robot():
    robot, due = Robot([2, 4, 0], confusion=0.0), np.array([True])
    for _ in range(10):
        robot.look([2, 4, 0], with_person(3.4, 4.05))
    grid = robot.mapper.plan_grids(*robot.seen, due)[0]
    assert grid[40, 31] == Cell.FURNITURE  # the person's near side, 3.12 m
    assert robot.mapper.received[0, 40, 31] < Cell.DOOR
    bare = Robot([2, 4, 0], cache=False)
    for _ in range(10):
        bare.look([2, 4, 0], with_person(3.4, 4.05))
    np.testing.assert_array_equal(bare.mapper.plan_grids(*bare.seen, due), bare.mapper.received)


def test_the_planners_window_moves_with_the_robot_and_holds_no_cell_twice():
    robot, due = Robot([2, 4, 0], delay_s=2.0), np.array([True])
    for _ in range(30):
        robot.look([2, 4, 0], ROOM.scene())
    lost = np.zeros((1, BEAMS, 2), np.float32)
    lost[..., 0] = 10.0
    grid = robot.mapper.plan_grids(np.array([[5.0, 4, 0]]), lost, robot.seen[2], due)[0]
    np.testing.assert_array_equal(robot.mapper.plan_corners[0], [50 - 80, 40 - 80])
    fresh_columns = np.arange(20 + 80, 50 + 80) % CELLS  # x from 10 to 13 m, out of the received window
    assert np.all(grid[:, fresh_columns] == Cell.UNKNOWN)
    kept_columns = np.arange(50 - 80, 20 + 80) % CELLS
    np.testing.assert_array_equal(grid[:, kept_columns], robot.mapper.received[0][:, kept_columns])


def test_crops_are_not_written_again_and_are_image_values():
    robot = Robot([2, 4, 0]).look([2, 4, 0], ROOM.scene())
    first = robot.crop()
    kept = first.copy()
    robot.look([2.5, 4, 1], ROOM.scene()).crop()
    np.testing.assert_array_equal(first, kept)
    assert set(np.unique(first)) <= set(CELL_VALUE)
    assert first.dtype == np.float32


# Many worlds.


def test_a_world_has_the_same_map_whatever_stands_beside_it():
    starts = TOUR[[0, 40, 200]]
    together, alone = (
        Robot(starts, lux=5, delay_s=0.3, loss=0.3),
        Robot(starts[2], lux=5, delay_s=0.3, loss=0.3, seed=2),
    )
    for step in range(20):
        together.look(TOUR[[step, 40 + step, 200 + step]], ROOM.scene(3))
        alone.look(TOUR[200 + step], ROOM.scene())
    assert together.mapper.received[2].tobytes() == alone.mapper.received[0].tobytes()
    assert together.mapper.crops(*together.seen)[2].tobytes() == alone.mapper.crops(*alone.seen)[0].tobytes()
    assert together.mapper.age_s[2] == alone.mapper.age_s[0]


def test_reset_and_rest_concern_single_worlds():
    robot = Robot(TOUR[[0, 40]], delay_s=0.2)
    for step in range(10):
        robot.look(TOUR[[step, 40 + step]], ROOM.scene(2))
    before, age = robot.mapper.received.copy(), robot.mapper.age_s
    robot.mapper.update(*robot.seen, robot.step, np.array([True, False]))
    np.testing.assert_array_equal(robot.mapper.received[1], before[1])
    robot.mapper.reset([1], TOUR[[0]], [1.0], [0.0], [0.0], [stream_key(9, "link")])  # a longer delay than before
    assert np.all(robot.mapper.received[1] == Cell.UNKNOWN)
    robot.step[1] = 0
    for step in range(3):
        robot.look(TOUR[[step, 40 + step]], ROOM.scene(2))
    assert robot.mapper.age_s[0] == pytest.approx(age[0])
    assert robot.mapper.age_s[1] == pytest.approx(0.3)  # nothing has come since the reset


# The kernels as such.


def test_kernel_tables_are_those_of_semantics():
    kernel = grid_kernels
    names = ("FREE", "UNKNOWN", "DOOR", "FURNITURE", "WALL")
    assert {name: getattr(kernel, name) for name in names} == {name: int(Cell[name]) for name in names}
    assert kernel.PERSON_LABEL == Surface.PERSON
    assert set(LABEL) <= set(range(len(kernel.CELL_OF_LABEL)))
    for surface in (Surface.WALL, Surface.DOOR, Surface.FURNITURE):
        assert Cell(int(kernel.CELL_OF_LABEL[surface])).name == surface.name


def test_evidence_and_votes_by_hand():
    cells, evidence, votes = np.full(9, Cell.UNKNOWN, np.uint8), np.zeros(9, np.int8), np.zeros(9, np.uint8)
    found = np.array([4, 4, 4, -1, 4, 7], np.int32)  # a run, a lost beam, the run goes on, another cell
    labels = np.array([1, 1, 1, 0, 1, 4], np.uint8)
    grid_kernels.mark_hits(cells, evidence, votes, found, labels)
    assert evidence[4] == 4
    assert cells[4] == Cell.UNKNOWN  # one scan is not enough
    assert evidence[7] == -2  # a person
    grid_kernels.mark_hits(cells, evidence, votes, found, labels)
    assert cells[4] == Cell.WALL
    for label, winner in ((3, Cell.WALL), (3, Cell.WALL), (3, Cell.FURNITURE)):  # a lead of 2, then the newcomer wins
        grid_kernels.mark_hits(cells, evidence, votes, found[-2:-1], np.array([label], np.uint8))
        assert cells[4] == winner


def test_compiled_maps_crops_and_link_are_the_python_text(monkeypatch):
    rng, n, size, beams = np.random.default_rng(0), 2, 64, 48
    scans = np.stack([rng.uniform(0.3, 3.0, (6, n, beams)), rng.uniform(0.02, 0.5, (6, n, beams))], -1).astype(
        np.float32
    )
    labels = rng.integers(0, 5, (6, n, beams)).astype(np.uint8)
    poses = np.cumsum(rng.normal(0, 0.2, (6, n, 3)), axis=0)
    directions, limits = beam_directions(beams), (RESOLUTION, 10.0)

    def run():
        cells = np.full((n, size, size), Cell.UNKNOWN, np.uint8)
        evidence, votes = np.zeros_like(cells, np.int8), np.zeros_like(cells)
        corners, received, age = np.full((n, 2), -size // 2), cells.copy(), np.zeros(n, int)
        held = received, corners.copy(), np.zeros((n, 3))
        ring = (
            np.zeros((n, 3), bool),
            np.zeros((n, 3, size, size), np.uint8),
            np.zeros((n, 3, 2), int),
            np.zeros((n, 3, 3)),
        )
        link = (
            np.array([0, 2]),
            np.array([0.3, 0.3]),
            np.array([0.0, 3.0]),
            np.array([5, 6], np.uint64),
            np.zeros(n, bool),
        )
        beam, distance = np.indices((8, 8)).sum(axis=0) * 3, np.hypot(*np.indices((8, 8))).astype(np.float32)
        images, grids = np.zeros((n, 8, 8), np.float32), cells.copy()
        active = np.ones(n, bool)
        for t in range(6):
            seen, step = (poses[t], scans[t], labels[t]), np.full(n, t)
            grid_kernels.update_maps(cells, evidence, votes, corners, *seen, step, active, *directions, *limits)
            link_kernels.deliver_maps(cells, corners, poses[t], step, active, *link, *ring, *held, age)
            crop_kernels.crop_maps(
                *held[:2], poses[t], True, age, *seen[1:], beam, distance, *directions, *limits, CELL_VALUE, images
            )
            crop_kernels.plan_grids(
                *held[:2], poses[t], True, *seen[1:], active, *directions, *limits, grids, corners.copy()
            )
        return cells, evidence, votes, *held, age, images, grids

    compiled = run()
    in_python(monkeypatch, grid_kernels, crop_kernels, link_kernels)
    for fast, slow in zip(compiled, run(), strict=True):
        np.testing.assert_array_equal(fast, slow)
