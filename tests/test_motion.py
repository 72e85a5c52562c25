"""Claims about the motion channel: what flow is worth against the truth, and what the forecast paints."""

import cv2
import numpy as np
import pytest

from dualnav_lite.config import Motion
from dualnav_lite.geometry import beam_directions, to_robot
from dualnav_lite.kernels import raster
from dualnav_lite.measures.motion_methods import disc_gaps, owned_velocities
from dualnav_lite.motion import (
    FOOTPRINT_M,
    STEPS,
    Prediction,
    estimate_flow,
    flow_component,
    flow_of_frames,
    motion_fields,
    rasterise,
)
from tests.rooms import furnished_room
from tests.stage import Stage, arc

MIDDLES = (31.5 - np.arange(64)) * 0.1
AHEAD, LEFT = np.meshgrid(MIDDLES, MIDDLES, indexing="ij")  # where each cell's centre is, robot frame [m]


def endpoint_errors(poses, compensate, seed=0):
    """Mean length of (flow - truth) [m/s] on the cells of two walkers and on those of static things.

    A robot takes `poses`; the walkers cross 1.5 m ahead of it to the left and come towards it at 0.8 m/s.
    """
    stage = Stage(boxes=furnished_room(boxes=10, seed=seed).boxes, seed=seed)
    scans, moving, still = [], [], []
    for step, pose in enumerate(poses):
        seconds = 0.1 * (step - len(poses) // 2)
        people = np.array(
            [[poses[0, 0] + 1.9, 4.0 + 0.8 * seconds, 0.27], [poses[0, 0] + 2.6 - 0.8 * seconds, 4.4, 0.27]]
        )
        velocities = np.array([[0.0, 0.8], [-0.8, 0.0]])
        scans.append(stage.scan(pose, people=people)[0])
        if step < 2:
            continue
        three = np.array(scans[-3:])
        flow = estimate_flow(three, poses[step - 2 : step + 1], compensate)
        hit = rasterise(three[None], poses[None, step - 2 : step + 1])[0, -1] > 0
        gaps = disc_gaps(np.column_stack([AHEAD[hit], LEFT[hit]]), to_robot(people[:, :2], pose), people[:, 2], True)
        truth, is_mover = owned_velocities(gaps, to_robot(velocities, np.array([0, 0, pose[2]])))
        error = np.linalg.norm(flow[hit] - truth, axis=-1)
        moving += error[is_mover].tolist()
        still += error[~is_mover].tolist()
    return np.mean(moving), np.mean(still)


STANDING = arc([3.0, 4.0, 0.0], 0.0, 0.0, 16)
DRIVING = arc([2.6, 4.0, 0.0], 0.5, 0.0, 16)
TURNING = arc([3.0, 4.0, -0.6], 0.2, 0.8, 16)


@pytest.mark.parametrize("poses", [STANDING, DRIVING, TURNING], ids=["standing", "driving", "turning"])
def test_compensated_flow_beats_saying_nothing_moves(poses):
    moving, still = endpoint_errors(poses, compensate=True)
    print(f"endpoint error: movers {moving:.2f} m/s of 0.80, static {still:.2f} m/s")
    assert moving < 0.5  # saying zero would cost 0.8
    assert still < 0.15


@pytest.mark.parametrize("poses", [DRIVING, TURNING], ids=["driving", "turning"])
def test_without_ego_compensation_static_things_move_and_movers_are_wrong(poses):
    moving, still = endpoint_errors(poses, compensate=True)
    moving_raw, still_raw = endpoint_errors(poses, compensate=False)
    print(
        f"without compensation: movers {moving_raw:.2f} m/s against {moving:.2f}, "
        f"static {still_raw:.2f} m/s against {still:.2f}"
    )
    assert moving_raw > 1.3 * moving
    assert still_raw > 3 * still


def test_compensation_changes_nothing_for_a_robot_that_stands():
    scans = Stage().scan(STANDING[0])[0]
    three = np.array([scans, scans, scans])
    np.testing.assert_array_equal(
        estimate_flow(three, STANDING[:3]), estimate_flow(three, STANDING[:3], compensate=False)
    )


def block(row, column):
    """Raster with one 4 x 4 block, a person seen from all sides."""
    frame = np.zeros((64, 64), np.uint8)
    frame[row : row + 4, column : column + 4] = 255
    return frame


def test_flow_has_the_robots_axes_and_metres_per_second():
    left = flow_of_frames(np.array([block(20, 30), block(20, 29), block(20, 28)]))[21:24, 28:31].mean((0, 1))
    ahead = flow_of_frames(np.array([block(20, 30), block(19, 30), block(18, 30)]))[18:21, 31:34].mean((0, 1))
    np.testing.assert_allclose(left, [0, 1.0], atol=0.3)  # 2 cells in 0.2 s are 1 m/s
    np.testing.assert_allclose(ahead, [1.0, 0], atol=0.3)


def test_still_pictures_cost_no_flow(monkeypatch):
    monkeypatch.setattr(cv2, "calcOpticalFlowFarneback", lambda *_: pytest.fail("nothing moves"))
    assert not flow_of_frames(np.array([block(20, 30)] * 3)).any()


def test_noise_of_a_cells_width_is_no_motion():
    image = np.empty((64, 64), np.float32)
    raster.scan_difference(block(20, 30), block(21, 31), image)
    assert not image.any()


def test_scan_difference_marks_what_came_and_what_went():
    image = np.empty((64, 64), np.float32)
    raster.scan_difference(block(20, 30), block(20, 36), image)
    assert (image[20:24, 36:40] == 1).all()
    assert (image[20:24, 30:34] == -1).all()
    assert np.abs(image).sum() == 32


def test_components_of_a_flow():
    flow = np.zeros((64, 64, 2), np.float32)
    flow[...] = [-0.75, 0.3]  # all things come from ahead and drift to the left
    assert flow_component(flow, "x")[5, 32] == pytest.approx(-0.2)
    assert flow_component(flow, "speed")[5, 32] == pytest.approx(np.hypot(0.75, 0.3) / 1.5)
    ahead, behind = flow_component(flow, "radial")[[2, 61], [31, 31]]
    assert ahead == pytest.approx(0.5, abs=0.02)  # closing
    assert behind == pytest.approx(-0.5, abs=0.02)
    assert flow_component(5 * flow, "speed").max() == 1


def test_crossing_is_invisible_to_radial_flow_and_coming_to_the_articles_x():
    crossing, coming = np.zeros((2, 64, 64, 2), np.float32)
    crossing[..., 1], coming[..., 0] = 0.8, -0.8
    ahead = (10, 31)
    assert abs(flow_component(crossing, "radial")[ahead]) < 0.02 < flow_component(coming, "radial")[ahead]
    assert flow_component(coming, "x")[ahead] == 0
    assert abs(flow_component(crossing, "x")[ahead]) > 0.5


def rasterise_reference(scans, poses, compensate):
    """`rasterise` with one point at a time and general frame changes."""
    frames = np.zeros((len(scans), 64, 64), np.uint8)
    for f, scan in enumerate(scans):
        points = scan[:, :1].astype(float) * np.stack(beam_directions(len(scan)), axis=1)
        if compensate:
            c, s = np.cos(poses[f, 2]), np.sin(poses[f, 2])
            world = points @ np.array([[c, s], [-s, c]]) + poses[f, :2]
            points = to_robot(world, poses[-1])
        for (x, y), intensity in zip(points, scan[:, 1], strict=True):
            row, column = np.abs(MIDDLES - x).argmin(), np.abs(MIDDLES - y).argmin()
            if intensity > 0 and max(abs(x), abs(y)) < 3.2:
                frames[f, row, column] = 255
    return frames


@pytest.mark.parametrize("compensate", [True, False])
def test_rasters_equal_the_reference(compensate):
    poses = arc([3.0, 4.0, 0.5], 0.8, 1.2, 3)
    stage = Stage(boxes=furnished_room().boxes)
    scans = np.concatenate([stage.scan(pose) for pose in poses])
    scans[:, ::9, 1] = 0.0
    np.testing.assert_array_equal(
        rasterise(scans[None], poses[None], compensate)[0], rasterise_reference(scans, poses, compensate)
    )


def prediction(start, velocity, radius=0.25):
    """One mover of one world, going straight on."""
    seconds = 0.1 * np.arange(1, STEPS + 1)
    positions = np.asarray(start, float) + seconds[:, None] * np.asarray(velocity, float)
    return Prediction(
        positions[None, None], np.array([[velocity]], float), np.ones((1, 1), bool), np.full((1, 1), radius)
    )


def forecast_reference(forecast):
    """What a forecast paints, cell by cell."""
    image = np.zeros((64, 64))
    for k in np.flatnonzero(forecast.valid[0]):
        for step in range(STEPS):
            inside = np.hypot(AHEAD - forecast.positions[0, k, step, 0], LEFT - forecast.positions[0, k, step, 1])
            image = np.where(inside <= forecast.radii[0, k], np.maximum(image, 1 - step / STEPS), image)
    return image


def paint(forecast, method="forecast"):
    scans, poses = np.zeros((1, 3, 36, 2), np.float32), np.zeros((1, 3, 3))
    return motion_fields(scans, poses, forecast, Motion(method=method))[0]


@pytest.mark.parametrize("method", ["forecast", "truth"])
def test_forecast_equals_the_reference(method):
    rng = np.random.default_rng(4)
    forecast = Prediction(
        rng.uniform(-3.6, 3.6, (1, 6, STEPS, 2)),
        np.zeros((1, 6, 2)),
        rng.random((1, 6)) < 0.7,
        rng.uniform(0.1, 0.6, (1, 6)),
    )
    np.testing.assert_allclose(paint(forecast, method), forecast_reference(forecast), atol=1e-6)


def test_forecast_fades_along_the_way_of_a_walker():
    image = paint(prediction([2.0, -1.0], [0.0, 0.8]))
    row = 11  # 2.05 m ahead
    along = [image[row, 31 - round(10 * y)] for y in (-0.85, -0.3, 0.2, 0.6)]
    assert along == sorted(along, reverse=True)
    assert along[0] > 0.9 > along[-1] > 0
    assert image[row, 31 - 12] == 0  # 1.2 m to the left lies past the horizon
    assert image[40:].max() == 0


def test_nobody_paints_nothing_and_unknown_sizes_are_a_persons():
    nobody = prediction([1.0, 0.0], [0.5, 0.0])
    nobody.valid[:] = False
    assert not paint(nobody).any()
    somebody = prediction([1.0, 0.0], [0.5, 0.0])
    unsized = Prediction(somebody.positions, somebody.velocities, somebody.valid)
    np.testing.assert_array_equal(unsized.radii, [[FOOTPRINT_M]])


def test_none_is_black_and_scan_sees_a_walker():
    stage, poses = Stage(), STANDING[:3]
    scans = np.concatenate([stage.scan(p, people=[[4.5, 4.0 + 0.16 * k, 0.27]]) for k, p in enumerate(poses)])[None]
    assert not motion_fields(scans, poses[None], None, Motion(method="none")).any()
    seen = motion_fields(scans, poses[None], None, Motion(method="scan"))[0]
    assert seen.max() == 1
    assert np.abs(LEFT[seen != 0]).max() < 0.9


def test_kernels_equal_their_python_source():
    poses = arc([3.0, 4.0, 0.5], 0.8, 1.2, 3)
    scans = np.concatenate([Stage().scan(pose) for pose in poses])[None, :, ::8]
    directions = beam_directions(scans.shape[2])
    results = []
    for pick in (lambda f: f, lambda f: f.py_func):
        frames = np.empty((1, 3, 64, 64), np.uint8)
        pick(raster.rasterise_scans)(scans, poses[None], True, *directions, frames)
        difference, image = np.empty((64, 64), np.float32), np.empty((1, 64, 64), np.float32)
        pick(raster.scan_difference)(frames[0, 0], frames[0, 2], difference)
        forecast = prediction([1.0, 0.5], [0.4, -0.3])
        pick(raster.paint_forecasts)(forecast.positions, forecast.radii, forecast.valid, image)
        results.append((frames, difference, image))
    for compiled, plain in zip(*results, strict=True):
        np.testing.assert_array_equal(compiled, plain)
