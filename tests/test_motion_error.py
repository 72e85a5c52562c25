"""Endpoint errors of the motion methods: the truth worked out by hand, and what must come out on a few drives."""

import numpy as np
import pytest

from dualnav_lite.episodes import SEEDS
from dualnav_lite.measures import motion_methods
from dualnav_lite.measures.motion_error import CELLS, ERROR_COLUMNS, PAIRED_COLUMNS, PAIRS
from dualnav_lite.measures.motion_methods import METHODS, disc_gaps, owned_velocities, true_velocities
from dualnav_lite.measures.tables import Options, run


def measured(out, episodes=2):
    """Both tables of a few crossings, by name."""
    seeds = {"episodes": episodes, "seed_base": SEEDS["tuning"].start}
    return run("motion", Options(out, scenarios=["crowd_crossing"], **seeds))


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return measured(tmp_path_factory.mktemp("motion"))


def driving(table):
    """Rows of the robot that drives, by method and, in the paired table, what it is held against."""
    key = [name for name in ("method", "against") if name in table]
    return table[table.state == "driving"].set_index(key)


def test_every_method_and_pair_has_a_row_standing_and_driving(tables):
    errors, paired = tables["motion_error"], tables["motion_error_paired"]
    assert list(errors) == ERROR_COLUMNS
    assert list(paired) == PAIRED_COLUMNS
    assert errors.method.tolist() == [*METHODS] * 2
    assert list(zip(paired.method, paired.against, strict=True)) == [*PAIRS] * 2
    assert errors.state.unique().tolist() == ["standing", "driving"]
    assert (driving(errors)[[f"{kind}_cells" for kind in CELLS]] > 1000).all(axis=None)


def test_the_truth_is_right_and_saying_nothing_costs_a_walkers_speed(tables):
    errors = tables["motion_error"].set_index("method")
    for kind in CELLS:
        known = errors.loc["truth"][errors.loc["truth", f"{kind}_cells"] > 0]
        assert known[f"{kind}_epe_mean_m_s"].to_numpy() == pytest.approx(0.0, abs=1e-6)
    nothing = driving(tables["motion_error"]).loc["none"]
    assert nothing.moving_epe_median_m_s == pytest.approx(0.8, abs=0.01)  # how fast a group crosses
    assert nothing.static_epe_mean_m_s == 0


@pytest.mark.parametrize("method", ["farneback", "forecast"])
def test_compensation_is_worth_something_to_a_robot_that_drives(tables, method):
    errors = driving(tables["motion_error"])
    gain = driving(tables["motion_error_paired"]).loc[(method, f"{method}_raw")]
    for kind in CELLS:
        means = errors[f"{kind}_epe_mean_m_s"]
        assert means[method] < 0.6 * means[f"{method}_raw"]
        assert gain[f"{kind}_gain_m_s"] == pytest.approx(means[f"{method}_raw"] - means[method])
        assert 0 < gain[f"{kind}_gain_low_m_s"] <= gain[f"{kind}_gain_m_s"] <= gain[f"{kind}_gain_high_m_s"]


def test_a_compensation_that_does_nothing_is_worth_nothing(tmp_path, monkeypatch):
    flow = motion_methods.estimate_flow
    monkeypatch.setattr(motion_methods, "estimate_flow", lambda scans, poses, _: flow(scans, poses, False))
    gain = driving(measured(tmp_path, 1)["motion_error_paired"]).loc[("farneback", "farneback_raw")]
    assert gain.moving_gain_m_s == gain.static_gain_m_s == 0


def test_a_cell_has_the_velocity_of_the_nearest_body_that_holds_it():
    cells = np.array([[1.0, 0.0], [1.55, 0.0], [1.2, 0.0], [3.0, 3.0]])
    gaps = disc_gaps(cells, np.array([[1.0, 0.0], [1.9, 0.0], [3.0, 3.0]]), np.full(3, 0.3), [True, True, False])
    velocities, is_held = owned_velocities(gaps, np.array([[0.5, 0.0], [0.0, -1.0], [9.0, 9.0]]))
    np.testing.assert_array_equal(velocities, [[0.5, 0], [0, -1], [0.5, 0], [0, 0]])
    assert is_held.tolist() == [True, True, True, False]


def test_the_truth_of_a_cell_is_turned_into_the_robots_frame():
    # The robot is at (2, 1) and looks along +y; a person 1 m ahead walks along +x, to the robot's right. A box of
    # 1.0 x 0.2 m, turned along y, 1 m to the left, slides along +y, ahead. A second person 1 m behind stands.
    truth = {
        "pose": np.array([[2.0, 1.0, np.pi / 2]]),
        "circles": np.array([[[2.0, 2.0, 0.3], [2.0, 0.0, 0.3], [0.0, 0.0, 0.0]]]),
        "circle_velocities": np.array([[[0.8, 0.0], [0.0, 0.0], [0.0, 0.0]]]),
        "boxes": np.array([[[1.0, 1.0, np.pi / 2, 0.5, 0.1]]]),
        "box_velocities": np.array([[[0.0, 1.5]]]),
    }
    cells = np.array([[1.0, 0.0], [0.55, 1.0], [0.1, 1.0], [0.0, 1.3], [-1.0, 0.0], [-1.0, -2.0]])
    velocities, is_moving = true_velocities(truth, 0, cells)
    np.testing.assert_allclose(velocities, [[0, -0.8], [1.5, 0], [1.5, 0], [0, 0], [0, 0], [0, 0]], atol=1e-12)
    assert is_moving.tolist() == [True, True, True, False, False, False]
