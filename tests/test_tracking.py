"""Claims about the tracker: how well it measures walkers, and how rarely it takes furniture for one."""

import itertools

import numpy as np
import pytest

from dualnav_lite.geometry import beam_directions, to_robot, to_world, wrap_angle
from dualnav_lite.kernels import clusters as cluster_kernel
from dualnav_lite.kernels import free_space
from dualnav_lite.kernels import tracking as kernel
from dualnav_lite.motion import STEPS
from dualnav_lite.tracking import ConstantVelocityPredictor, Tracker, constant_velocity
from tests.rooms import furnished_room
from tests.stage import BRIGHT, DARK, Stage, arc


def velocity_errors(stage, start, velocity, poses, radius=0.27):
    """Errors of the tracked velocity of one walker after its first second [m/s]; nan where it was not tracked."""
    tracker, errors = Tracker(1), []
    for step, pose in enumerate(poses):
        place = np.array(start) + 0.1 * step * np.array(velocity)
        tracks = tracker.update(pose[None], stage.scan(pose, people=[[*place, radius]]))
        if step < 10:
            continue
        gaps = np.hypot(*(tracks.positions[0] - to_robot(place, pose)).T)
        gaps[~tracks.valid[0]] = np.inf
        truth = to_robot(np.array(velocity), np.array([0, 0, pose[2]]))
        error = np.hypot(*(tracks.velocities[0, gaps.argmin()] - truth))
        errors.append(error if gaps.min() < 0.4 else np.nan)
    return np.array(errors)


@pytest.mark.parametrize("distance", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("direction", ["crossing", "coming", "leaving"])
def test_walker_velocity_is_right_within_15_cm_s_after_a_second(distance, direction):
    robot = [3.0, 4.0, 0.0]
    start, velocity = {
        "crossing": ([3 + distance, 3.0], [0.0, 0.8]),
        "coming": ([3 + distance + 1.6, 4.3], [-0.8, 0.0]),
        "leaving": ([3 + distance, 4.3], [0.8, 0.0]),
    }[direction]
    errors = velocity_errors(Stage(), start, velocity, arc(robot, 0, 0, 26))
    assert np.isfinite(errors).all()
    assert np.sqrt((errors**2).mean()) < 0.05  # the goal is 0.15


def test_walker_velocity_is_right_while_the_robot_drives_and_turns():
    poses = arc([2.0, 3.0, 0.3], 0.8, -0.4, 30)
    errors = velocity_errors(Stage(), [5.5, 2.0], [-0.2, 0.75], poses)
    assert np.isfinite(errors).all()
    assert np.sqrt((errors**2).mean()) < 0.08


def test_walker_velocity_survives_low_light():
    errors = np.concatenate(
        [
            velocity_errors(Stage(lux=DARK, seed=seed), [5.0, 2.5], [0.0, 0.8], arc([3, 4, 0], 0, 0, 36))
            for seed in range(4)
        ]
    )
    assert np.isfinite(errors).mean() > 0.95
    assert np.sqrt(np.nanmean(errors**2)) < 0.15


@pytest.mark.parametrize(("lux", "most"), [(BRIGHT, 0.01), (DARK, 0.02)])
def test_furniture_hardly_ever_moves_while_the_robot_drives_and_turns_past_it(lux, most):
    frames = false = 0
    for seed in range(8):
        stage = Stage(boxes=furnished_room(seed=seed).boxes, lux=lux, seed=seed)
        tracker = Tracker(1)
        poses = np.concatenate([arc([1.0, 4.0, 0.0], 0.8, 0.0, 60), arc([5.8, 4.0, 0.0], 0.3, 1.2, 40)])
        poses[:60, 2] += 0.4 * np.sin(0.2 * np.arange(60))  # weaves
        for pose in poses:
            frames += 1
            false += tracker.update(pose[None], stage.scan(pose)).valid.any()
    assert false <= most * frames


def test_standing_people_are_no_movers_and_become_some_when_they_walk_off():
    stage, tracker, pose = Stage(), Tracker(1), np.array([3.0, 4.0, 0.0])
    seen = []
    for step in range(40):
        y = 3.0 + 0.08 * max(0, step - 25)
        seen.append(bool(tracker.update(pose[None], stage.scan(pose, people=[[5.5, y, 0.27]])).valid.any()))
    assert not any(seen[:26])
    assert all(seen[33:])


def test_who_has_walked_is_kept_in_mind_standing_and_has_no_speed():
    stage, tracker, pose = Stage(), Tracker(1), np.array([3.0, 4.0, 0.0])
    speeds = []
    for step in range(80):
        y = 2.5 + 0.08 * min(step, 25)  # walks for 2.5 s, then stands
        tracks = tracker.update(pose[None], stage.scan(pose, people=[[5.5, y, 0.27]]))
        speeds.append(np.hypot(*tracks.velocities[0, 0]) if tracks.valid[0, 0] else np.nan)
    assert np.nanmin(speeds[10:25]) > 0.6
    assert np.isfinite(speeds[10:]).all()  # never lost
    assert not np.any(speeds[36:])  # a second later it is known to stand


def visible_share(people, pose):
    """(k,) share of each person's width that the robot sees past the others, by 21 lines of sight each."""
    shares = np.zeros(len(people))
    for k, (x, y, radius) in enumerate(people):
        away = np.array([x, y]) - pose[:2]
        bearing, half = np.arctan2(away[1], away[0]), np.arcsin(radius / np.hypot(*away))
        for angle in bearing + 0.95 * half * np.linspace(-1, 1, 21):
            along, aside = np.cos(angle), np.sin(angle)
            depth = (people[:, :2] - pose[:2]) @ [along, aside]
            miss = (people[:, :2] - pose[:2]) @ [-aside, along]
            hit = (np.abs(miss) < people[:, 2]) & (depth > 0)
            shares[k] += (
                np.where(hit, depth - np.sqrt(np.maximum(people[:, 2] ** 2 - miss**2, 0)), np.inf).argmin() == k
            )
    return shares / 21


@pytest.mark.parametrize("gap", [0.2, 0.35, 0.5])
@pytest.mark.parametrize("formation", ["file", "rank", "staggered"])
def test_velocities_in_a_crossing_group_of_five_point_the_right_way(formation, gap):
    spacing = gap + 0.54
    along = {"file": [0, 1, 2, 3, 4], "rank": [0, 0, 0, 0, 0], "staggered": [0, 0.5, 1, 1.5, 2]}[formation]
    across = {"file": [0, 0, 0, 0, 0], "rank": [0, 1, 2, 3, 4], "staggered": [0, 1, 0, 1, 0]}[formation]
    stage, tracker = Stage(size=(12.0, 12.0)), Tracker(1)
    errors, seen = [], []
    for step, pose in enumerate(arc([2.0, 6.0, 0.0], 0.3, 0.0, 40)):
        y = 4.0 + 0.08 * step - spacing * np.array(along)
        people = np.column_stack([4.0 + spacing * np.array(across), y, np.full(5, 0.27)])
        tracks = tracker.update(pose[None], stage.scan(pose, people=people))
        if step < 10:
            continue
        heading = np.arctan2(tracks.velocities[0, :, 1], tracks.velocities[0, :, 0])[tracks.valid[0]]
        errors += np.abs(wrap_angle(heading - np.pi / 2)).tolist()
        gaps = np.hypot(*np.moveaxis(to_robot(people[:, None, :2], pose) - tracks.positions[0], -1, 0))
        found = np.where(tracks.valid[0], gaps, np.inf).min(axis=1) < 0.25
        seen += found[visible_share(people, pose) > 0.4].tolist()
    assert np.mean(np.array(errors) < np.radians(15)) > 0.95
    assert np.mean(seen) > 0.85


@pytest.mark.parametrize("side", [-1, 1])
def test_box_that_slides_in_is_seen_within_three_scans(side):
    stage, tracker, poses = Stage(), Tracker(1), arc([1.0, 4.0, 0.0], 0.8, 0.0, 40)
    appears, first = 20, None
    for step, pose in enumerate(poses):
        boxes = []
        if step >= appears:
            y = 4.0 + side * max(0.0, 0.85 - 0.15 * (step - appears))
            boxes = [[poses[appears, 0] + 2.0, y, 0.0, 0.2, 0.2]]
        tracks = tracker.update(pose[None], stage.scan(pose, boxes=boxes))
        if tracks.valid.any() and first is None:
            first = step
            assert tracks.velocities[0, 0, 1] * side < -0.8  # it slides towards the robot's line
    assert first is not None
    assert appears <= first < appears + 3


def test_ghosts_alone_never_make_a_mover():
    for seed in range(3):
        stage, tracker, pose = Stage(lux=DARK, seed=seed), Tracker(1), np.array([[5.0, 4.0, 0.5]])
        assert not any(tracker.update(pose, stage.scan(pose[0])).valid.any() for _ in range(80))


def test_reflections_that_come_and_go_rarely_make_a_mover():
    rng = np.random.default_rng(5)
    stage, tracker = Stage(lux=DARK), Tracker(1)
    phantoms, ends, movers, poses = np.zeros((6, 3)), np.zeros(6), 0, arc([2.0, 4.0, 0.0], 0.4, 0.1, 120)
    for step, pose in enumerate(poses):
        for k in np.flatnonzero(ends <= step):
            bearing, distance = rng.uniform(-0.9, 0.9), rng.uniform(0.7, 2.5)
            place = to_world(distance * np.array([np.cos(bearing), np.sin(bearing)]), pose)
            phantoms[k] = [*place, rng.uniform(0.1, 0.25)]
            ends[k] = step + rng.uniform(5, 25)
        movers += tracker.update(pose[None], stage.scan(pose, phantoms=phantoms)).valid.any()
    assert movers <= 0.05 * len(poses)


def scene_of_walkers(steps=25):
    """Scans (steps, 1, beams, 2) and poses (steps, 1, 3): two walkers among furniture, the robot driving."""
    stage, poses = Stage(boxes=furnished_room().boxes), arc([1.5, 4.0, 0.1], 0.6, 0.3, steps)
    scans = [
        stage.scan(pose, people=[[4.0, 2.8 + 0.08 * k, 0.27], [6.0 - 0.06 * k, 4.6, 0.25]])
        for k, pose in enumerate(poses)
    ]
    return np.array(scans), poses[:, None]


def fields(tracks):
    return tracks.positions, tracks.velocities, tracks.radii, tracks.ages, tracks.valid


def test_tracks_depend_on_their_own_world_alone():
    scans, poses = scene_of_walkers()
    other, elsewhere = scans[::-1], poses[::-1]
    together, alone = Tracker(3), Tracker(1)
    for k in range(len(scans)):
        batch = together.update(
            np.concatenate([elsewhere[k], poses[k], elsewhere[k]]), np.concatenate([other[k], scans[k], other[k]])
        )
        single = alone.update(poses[k], scans[k])
    assert single.valid.any()
    for one, many in zip(fields(single), fields(batch), strict=True):
        assert one[0].tobytes() == many[1].tobytes()


def test_turning_the_odometry_frame_changes_nothing_the_robot_sees():
    scans, poses = scene_of_walkers()
    turned = np.concatenate([to_world(poses[..., :2], np.array([3.0, -7.0, 2.0])), poses[..., 2:] + 2.0], axis=-1)
    here, there = Tracker(1), Tracker(1)
    for k in range(len(scans)):
        one, other = here.update(poses[k], scans[k]), there.update(turned[k], scans[k])
    assert one.valid.sum() == other.valid.sum() > 0
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-6)
    np.testing.assert_allclose(one.velocities, other.velocities, atol=1e-6)


def test_reset_and_inactive_worlds():
    scans, poses = scene_of_walkers()
    tracker, twin = Tracker(2), Tracker(1)
    for k in range(len(scans)):
        tracker.update(np.repeat(poses[k], 2, 0), np.repeat(scans[k], 2, 0), active=np.array([True, k < 3]))
    tracker.reset([0])
    for k in range(len(scans)):
        both = tracker.update(np.repeat(poses[k], 2, 0), np.repeat(scans[k], 2, 0), active=np.array([True, False]))
        fresh = twin.update(poses[k], scans[k])
    for one, many in zip(fields(fresh), fields(both), strict=True):
        assert one[0].tobytes() == many[0].tobytes()
    assert not both.valid[1].any()


def test_returned_arrays_are_fresh():
    scans, poses = scene_of_walkers(3)
    tracker = Tracker(1)
    first, second = tracker.update(poses[0], scans[0]), tracker.update(poses[1], scans[1])
    assert not any(np.shares_memory(a, b) for a, b in zip(fields(first), fields(second), strict=True))


def test_constant_velocity_goes_straight_on():
    scans, poses = scene_of_walkers()
    tracker = Tracker(1)
    for k in range(len(scans)):
        tracks = tracker.update(poses[k], scans[k])
    prediction = constant_velocity(tracks)
    assert prediction.positions.shape == (1, 8, STEPS, 2)
    for step, seconds in ((4, 0.5), (9, 1.0), (19, 2.0)):
        np.testing.assert_allclose(prediction.positions[:, :, step], tracks.positions + seconds * tracks.velocities)


def test_constant_velocity_predictor_finds_the_walkers_in_ten_scans():
    scans, poses = scene_of_walkers(10)
    positions, velocities, valid = ConstantVelocityPredictor()(scans.swapaxes(0, 1), poses.swapaxes(0, 1))
    assert positions.shape == (1, 8, STEPS, 2)
    assert velocities.shape == (1, 8, 2)
    assert valid.sum() == 2
    truth = to_robot(np.array([[4.0, 3.52 + 0.8], [5.46 - 0.6, 4.6]]), poses[-1, 0])  # one second on
    for person in truth:
        assert np.hypot(*(positions[0, valid[0], 9] - person).T).min() < 0.12


# --- the kernels -------------------------------------------------------------------------------------------------


def scan_of_circles(circles, beams=1080, far=6.0):
    """Noise-free scan of circles (c, 3) in front of a far round wall, by the quadratic formula beam by beam."""
    directions = np.stack(beam_directions(beams), axis=1)
    ranges = np.full(beams, far)
    for x, y, radius in circles:
        along = directions @ [x, y]
        root = along**2 - (x * x + y * y - radius * radius)
        hit = (root >= 0) & (along > 0)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(root[hit]))
    return np.stack([ranges, np.full(beams, 0.5)], axis=1).astype(np.float32)


def segment_reference(scan, noise):
    """What `segment_scan` finds, by points and lists."""
    beams = len(scan)
    points = scan[:, :1] * np.stack(beam_directions(beams), axis=1)
    kept = [k for k in range(beams) if scan[k, 1] > 0]
    threshold = cluster_kernel.JUMP[0] + cluster_kernel.JUMP[1] * noise
    jumps = [i for i, k in enumerate(kept) if np.hypot(*(points[k] - points[kept[i - 1]])) > threshold]
    runs = [kept[a:b] for a, b in itertools.pairwise(jumps)]
    runs.append(kept[jumps[-1] :] + [k + beams for k in kept[: jumps[0]]])
    found = []
    for run in runs:
        first, last = run[0] % beams, run[-1] % beams
        small = np.hypot(*(points[first] - points[last])) < cluster_kernel.MAX_EXTENT_M
        if len(run) >= cluster_kernel.MIN_RETURNS and small and scan[first, 0] < cluster_kernel.MAX_RANGE_M:
            before, after = kept[kept.index(first) - 1], kept[(kept.index(last) + 1) % len(kept)]
            found.append((run[0], run[-1], scan[before, 0] < scan[first, 0], scan[after, 0] < scan[last, 0]))
    return found


CROWD = [(2.0, 0.3, 0.27), (2.9, 0.6, 0.25), (-1.5, 0.02, 0.3), (0.4, -1.8, 0.2), (-2.5, -1.5, 0.28)]


def segments(scan, noise=0.01, function=cluster_kernel.segment_scan):
    found = np.zeros((64, 4), np.int64)
    return [tuple(row) for row in found[: function(scan, noise, found)]]


def test_segments_equal_the_reference_also_straight_behind_and_with_lost_beams():
    rng = np.random.default_rng(2)
    for lost in (0.0, 0.15):
        scan = scan_of_circles(CROWD)
        scan[rng.random(len(scan)) < lost, 1] = 0.0
        assert segments(scan) == segment_reference(scan, 0.01)
        assert len(segments(scan)) == len(CROWD)


def test_scan_without_jumps_has_no_segments():
    assert segments(scan_of_circles([])) == []
    assert segments(np.zeros((1080, 2), np.float32)) == []


@pytest.mark.parametrize("distance", [0.6, 1.0, 2.5, 5.0])
@pytest.mark.parametrize("bearing", [0.0, 1.3, 3.1])
def test_round_things_are_placed_within_two_centimetres(distance, bearing):
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    scan = scan_of_circles([(x, y, 0.27)])
    (cluster,) = segments(scan)
    np.testing.assert_allclose(cluster_kernel.locate(scan, np.array(cluster), 0.27), [x, y], atol=0.02)
    assert cluster_kernel.round_size(scan, cluster[0], cluster[1]) == pytest.approx(0.27, abs=0.02)


@pytest.mark.parametrize("side", [-1, 1])
def test_half_hidden_things_are_placed_within_four_centimetres(side):
    hidden, screen = (2.5, 0.0, 0.27), (1.2, side * 0.25, 0.2)
    scan = scan_of_circles([hidden, screen])
    far = max(segments(scan), key=lambda cluster: scan[cluster[0], 0])
    np.testing.assert_allclose(cluster_kernel.locate(scan, np.array(far), 0.27), hidden[:2], atol=0.04)


@pytest.mark.parametrize("sigma", [0.01, 0.02, 0.04])
def test_range_noise_is_measured_from_the_scan_itself(sigma):
    scan = scan_of_circles(CROWD)
    scan[:, 0] += np.random.default_rng(0).normal(0, sigma, len(scan))
    assert cluster_kernel.range_noise(scan) == pytest.approx(sigma, rel=0.15)


def test_a_place_is_seen_free_before_a_wall_and_not_behind_it_or_through_lost_beams():
    ranges = np.full(1080, 3.0, np.float32)
    pose = np.array([1.0, 2.0, 0.5])
    for distance, answer in ((2.5, 1), (2.9, 0), (3.5, 0)):
        place = to_world(distance * np.array([np.cos(2.0), np.sin(2.0)]), pose)
        assert free_space.sees_free(ranges, pose, *place) == answer
    assert free_space.sees_free(np.zeros(1080, np.float32), pose, 2.0, 2.0) == -1


def test_match_takes_the_closest_pairs_first():
    tracks = np.zeros((4, kernel.COLUMNS))
    tracks[:3, kernel.AGE] = 1
    tracks[:3, kernel.X] = [0.0, 0.15, 3.0]
    centres = np.array([[0.05, 0.0], [-0.12, 0.0], [9.0, 9.0]])
    owner, match = np.empty(3, np.int64), np.empty(4, np.int64)
    kernel.match_nearest(tracks, centres, owner, match)
    assert match.tolist() == [0, -1, -1, -1]  # the second track would need the cluster that the first one takes
    assert owner.tolist() == [0, -1, -1]


def test_kernels_equal_their_python_source():
    scan = scan_of_circles(CROWD)
    scan[::7, 1] = 0.0
    assert segments(scan) == segments(scan, function=cluster_kernel.segment_scan.py_func)
    cluster = np.array(segments(scan)[0])
    for name, args in (
        ("locate", (scan, cluster, 0.27)),
        ("round_size", (scan, *cluster[:2])),
        ("range_noise", (scan,)),
    ):
        function = getattr(cluster_kernel, name)
        np.testing.assert_allclose(function(*args), function.py_func(*args), atol=1e-9)
    pose, past = np.array([0.1, 0.0, 0.05]), np.zeros(3)
    args = (scan, cluster, pose, np.full(1080, 2.2, np.float32), past)
    assert free_space.was_free(*args) == free_space.was_free.py_func(*args)
    scans, poses = scene_of_walkers(8)
    states = []
    for step_world in (kernel._step_world, kernel._step_world.py_func):
        state = (
            np.zeros((40, kernel.COLUMNS)),
            np.zeros((40, 10, 3)),
            np.zeros((10, 1080), np.float32),
            np.zeros((10, 3)),
        )
        for k in range(len(scans)):
            step_world(scans[k, 0], poses[k, 0], 0.1, *state, k)
        states.append(state[0])
    np.testing.assert_allclose(*states, atol=1e-9)
    outs = []
    for function in (kernel.nearest_movers, kernel.nearest_movers.py_func):
        out = (
            np.zeros((1, 3, 2)),
            np.zeros((1, 3, 2)),
            np.zeros((1, 3)),
            np.zeros((1, 3), np.int64),
            np.zeros((1, 3), bool),
            np.zeros((1, 3), np.int64),
        )
        function(states[0][None], poses[-1], *out)
        outs.append(out)
    assert outs[0][4].any()
    for one, other in zip(*outs, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
