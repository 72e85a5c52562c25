"""Claims about how forecasts are judged, against numbers worked out by hand."""

import numpy as np
import pytest

from dualnav_lite.forecast_errors import COLUMNS, errors_of, futures, match, summary, table_of
from dualnav_lite.motion import STEPS
from dualnav_lite.recording import Recording


def walk(frames=30, speed=0.5):
    """Nobody drives; one mover walks along y past (2, -1), another is never there."""
    movers = np.full((frames, 2, 2), np.nan)
    movers[:, 0, 0], movers[:, 0, 1] = 2.0, -1.0 + 0.1 * speed * np.arange(frames)
    still = np.zeros((frames, 3))
    return Recording("x", "y", 1, np.zeros((frames, 36, 2), np.float32), still, still, movers, np.zeros((64, 64)), {})


class Says:
    """A predictor that says a velocity for one mover, wherever it looks in `walk`."""

    def __init__(self, velocity, offset=(0.0, 0.0)):
        self.velocity, self.offset = np.array(velocity), np.array(offset)

    def __call__(self, scans, poses):
        n = len(scans)
        start = np.array([2.0, -1.0]) + 0.1 * 0.5 * np.stack([np.zeros(n), np.arange(2, 2 + n)], axis=1) + self.offset
        seconds = 0.1 * np.arange(1, STEPS + 1)[:, None]
        positions = np.zeros((n, 3, STEPS, 2))
        positions[:, 1] = start[:, None] + seconds * self.velocity
        return positions, np.zeros((n, 3, 2)), np.tile([False, True, False], (n, 1))


def test_errors_equal_those_worked_out_by_hand():
    models = {"right": Says([0.0, 0.5]), "slow": Says([0.0, 0.21]), "beside": Says([0.0, 0.5], (0.4, 0.0))}
    errors = errors_of(models, walk(), every=1)
    assert {name: one.shape for name, one in errors.items()} == dict.fromkeys(models, (8, STEPS))
    np.testing.assert_allclose(errors["right"], 0.0, atol=1e-12)
    np.testing.assert_allclose(errors["slow"], np.tile(0.029 * np.arange(1, STEPS + 1), (8, 1)), atol=1e-12)
    slow, beside = summary("f", "slow", errors["slow"]), summary("f", "beside", errors["beside"])
    assert slow["ade_m"] == pytest.approx(0.029 * 10.5)
    assert [slow[name] for name in COLUMNS[3:6]] == pytest.approx([0.145, 0.29, 0.58])
    assert (slow["hit_1s"], slow["hit_2s"], slow["n"]) == (1.0, 0.0, 8)
    assert (beside["hit_1s"], beside["hit_2s"]) == (0.0, 1.0)


def test_a_mover_that_one_model_lacks_counts_for_none():
    class Blind(Says):
        def __call__(self, scans, poses):
            positions, velocities, valid = super().__call__(scans, poses)
            valid[::2] = False
            return positions, velocities, valid

    errors = errors_of({"a": Says([0.0, 0.5]), "b": Blind([0.0, 0.5])}, walk(), every=1)
    assert len(errors["a"]) == len(errors["b"]) == 4


def test_forecasts_and_movers_belong_together_where_each_is_the_others_nearest():
    truth = np.array([[[0.0, 0.0], [0.3, 0.0], [np.nan, np.nan], [5.0, 0.0]]])
    positions = np.array([[[0.25, 0.0], [5.0, 0.6], [0.0, 0.0]]])
    np.testing.assert_array_equal(match(positions, np.ones((1, 3), bool), truth), [[2, 0, -1, -1]])
    np.testing.assert_array_equal(match(positions, np.array([[True, True, False]]), truth), [[-1, 0, -1, -1]])


def test_futures_stand_in_the_true_frame_of_their_moment():
    recording = walk()
    recording.true_poses[:] = [1.0, -1.0, np.pi / 2]
    future = futures(recording, np.array([4]))
    assert future.shape == (1, 2, STEPS, 2)
    np.testing.assert_allclose(future[0, 0, 0], [0.05 * 5, -1.0], atol=1e-12)
    assert np.isnan(future[0, 1]).all()


def test_a_drive_that_is_too_short_adds_nothing_and_the_table_has_the_promised_columns():
    errors = errors_of({"a": Says([0.0, 0.5])}, walk(frames=10))
    assert errors["a"].shape == (0, STEPS)
    table = table_of({"f": errors})
    assert list(table.columns) == COLUMNS
    assert table.n[0] == 0
    assert np.isnan(table.ade_m[0])
