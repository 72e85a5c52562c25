"""PPO, DQN and SAC see the same numbers, drive the same worlds, and are counted alike."""

import numpy as np
import pytest

from dualnav_lite.beyond.algorithms import (
    ACTIONS,
    COLUMNS,
    SECTORS,
    SectorDriver,
    SectorWorlds,
    algorithms_table,
    features,
    row_of,
)
from dualnav_lite.encoder import BANDS, read_bands
from dualnav_lite.survival import rows_of


def test_sectors_hold_the_nearest_reading_of_their_beams_and_bands_come_behind():
    scans = np.full((2, 1080, 2), [3.0, 0.5])
    scans[0, 540] = [1.0, 0.5]  # straight ahead: the first beam of the sector in the middle
    scans[1, 0] = [0.1, 0.0]  # lost
    images = np.random.default_rng(0).random((2, 3, 64, 64)).astype(np.float32)
    seen = features(images, scans)
    assert seen.shape == (2, SECTORS + len(BANDS))
    assert seen[0, SECTORS // 2] == pytest.approx(np.exp(-1.0))
    assert seen[0, 0] == seen[1, 0] == pytest.approx(np.exp(-3.0))
    np.testing.assert_array_equal(seen[:, SECTORS:], read_bands(images))


def test_discrete_and_continuous_worlds_are_the_same_worlds():
    continuous, discrete = SectorWorlds(2), SectorWorlds(2, discrete=True)
    first, again = continuous.reset(seed=5)[0], discrete.reset(seed=5)[0]
    np.testing.assert_array_equal(first, again)
    for choice in (7, 8, 4, 0):
        one = continuous.step(np.tile(ACTIONS[choice], (2, 1)))
        other = discrete.step(np.array([choice, choice]))
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
    assert np.isfinite(one[0]).all()


def test_ends_are_counted_and_their_last_observation_is_made_of_numbers_too():
    worlds = SectorWorlds(4)
    observations, _ = worlds.reset(seed=3)
    for _ in range(400):
        observations, _, terminated, truncated, infos = worlds.step(np.tile([0.8, 0.0], (4, 1)))
        if (terminated | truncated).any():
            break
    i = int(np.flatnonzero(terminated | truncated)[0])
    assert infos["final_obs"][i].shape == observations[i].shape
    assert not np.array_equal(infos["final_obs"][i], observations[i])
    assert worlds.endings[0][1] == infos["summary"]["outcome"][i]


def test_jitter_and_collisions_are_counted_from_rows():
    base = {"scenario": "navigation", "arm": "dqn", "training_seed": 0, "preference": 0.5, "collided_with": ""}
    base |= {"events": 0, "first_event_s": None, "steps": 100, "time_s": 10.0, "path_m": 5.0, "min_clearance_m": 0.3}
    base |= {"mean_clearance_m": 1.0, "energy_j": 50.0, "battery_end": 0.5, "goals": 1, "contacts": 0, "reason": ""}
    base |= {f"r_{name}": 0.0 for name in ("safe", "dynamic", "energy", "goal", "terminal")}
    ends = (("goal", 0.2, 4), ("hit_wall", 0.4, 8), ("goal", 0.3, 6))
    rows = rows_of(
        base | {"seed": k, "outcome": outcome, "accel_rms": accel, "omega_sign_changes": turns}
        for k, (outcome, accel, turns) in enumerate(ends)
    )
    row = row_of("dqn", 0, 300, [(90, "hit_wall"), (100, "hit_box"), (200, "hit_wall"), (250, "goal")], rows)
    assert set(row) == set(COLUMNS)
    assert (row["learning_collisions"], row["learning_collisions_early"], row["learning_goals"]) == (3, 2, 1)
    assert (row["survived"], row["collisions"], row["timeouts"]) == (2, 1, 0)
    assert row["accel_rms"] == pytest.approx(0.3)
    assert row["turns_a_second"] == pytest.approx(0.6)


def test_a_short_run_of_every_learner_makes_a_row_each():
    pytest.importorskip("stable_baselines3")
    table = algorithms_table((0,), 2_100, 2)
    assert table.algorithm.tolist() == ["ppo", "dqn", "sac"]
    assert (table.episodes == 2).all()
    assert (table.learning_episodes > 0).all()


def test_a_driver_of_numbers_reads_the_scan_of_each_robot():
    seen = []
    driver = SectorDriver(lambda rows: seen.append(rows) or np.zeros((len(rows), 2)), 0)
    scan = np.full((1080, 2), [2.0, 1.0])
    driver.act(np.zeros((2, 3, 64, 64), np.float32), [{"scan": scan}, {"scan": 2.0 * scan}])
    assert seen[0][0, 0] == pytest.approx(np.exp(-2.0))
    assert seen[0][1, 0] == pytest.approx(np.exp(-4.0))
