"""Survival and paired tables against rows counted by hand."""

import io

import numpy as np
import pandas as pd
import pytest

from dualnav_lite.episodes import COLUMNS, rows_to_csv
from dualnav_lite.survival import PAIRED_COLUMNS, SURVIVAL_COLUMNS, paired, read_episodes, survival, survived


def rows_of(*episodes):
    """Rows as read back from a file, from (scenario, arm, seed, outcome, further columns)."""
    full = []
    for scenario, arm, seed, outcome, *more in episodes:
        row = dict.fromkeys(COLUMNS) | {"scenario": scenario, "arm": arm, "seed": seed, "outcome": outcome, "steps": 10}
        full.append(row | (more[0] if more else {}))
    return read_episodes(io.BytesIO(rows_to_csv(full)))


TEN = rows_of(
    *[("pop_up", "ppo", seed, "goal", {"energy_j": 100.0, "path_m": 5.0, "min_clearance_m": 0.4}) for seed in range(6)],
    ("pop_up", "ppo", 6, "hit_box", {"energy_j": 40.0, "path_m": 2.0, "min_clearance_m": 0.0}),
    ("pop_up", "ppo", 7, "timeout", {"energy_j": 300.0, "path_m": 9.0, "min_clearance_m": 0.2}),
    ("pop_up", "ppo", 8, "flat_battery", {"energy_j": 60.0, "path_m": 4.0, "min_clearance_m": 0.2}),
    ("pop_up", "ppo", 9, "error", {"reason": "ValueError: x"}),
)


def test_survival_counts_every_episode_once_and_failures_by_kind():
    row = survival(TEN, policy_sha256={"ppo": "abc"}, config_sha256="def").iloc[0]
    assert (row.episodes, row.survived, row.survival_rate) == (10, 6, 0.6)
    assert (row.collisions, row.timeouts, row.flat_batteries) == (1, 1, 1)
    # 6 of 10: Wilson and Clopper-Pearson from published tables.
    np.testing.assert_allclose([row.wilson_low, row.wilson_high], [0.3127, 0.8318], atol=5e-5)
    np.testing.assert_allclose([row.exact_low, row.exact_high], [0.2624, 0.8784], atol=5e-5)
    assert row.article_claim == 0.92
    assert row.energy_j_per_m == pytest.approx(1000 / 45)
    assert row.mean_energy_j == pytest.approx(1000 / 9)
    assert row.mean_min_clearance_m == pytest.approx(2.8 / 9)
    assert (row.seed_first, row.seed_last) == (0, 9)
    assert (row.source, row.policy_sha256, row.config_sha256) == ("measured", "abc", "def")


def test_survival_has_the_columns_of_the_contract():
    assert list(survival(TEN)) == SURVIVAL_COLUMNS
    assert len(SURVIVAL_COLUMNS) == 23


def test_training_seeds_stand_apart_and_planners_have_none():
    rows = rows_of(
        ("navigation", "ppo", 1, "goal", {"training_seed": 0}),
        ("navigation", "ppo", 1, "timeout", {"training_seed": 1}),
        ("navigation", "dwa", 1, "goal"),
    )
    table = survival(rows)
    assert list(table.arm) == ["dwa", "ppo", "ppo"]
    assert table.training_seed.isna().tolist() == [True, False, False]
    assert table.survived.tolist() == [1, 1, 0]
    assert table.article_claim.isna().all()


def test_a_contact_loses_a_long_run_only_in_the_strict_column():
    rows = rows_of(
        ("battery", "ppo", 0, "survived", {"contacts": 3}),
        ("battery", "ppo", 1, "survived", {"contacts": 0}),
        ("battery", "ppo", 2, "too_many_contacts", {"contacts": 13}),
        ("battery", "ppo", 3, "few_goals", {"contacts": 0}),
        ("battery", "ppo", 4, "low_charge", {"contacts": 0}),
    )
    assert survived(rows).tolist() == [True, True, False, False, False]
    assert survived(rows, strict=True).tolist() == [False, True, False, False, False]
    loose, strict = survival(rows).iloc[0], survival(rows, strict=True).iloc[0]
    assert (loose.survived, loose.collisions, loose.timeouts, loose.flat_batteries) == (2, 1, 1, 1)
    assert (strict.survived, strict.collisions, strict.timeouts, strict.flat_batteries) == (1, 2, 1, 1)


def test_paired_counts_only_seeds_that_both_ran():
    a = [("pop_up", "a", seed, "goal" if seed < 48 else "timeout") for seed in range(50)]
    b = [("pop_up", "b", seed, "goal" if seed < 36 or seed >= 48 else "hit_wall") for seed in range(50)]
    rows = rows_of(*a, *b, ("pop_up", "a", 99, "goal"), ("navigation", "b", 1, "goal"))
    table = paired(rows, "a", "b")
    assert list(table) == PAIRED_COLUMNS
    assert len(table) == 1
    row = table.iloc[0]
    assert (row.both, row.only_a, row.only_b, row.neither) == (36, 12, 2, 0)
    # Newcombe (1998), the same four counts; exact binomial 2 (1 + 14 + 91) / 2^14.
    np.testing.assert_allclose([row.difference, row.low, row.high], [0.2, 0.0569, 0.3404], atol=5e-5)
    assert row.mcnemar_p == pytest.approx(2 * (1 + 14 + 91) / 2**14)


def test_an_episode_that_would_count_twice_is_refused():
    twice = pd.concat([TEN, TEN])
    with pytest.raises(ValueError, match="repeat"):
        survival(twice)
    rows = rows_of(
        ("pop_up", "a", 1, "goal"), ("pop_up", "a", 1, "goal", {"training_seed": 1}), ("pop_up", "b", 1, "goal")
    )
    with pytest.raises(ValueError, match="repeat"):
        paired(rows, "a", "b")


def test_a_missing_arm_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'orca'.*known: ppo"):
        paired(TEN, "ppo", "orca")


def test_reading_back_keeps_types_and_empty_text():
    assert TEN.reason.tolist() == [""] * 9 + ["ValueError: x"]
    assert str(TEN.training_seed.dtype) == "Int64"
    assert TEN.first_event_s.isna().all()
