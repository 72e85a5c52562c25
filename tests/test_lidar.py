"""The lidar sees what geometry, its slow twin and pymunk say, and spoils it as the light asks."""

import numpy as np
import pymunk
import pytest

from dualnav_lite import config
from dualnav_lite.geometry import beam_directions, box_corners, wrap_angle
from dualnav_lite.kernels import lidar as lidar_kernels
from dualnav_lite.kernels import scan_noise
from dualnav_lite.lidar import Lidar
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import LABEL, REFLECTIVITY, Surface
from dualnav_lite.streams import stream_key
from tests.kernels_in_python import in_python
from tests.rooms import furnished_room

BEAMS = 1080
RANGE_MAX = 10.0
BEARINGS = -np.pi + 2 * np.pi * np.arange(BEAMS) / BEAMS
ROOM = furnished_room()


def free_poses(count, seed=0):
    """Poses in the furnished room that are in no box and no person."""
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.uniform([0.1, 0.1], [9.9, 7.9], (20 * count, 2)), rng.uniform(-9, 9, 20 * count)])
    away = np.linalg.norm(poses[:, None, :2] - ROOM.circles[None, :, :2], axis=2) - ROOM.circles[:, 2]
    return poses[(ROOM.depth(poses[:, :2]) > 0) & (away.min(axis=1) > 0)][:count]


def cast(poses, scene, beams=BEAMS):
    """Fresh clean ranges, surfaces and incidence for (k, 3) poses in world 0 of a scene."""
    poses = np.atleast_2d(np.asarray(poses, float))
    one = Scene(*(np.repeat(part[:1], len(poses), axis=0) for part in vars(scene).values()))
    return Lidar(config.Lidar(beams=beams), len(poses)).cast(poses, one)


def one_wall(x0, y0, x1, y1):
    scene = Scene.empty(1)
    scene.add_segments(0, [[x0, y0, x1, y1]], Surface.WALL)
    return scene


def kernel_arguments(poses, scene, beams):
    outputs = np.empty((len(poses), beams)), np.empty((len(poses), beams), np.uint8), np.empty((len(poses), beams))
    return (poses, *vars(scene).values(), RANGE_MAX, *beam_directions(beams), *outputs)


def test_compiled_cast_is_the_python_text(monkeypatch):
    scene = furnished_room(people=3, boxes=4).scene(2)
    poses = np.array([[5.0, 4.0, 0.3], [2.0, 4.2, 3.0]])
    compiled, python = kernel_arguments(poses, scene, 60), kernel_arguments(poses, scene, 60)
    lidar_kernels.cast_scans(*compiled)
    in_python(monkeypatch, lidar_kernels)
    lidar_kernels.cast_scans(*python)
    for fast, slow in zip(compiled[-3:], python[-3:], strict=True):
        np.testing.assert_array_equal(fast, slow)


def test_spans_give_what_every_beam_against_every_surface_gives():
    scene, poses = ROOM.scene(), free_poses(6)
    casts = cast(poses, scene, 216)
    for i, pose in enumerate(poses):
        expected = lidar_kernels.cast_scan_reference(
            pose, scene.segments[0, :64], scene.segment_surface[0, :64], ROOM.circles, np.full(6, 4), RANGE_MAX, 216
        )
        np.testing.assert_allclose(casts[0][i], expected[0], atol=1e-9)
        np.testing.assert_array_equal(casts[1][i], expected[1])
        np.testing.assert_allclose(casts[2][i], expected[2], atol=1e-8)


def pymunk_space(room):
    """The same room out of pymunk's shapes; its outer walls are boxes a metre thick."""
    space = pymunk.Space()
    w, h = room.width, room.height
    walls = [[-1, -1, w + 1, 0], [-1, h, w + 1, h + 1], [-1, -1, 0, h + 1], [w, -1, w + 1, h + 1]]
    polygons = [[(x0, y0), (x1, y0), (x1, y1), (x0, y1)] for x0, y0, x1, y1 in walls]
    polygons += [[tuple(map(float, corner)) for corner in corners] for corners in box_corners(room.boxes)]
    for polygon in polygons:
        space.add(pymunk.Poly(space.static_body, polygon, radius=0))
    for x, y, radius in room.circles:
        space.add(pymunk.Circle(space.static_body, radius, (float(x), float(y))))
    return space


def test_ranges_are_those_of_pymunk_segment_queries():
    space, poses = pymunk_space(ROOM), free_poses(12, seed=1)
    ranges = cast(poses, ROOM.scene())[0]
    corners = np.concatenate([box_corners(ROOM.boxes).reshape(-1, 2), [[0, 0], [10, 0], [10, 8], [0, 8]]])
    doubtful = 0
    for pose, measured in zip(poses, ranges, strict=True):
        for bearing, distance in zip(BEARINGS, measured, strict=True):
            way = np.array([np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)])
            end = pose[:2] + RANGE_MAX * way
            hit = space.segment_query_first(tuple(pose[:2]), tuple(end), 0, pymunk.ShapeFilter())
            expected = RANGE_MAX * hit.alpha if hit else RANGE_MAX
            if abs(expected - distance) > 1e-9:
                aside = np.abs((corners - pose[:2]) @ [-way[1], way[0]]).min()
                tangent = np.abs(np.abs((ROOM.circles[:, :2] - pose[:2]) @ [-way[1], way[0]]) - ROOM.circles[:, 2])
                assert min(aside, tangent.min()) < 1e-6, (pose, bearing, expected, distance)
                doubtful += 1
    assert doubtful <= 0.001 * ranges.size


def moved(scene, angle, dx, dy):
    """The scene turned about the origin, then shifted."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    new = Scene(*(part.copy() for part in vars(scene).values()))
    new.segments = (scene.segments.reshape(-1, 2) @ turn + [dx, dy]).reshape(scene.segments.shape)
    new.circles[..., :2] = scene.circles[..., :2] @ turn + [dx, dy]
    return new


@pytest.mark.parametrize("angle", [0.7, np.pi / 2, 37 * 2 * np.pi / BEAMS])
def test_turning_world_and_robot_together_changes_nothing(angle):
    scene, poses = ROOM.scene(), free_poses(5, seed=2)
    before = [part.copy() for part in cast(poses, scene)]
    c, s = np.cos(angle), np.sin(angle)
    there = poses[:, :2] @ np.array([[c, s], [-s, c]]) + [3.0, -2.0]
    after = cast(np.column_stack([there, poses[:, 2] + angle]), moved(scene, angle, 3.0, -2.0))
    np.testing.assert_allclose(after[0], before[0], atol=1e-9)
    np.testing.assert_array_equal(after[1], before[1])


@pytest.mark.parametrize("shift", [1, 90, 540, 1079])
def test_turning_the_robot_by_whole_beams_shifts_the_scan(shift):
    pose = free_poses(1, seed=3)[0]
    turned = np.add(pose, [0, 0, shift * 2 * np.pi / BEAMS])
    ranges = cast([pose, turned], ROOM.scene())[0]
    np.testing.assert_allclose(ranges[1], np.roll(ranges[0], -shift), atol=1e-9)


@pytest.mark.parametrize("bearing_deg", [-180, -90, 0, 45, 90, 179])
def test_a_post_is_seen_at_its_bearing(bearing_deg):
    bearing, scene = np.radians(bearing_deg), Scene.empty(1)
    scene.add_circles(0, [[4 + 3 * np.cos(0.4 + bearing), 2 + 3 * np.sin(0.4 + bearing), 0.1]], Surface.PERSON)
    ranges, surfaces, incidence = cast([[4, 2, 0.4]], scene)
    k = (round((bearing + np.pi) / (2 * np.pi) * BEAMS)) % BEAMS
    assert ranges[0, k] == pytest.approx(2.9, abs=1e-4)
    assert incidence[0, k] == pytest.approx(1.0, abs=1e-3)
    seen = np.flatnonzero(surfaces[0] == Surface.PERSON)
    assert np.all(np.abs(wrap_angle(BEARINGS[seen] - bearing)) <= np.arcsin(0.1 / 3) + 1e-12)
    assert len(seen) in (11, 12)  # 2 arcsin(0.1 / 3) over a third of a degree


def test_a_wall_across_the_seam_is_seen_on_both_sides_of_it():
    ranges, surfaces, incidence = cast([[0, 0, 0]], one_wall(-2, -1, -2, 1))  # behind, its solid side away from us
    seen = np.abs(BEARINGS) >= np.pi - np.arctan2(1, 2)
    np.testing.assert_array_equal(surfaces[0] == Surface.WALL, seen)
    np.testing.assert_allclose(ranges[0, seen], 2 / -np.cos(BEARINGS[seen]), atol=1e-12)
    np.testing.assert_allclose(incidence[0, seen], -np.cos(BEARINGS[seen]), atol=1e-12)
    assert np.all(ranges[0, ~seen] == RANGE_MAX)
    assert np.all(incidence[0, ~seen] == 0)


def test_a_wall_is_met_from_its_right_side_only():
    assert np.all(cast([[0, 0, 0]], one_wall(-2, 1, -2, -1))[1] == Surface.NOTHING)


@pytest.mark.parametrize("x", [-3.0, 0.0, 2.0, 5.0])
def test_a_wall_seen_edge_on_is_not_met(x):
    assert np.all(cast([[x, 0, 0.3]], one_wall(1, 0, 4, 0))[1] == Surface.NOTHING)


@pytest.mark.parametrize("gap", [1e-12, 1e-9, 1e-6])
def test_a_robot_that_all_but_touches_a_wall_sees_half_the_world(gap):
    ranges, surfaces, _ = cast([[0, gap, np.pi / 2]], one_wall(5, 0, -5, 0))  # the wall runs along y = 0, behind
    behind = np.abs(wrap_angle(BEARINGS + np.pi)) < np.pi / 2 - 1e-3
    assert np.all(surfaces[0, behind] == Surface.WALL)
    np.testing.assert_allclose(ranges[0, behind], gap / -np.cos(BEARINGS[behind]), rtol=1e-9)
    assert np.all(surfaces[0, np.abs(BEARINGS) < np.pi / 2 - 1e-3] == Surface.NOTHING)


def test_no_beam_slips_through_a_corner():
    scene = Scene.empty(1)
    scene.add_room(0, 6.0, 5.0)
    rng = np.random.default_rng(5)
    inside = np.column_stack([rng.uniform([0.2, 0.2], [5.8, 4.8], (300, 2)), rng.uniform(-4, 4, 300)])
    straight_at_corners = np.array([[3.0, 3.0, 0.0], [3.0, 2.0, np.pi / 4], [2.0, 2.0, np.pi / 2], [1.0, 4.0, -np.pi]])
    assert np.all(cast(np.concatenate([inside, straight_at_corners]), scene)[1] == Surface.WALL)


def test_rows_past_the_count_are_not_there():
    scene = ROOM.scene()
    scene.num_segments[:], scene.num_circles[:] = 4, 0
    assert set(np.unique(cast([[5, 4, 0]], scene)[1])) == {Surface.WALL}


def test_the_robot_inside_a_reflection_sees_through_it():
    scene = Scene.empty(1)
    scene.add_circles(0, [[0, 0, 0.3]], Surface.PHANTOM)
    assert np.all(cast([[0.1, 0, 0]], scene)[0] == RANGE_MAX)


# What the sensor makes of it.


def readings(lux, steps=150, confusion=0.02, seed=0):
    """Clean ranges and surfaces of one pose, and `steps` readings of it with their labels."""
    lidar = Lidar(config.Lidar(label_confusion=confusion), 1)
    scene, pose, key = ROOM.scene(), np.array([[5.0, 4.0, 0.4]]), np.array([stream_key(seed, "lidar")])
    clean = [part.copy() for part in lidar.cast(pose, scene)]
    turns = [lidar.scan(pose, scene, np.array([float(lux)]), key, np.array([t])) for t in range(steps)]
    return clean, np.concatenate([scans for scans, _ in turns]), np.concatenate([labels for _, labels in turns])


DARKNESS_AT_5_LUX = 1 - np.log10(5) / np.log10(300)


@pytest.mark.parametrize(("lux", "q"), [(300, 0.0), (5, DARKNESS_AT_5_LUX), (1000, 0.0), (0, 1.0)])
def test_noise_follows_the_light(lux, q):
    (ranges, surfaces, incidence), scans, _ = readings(lux)
    error = scans[..., 0] - ranges[0]
    lost = scans[..., 1] == 0
    ghosts = ~lost & (np.abs(error) > 6 * (0.01 + 0.042 * q))
    good = ~lost & ~ghosts
    assert error[good].std() == pytest.approx(0.01 + 0.042 * q, rel=0.02)
    assert abs(error[good].mean()) < 0.001
    assert lost.mean() == pytest.approx(0.005 + 0.20 * q, rel=0.03)
    assert ghosts.mean() == pytest.approx(0.001 + 0.01 * q, rel=0.3)
    assert scans[ghosts, 1].max() <= 0.07
    assert np.all(error[ghosts] < 0)
    at = np.clip((ranges[0] - 1) / 9, 0, 1)
    expected = REFLECTIVITY[surfaces[0]] * (0.3 + 0.7 * incidence[0]) / (1 + 4 * at**2)
    assert (scans[..., 1] / expected)[good].mean() == pytest.approx(1 - 0.557 * q, rel=0.02)


def test_five_lux_is_what_the_contract_says():
    sigma, dropout, _, scale = scan_noise.noise_levels(5.0)
    assert sigma == pytest.approx(0.04, abs=0.001)
    assert dropout == pytest.approx(0.15, abs=0.005)
    assert scale == pytest.approx(0.6, abs=0.005)


def test_readings_stay_inside_their_limits():
    for lux in (0, 300):
        _, scans, labels = readings(lux, steps=20)
        assert scans.dtype == np.float32
        assert labels.dtype == np.uint8
        assert np.all((scans[..., 0] >= np.float32(0.05)) & (scans[..., 0] <= 10))
        assert np.all((scans[..., 1] >= 0) & (scans[..., 1] <= 1))
        lost = scans[..., 1] == 0
        assert np.all(scans[lost, 0] == 10)
        assert np.all(labels[lost] == Surface.NOTHING)


def test_a_wall_head_on_at_one_metre_returns_its_reflectivity():
    lidar, scene = Lidar(config.Lidar(), 1), one_wall(1, 3, 1, -3)
    strengths = [
        lidar.scan(np.zeros((1, 3)), scene, np.full(1, 300.0), np.array([7], np.uint64), np.array([t]))[0][0, 540, 1]
        for t in range(100)
    ]
    assert np.median(strengths) == pytest.approx(0.70, abs=0.005)


def test_the_front_end_names_hits_by_the_table_but_for_its_mistakes():
    (_, surfaces, _), scans, labels = readings(300, confusion=0.0)
    ghosts = (scans[..., 1] < 0.075) & (labels == LABEL[Surface.PHANTOM])
    named = (scans[..., 1] > 0) & ~ghosts
    np.testing.assert_array_equal(labels[named], np.broadcast_to(LABEL[surfaces[0]], labels.shape)[named])
    _, scans, labels = readings(300, confusion=0.3)
    wrong = (labels != LABEL[surfaces[0]]) & (scans[..., 1] > 0.075)
    assert wrong.sum() / (scans[..., 1] > 0.075).sum() == pytest.approx(0.3, abs=0.01)
    mistaken_walls = labels[wrong & (LABEL[surfaces[0]] == Surface.WALL)]
    shares = np.bincount(mistaken_walls, minlength=5)[2:5] / len(mistaken_walls)
    np.testing.assert_allclose(shares, 1 / 3, atol=0.02)


def test_a_world_reads_the_same_bytes_whatever_stands_beside_it():
    poses, keys = free_poses(5, seed=4), np.array([stream_key(seed, "lidar") for seed in range(5)])
    lux, steps = np.array([300.0, 5.0, 20.0, 1.0, 300.0]), np.arange(5) * 1000
    together = Lidar(config.Lidar(), 5).scan(poses, ROOM.scene(5), lux, keys, steps)
    for i in range(5):
        part = slice(i, i + 1)
        alone = Lidar(config.Lidar(), 1).scan(poses[part], ROOM.scene(), lux[part], keys[part], steps[part])
        assert alone[0].tobytes() == together[0][part].tobytes()
        assert alone[1].tobytes() == together[1][part].tobytes()


def test_noise_changes_with_step_and_seed_and_with_nothing_else():
    lidar, scene, pose, lux = Lidar(config.Lidar(), 1), ROOM.scene(), np.array([[5.0, 4, 0]]), np.array([300.0])

    def bytes_of(seed, step):
        return lidar.scan(pose, scene, lux, np.array([stream_key(seed, "lidar")]), np.array([step]))[0].tobytes()

    assert bytes_of(1, 2) == bytes_of(1, 2)
    assert len({bytes_of(1, 2), bytes_of(1, 3), bytes_of(2, 2)}) == 3


def test_a_scan_is_not_written_again():
    lidar, scene, pose, lux = Lidar(config.Lidar(), 1), ROOM.scene(), np.array([[5.0, 4, 0]]), np.array([300.0])
    first = lidar.scan(pose, scene, lux, np.array([1], np.uint64), np.array([0]))
    kept = first[0].copy(), first[1].copy()
    lidar.scan(pose + 1, scene, lux, np.array([1], np.uint64), np.array([1]))
    np.testing.assert_array_equal(first[0], kept[0])
    np.testing.assert_array_equal(first[1], kept[1])


def test_compiled_noise_is_the_python_text(monkeypatch):
    lidar = Lidar(config.Lidar(beams=90), 2)
    clean = lidar.cast(np.array([[5.0, 4.0, 0.3], [2.0, 4.2, 3.0]]), ROOM.scene(2))
    keys = np.array([stream_key(1, "lidar"), stream_key(2, "lidar")])
    setting = (np.array([300.0, 1.0]), keys, np.array([3, 40]), 0.05, 10.0, REFLECTIVITY, LABEL, 3, 0.2)
    tables = scan_noise.NORMAL, scan_noise.UNIFORM
    fast, slow = [(np.zeros((2, 90, 2), np.float32), np.zeros((2, 90), np.uint8)) for _ in range(2)]
    scan_noise.spoil_scans(*clean, *setting, *tables, *fast)
    in_python(monkeypatch, scan_noise)
    scan_noise.spoil_scans(*clean, *setting, *tables, *slow)
    np.testing.assert_allclose(fast[0], slow[0], rtol=1e-6)
    np.testing.assert_array_equal(fast[1], slow[1])


def test_noise_tables_have_the_shares_they_promise():
    assert scan_noise.NORMAL.mean() == pytest.approx(0, abs=1e-6)
    assert scan_noise.NORMAL.std() == pytest.approx(1, abs=1e-6)
    for share in (0.005, 0.15):
        assert (share > scan_noise.UNIFORM).mean() == pytest.approx(share, abs=1e-4)
