"""Claims about the observation: where things stand in the image, what the bands say, one path for all."""

import dataclasses

import numpy as np
import pytest

from dualnav_lite.config import Config, Motion, Observation, with_overrides
from dualnav_lite.encoder import (
    BAND_EDGES,
    BANDS,
    EGO,
    INTENSITY,
    MOTION,
    STATIC,
    Ego,
    encode_state,
    encode_states,
    num_channels,
    project_intensity,
    read_bands,
)
from dualnav_lite.geometry import beam_directions
from dualnav_lite.interface import observation_box
from dualnav_lite.kernels import encode, raster
from dualnav_lite.motion import STEPS, Prediction

BEAMS = 360
METHODS = ("farneback", "forecast", "scan", "none", "truth")


def worlds(n, seed=0):
    """Drawn arguments of `encode_states` for n worlds: a wavy room that changes between the scans."""
    rng = np.random.default_rng(seed)
    angles = np.arange(BEAMS) * 2 * np.pi / BEAMS
    ranges = 2.5 + rng.uniform(0, 1, (n, 3, 1)) * np.sin(3 * angles + rng.uniform(0, 6, (n, 1, 1)))
    scans = np.stack([ranges, rng.uniform(0, 1, ranges.shape)], axis=-1).astype(np.float32)
    poses = rng.uniform(-0.1, 0.1, (n, 3, 3))
    crops = rng.choice([0.0, 1 / 6, 1 / 3, 2 / 3, 1.0], (n, 64, 64)).astype(np.float32)
    forecast = Prediction(
        positions=rng.uniform(-4, 4, (n, 8, STEPS, 2)),
        velocities=rng.normal(size=(n, 8, 2)),
        valid=rng.random((n, 8)) < 0.5,
        radii=rng.uniform(0.1, 0.6, (n, 8)),
    )
    ego = Ego(
        twist=rng.uniform(-1, 1, (n, 2)),
        battery=rng.uniform(0, 1, n),
        goal_robot=rng.uniform(-8, 8, (n, 2)),
        guide_robot=rng.uniform(-3, 3, (n, 2)),
        map_age_s=rng.uniform(0, 3, n),
        preference=rng.uniform(0, 1, n),
        forecast=forecast,
    )
    return scans, poses, crops, ego


def world(i, scans, poses, crops, ego):
    """Arguments of `encode_state` for world i."""

    def pick(record):
        return {f.name: getattr(record, f.name)[i] for f in dataclasses.fields(record) if f.name != "forecast"}

    return scans[i], poses[i], crops[i], Ego(**pick(ego), forecast=Prediction(**pick(ego.forecast)))


def empty_scan():
    """(BEAMS, 2) scan in which no beam comes back."""
    return np.stack([np.full(BEAMS, 10.0), np.zeros(BEAMS)], axis=-1).astype(np.float32)


def encoded_bands(**changes):
    """Bands of one world by name, all else quiet."""
    quiet = {
        "twist": np.zeros(2),
        "battery": 1.0,
        "goal_robot": np.array([2.0, 0.0]),
        "guide_robot": np.array([2.0, 0.0]),
        "map_age_s": 0.0,
        "preference": 0.5,
    }
    scans, observation = np.stack([empty_scan()] * 3), Observation(motion=Motion(method="none"))
    image = encode_state(scans, np.zeros((3, 3)), np.zeros((64, 64)), Ego(**{**quiet, **changes}), observation)
    return dict(zip(BANDS, read_bands(image).tolist(), strict=True))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("intensity", [True, False])
def test_observation_has_the_promised_shape_type_and_ranges(method, intensity):
    observation = Observation(intensity=intensity, motion=Motion(method=method))
    images = encode_states(*worlds(3), observation)
    assert images.shape == (3, num_channels(observation), 64, 64) == (3, 4 if intensity else 3, 64, 64)
    assert images.dtype == np.float32
    assert np.isfinite(images).all()
    assert np.abs(images).max() <= 1
    assert images[:, STATIC].min() >= 0
    assert (not intensity) or images[:, INTENSITY].min() >= 0


@pytest.mark.parametrize("method", METHODS)
def test_one_world_and_many_worlds_give_the_same_bytes(method):
    arguments, observation = worlds(5), Observation(motion=Motion(method=method, component="radial"))
    together = encode_states(*arguments, observation)
    for i in range(5):
        assert encode_state(*world(i, *arguments), observation).tobytes() == together[i].tobytes()


def test_bands_read_back_exactly_and_fill_their_rows():
    images = encode_states(*worlds(4), Observation())
    bands = read_bands(images)
    assert bands.shape == (4, len(BANDS))
    edges = [0, 6, 13, 19, 26, 32, 38, 45, 51, 58, 64]
    assert edges == BAND_EDGES.tolist()
    for k in range(len(BANDS)):
        rows = images[:, EGO, edges[k] : edges[k + 1]]
        np.testing.assert_array_equal(rows, np.broadcast_to(bands[:, k, None, None], rows.shape))


def test_bands_by_hand():
    bands = encoded_bands(
        twist=np.array([0.4, -0.6]),
        battery=0.25,
        goal_robot=np.array([3.0, 4.0]),
        guide_robot=np.array([0.0, -2.0]),
        map_age_s=0.5,
        preference=0.75,
    )
    expected = [0.5, -0.5, 0.25, 5 / 7, 0.8, 0.6, -1.0, 0.0, 0.25, 0.75]
    np.testing.assert_allclose(list(bands.values()), expected, atol=1e-7)


def test_bands_saturate_and_never_leave_their_range():
    bands = encoded_bands(twist=np.array([-2.0, 9.0]), map_age_s=60.0, goal_robot=np.array([1e6, 0.0]))
    assert (bands["v"], bands["omega"], bands["map_age"]) == (-1, 1, 1)
    assert bands["goal_distance"] == pytest.approx(1, abs=1e-5)


def test_goal_at_the_robot_reads_distance_zero_and_straight_ahead():
    bands = encoded_bands(goal_robot=np.zeros(2))
    assert (bands["goal_distance"], bands["goal_sin"], bands["goal_cos"]) == (0, 0, 1)


def test_only_its_own_band_changes_with_each_number():
    quiet = encoded_bands()
    for change, names in [
        ({"battery": 0.2}, {"battery"}),
        ({"preference": 0.9}, {"preference"}),
        ({"twist": np.array([0.0, 0.3])}, {"omega"}),
        ({"goal_robot": np.array([5.0, 0.0])}, {"goal_distance"}),
        ({"guide_robot": np.array([2.0, 1.0])}, {"guide_sin", "guide_cos"}),
    ]:
        changed = encoded_bands(**change)
        assert {name for name in BANDS if changed[name] != quiet[name]} == names


@pytest.mark.parametrize(
    ("x", "y", "row", "column"),
    [(1.04, 0.04, 21, 31), (-1.04, -0.04, 42, 32), (0.04, 2.04, 31, 11), (0.04, -2.04, 31, 52), (3.14, 3.14, 0, 0)],
)
def test_a_return_stands_in_the_cell_that_its_place_says(x, y, row, column):
    scan = np.zeros((1, 2), np.float32)  # a scanner with one beam, turned onto the point
    scan[0] = np.hypot(x, y), 0.7
    image, direction = np.empty((1, 64, 64), np.float32), np.array([x, y]) / np.hypot(x, y)
    encode.project_intensities(scan[None], direction[:1], direction[1:], image)
    assert image[0, row, column] == np.float32(0.7)
    assert np.count_nonzero(image) == 1


def test_intensity_keeps_the_strongest_return_of_a_cell_and_ignores_lost_beams():
    scan = empty_scan()
    ahead = BEAMS // 2  # beam k points at -pi + 2 pi k / beams
    scan[ahead], scan[ahead + 1] = (1.04, 0.3), (1.04, 0.5)
    scan[0] = 1.0, 0.0
    image = project_intensity(scan)
    assert image.max() == np.float32(0.5)
    assert image[42].max() == 0  # the lost beam straight behind
    assert image[21, 31:33].max() == np.float32(0.5)


def test_projection_agrees_with_a_search_for_the_nearest_cell_centre():
    scan = worlds(1, seed=3)[0][0, 0]
    points = scan[:, :1].astype(float) * np.stack(beam_directions(BEAMS), axis=1)
    scan[(np.abs(points) < 1e-6).any(axis=1), 1] = 0  # beams along an axis end on the line between two cells
    centres = (31.5 - np.arange(64)) * 0.1
    expected = np.zeros((64, 64), np.float32)
    for point, intensity in zip(points, scan[:, 1], strict=True):
        if np.abs(point).max() < 3.2:
            row, column = np.abs(centres - point[0]).argmin(), np.abs(centres - point[1]).argmin()
            expected[row, column] = max(expected[row, column], intensity)
    np.testing.assert_array_equal(project_intensity(scan), expected)


def test_motion_without_a_forecast_is_refused_by_name():
    scans, poses, crops, ego = worlds(2)
    ego.forecast = None
    with pytest.raises(ValueError, match="forecast"):
        encode_states(scans, poses, crops, ego, Observation(motion=Motion(method="forecast")))


@pytest.mark.parametrize("which", range(3))
def test_wrong_shapes_are_refused(which):
    arguments = list(worlds(2))
    arguments[which] = arguments[which][:, :2]
    with pytest.raises(ValueError, match="got"):
        encode_states(*arguments)


def test_two_calls_share_no_memory():
    arguments = worlds(2)
    first, second = encode_states(*arguments), encode_states(*arguments)
    assert not np.shares_memory(first, second)
    assert not np.shares_memory(first, arguments[2])


def test_static_and_motion_channels_pass_through():
    scans, poses, crops, ego = worlds(2)
    images = encode_states(scans, poses, crops, ego, Observation(motion=Motion(method="truth")))
    np.testing.assert_array_equal(images[:, STATIC], crops)
    painted = np.empty((2, 64, 64), np.float32)
    raster.paint_forecasts(ego.forecast.positions, ego.forecast.radii, ego.forecast.valid, painted)
    np.testing.assert_array_equal(images[:, MOTION], painted)


def test_kernels_equal_their_python_source():
    scans, _, _, ego = worlds(2, seed=7)
    compiled, plain = np.full((2, 2, 64, 64), 9, np.float32)
    for function, out in ((encode.project_intensities, compiled), (encode.project_intensities.py_func, plain)):
        function(scans[:, -1], *beam_directions(BEAMS), out)
    np.testing.assert_array_equal(compiled, plain)
    scales = np.array([0.8, 1.2, 2.0, 2.0])
    for function, out in ((encode.paint_bands, compiled), (encode.paint_bands.py_func, plain)):
        function(
            ego.twist,
            ego.battery,
            ego.goal_robot,
            ego.guide_robot,
            ego.map_age_s,
            ego.preference,
            scales,
            BAND_EDGES,
            out,
        )
    np.testing.assert_array_equal(compiled, plain)


def test_a_flat_observation_stays_in_its_space_whatever_the_lidar_s_reach():
    config = with_overrides(Config(), {"observation.layout": "flat", "lidar.range_max_m": 20.0})
    scans, poses, crops, ego = worlds(2)
    scans[:, :, :3, 0] = [5.0, 10.0, 20.0]
    images = encode_states(scans, poses, crops, ego, config.observation)
    assert all(observation_box(config).contains(image) for image in images)
    np.testing.assert_array_equal(images[:, STATIC].reshape(2, -1)[:, :3], [[0.5, 1.0, 1.0]] * 2)
