"""Differences behind claims: by hand, and left out where one seed says nothing."""

import pandas as pd
import pytest

from dualnav_lite.beyond.differences import fleet_differences, learner_differences


def learned(ppo, dqn, sac):
    """A table with each learner's acceleration by training seed."""
    rows = [
        {
            "algorithm": name,
            "training_seed": k,
            "accel_rms": value,
            "survival_rate": 0.5,
            "learning_collisions_early": 9,
        }
        for name, values in (("ppo", ppo), ("dqn", dqn), ("sac", sac))
        for k, value in enumerate(values)
    ]
    return pd.DataFrame(rows)


def test_differences_over_seeds_are_paired_and_have_a_t_interval():
    table = learner_differences(learned([0.2, 0.3, 0.4], [0.5, 0.5, 0.8], [0.1, 0.1])).set_index("question")
    row = table.loc["dqn_jitters"]
    assert row.difference == pytest.approx((0.3 + 0.2 + 0.4) / 3)
    # deviation 0.1, three seeds: 4.303 x 0.1 / sqrt(3)
    assert row.high - row.difference == pytest.approx(0.2484, abs=1e-3)
    assert row.n == 3
    assert table.loc["ppo_survives_sac"].n == 2
    assert table.loc["sac_hits_early"].difference == 0.0


def test_one_seed_says_nothing():
    assert learner_differences(learned([0.2], [0.5], [0.1])).empty


def test_the_fleet_counts_robots_of_all_sizes_and_its_interval_holds_the_difference():
    rows = [(2, 0.0, 10, 12), (3, 0.0, 10, 18), (2, 0.3, 10, 16), (3, 0.3, 10, 27), (2, 1.0, 10, 1)]
    table = pd.DataFrame(rows, columns=["robots", "cross_weight", "runs", "robots_arrived"])
    (row,) = fleet_differences(table).itertuples()
    assert row.difference == pytest.approx(43 / 50 - 30 / 50)
    assert 0.0 < row.low < row.difference < row.high < 0.5
    assert row.n == 50
    assert fleet_differences(table[table.cross_weight > 0.5]).empty
