"""Intervals and tests against published tables, scipy's own implementations and plain simulation."""

import numpy as np
import pytest
from scipy import stats

from dualnav_lite.metrics import exact_interval, mcnemar_exact, paired_difference, repeat_range, wilson_interval

# successes, trials, Wilson, Clopper-Pearson: Newcombe, Stat Med 17 (1998) 857, table I.
NEWCOMBE_SINGLE = [
    (81, 263, (0.2553, 0.3662), (0.2527, 0.3676)),
    (15, 148, (0.0624, 0.1605), (0.0578, 0.1617)),
    (0, 20, (0.0, 0.1611), (0.0, 0.1684)),
    (1, 29, (0.0061, 0.1718), (0.0009, 0.1776)),
]


@pytest.mark.parametrize(("successes", "trials", "wilson", "exact"), NEWCOMBE_SINGLE)
def test_intervals_equal_the_published_table(successes, trials, wilson, exact):
    np.testing.assert_allclose(wilson_interval(successes, trials), wilson, atol=5e-5)
    np.testing.assert_allclose(exact_interval(successes, trials), exact, atol=5e-5)


@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.99])
def test_intervals_equal_scipys_for_every_count(confidence):
    for trials in (1, 2, 7, 50):
        for successes in range(trials + 1):
            test = stats.binomtest(successes, trials)
            for ours, method in ((wilson_interval, "wilson"), (exact_interval, "exact")):
                np.testing.assert_allclose(
                    ours(successes, trials, confidence), test.proportion_ci(confidence, method), atol=1e-12
                )


def test_ninety_two_of_a_hundred_means_85_to_96():
    low, high = wilson_interval(92, 100)
    assert (round(low, 2), round(high, 2)) == (0.85, 0.96)


def test_arrays_give_the_same_as_scalars():
    successes, trials = np.array([0, 3, 10]), 10
    for interval in (wilson_interval, exact_interval):
        low, high = interval(successes, trials)
        assert [(a, b) for a, b in zip(low, high, strict=True)] == [interval(k, trials) for k in successes]


def test_no_trial_tells_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert exact_interval(0, 0) == (0.0, 1.0)
    assert paired_difference(0, 0, 0, 0)[1:] == (-1.0, 1.0)
    assert mcnemar_exact(0, 0) == 1.0


def test_exact_interval_covers_at_least_as_often_as_it_says():
    trials = 30
    low, high = exact_interval(np.arange(trials + 1), trials)
    for rate in np.linspace(0.02, 0.98, 25):
        weight = stats.binom.pmf(np.arange(trials + 1), trials, rate)
        assert weight[(low <= rate) & (rate <= high)].sum() >= 0.95


@pytest.mark.parametrize(("successes", "trials", "more"), [(0, 50, 20), (47, 50, 50), (50, 50, 50), (25, 50, 80)])
def test_the_range_of_a_repetition_equals_scipys_beta_binomial(successes, trials, more):
    ends = stats.betabinom.ppf([0.025, 0.975], more, successes + 0.5, trials - successes + 0.5)
    assert repeat_range(successes, trials, more) == tuple(ends)


def test_a_repetition_falls_into_its_range_about_as_often_as_it_says():
    rng = np.random.default_rng(5)
    for rate in (0.5, 0.8, 0.95):
        first, second = rng.binomial(50, rate, (2, 2000))
        ranges = {k: repeat_range(k, 50, 50) for k in set(first.tolist())}
        inside = [ranges[k][0] <= again <= ranges[k][1] for k, again in zip(first.tolist(), second, strict=True)]
        assert np.mean(inside) > 0.93


# both, only a, only b, neither, difference, low, high: Newcombe, Stat Med 17 (1998) 2635, method 10.
NEWCOMBE_PAIRED = [(36, 12, 2, 0, 0.20, 0.0569, 0.3404)]


@pytest.mark.parametrize(("both", "only_a", "only_b", "neither", "difference", "low", "high"), NEWCOMBE_PAIRED)
def test_paired_difference_equals_the_published_table(both, only_a, only_b, neither, difference, low, high):
    np.testing.assert_allclose(paired_difference(both, only_a, only_b, neither), (difference, low, high), atol=5e-5)


def test_swapping_the_arms_mirrors_the_difference():
    difference, low, high = paired_difference(60, 25, 9, 6)
    np.testing.assert_allclose(paired_difference(60, 9, 25, 6), (-difference, -high, -low))


def test_paired_interval_covers_about_as_often_as_it_says():
    rng = np.random.default_rng(0)
    cells = np.array([0.70, 0.18, 0.05, 0.07])
    truth = cells[1] - cells[2]
    counts = rng.multinomial(100, cells, size=1500)
    inside = [low <= truth <= high for _, low, high in (paired_difference(*row) for row in counts)]
    assert 0.93 <= np.mean(inside) <= 0.975


def test_agreement_between_arms_narrows_the_interval():
    _, low, high = paired_difference(80, 10, 0, 10)
    _, low_apart, high_apart = paired_difference(72, 18, 8, 2)
    assert high - low < high_apart - low_apart


@pytest.mark.parametrize(("only_a", "only_b"), [(12, 2), (0, 6), (5, 5), (40, 60), (1, 0)])
def test_mcnemar_equals_scipys_binomial_test(only_a, only_b):
    assert mcnemar_exact(only_a, only_b) == pytest.approx(stats.binomtest(only_a, only_a + only_b).pvalue, rel=1e-12)


@pytest.mark.parametrize("call", [lambda: wilson_interval(3, 2), lambda: exact_interval(-1, 2)])
def test_impossible_counts_are_refused(call):
    with pytest.raises(ValueError, match="successes"):
        call()


def test_negative_pairs_and_odd_confidence_are_refused():
    with pytest.raises(ValueError, match="negative"):
        paired_difference(1, -1, 0, 0)
    with pytest.raises(ValueError, match="negative"):
        mcnemar_exact(-1, 0)
    with pytest.raises(ValueError, match="confidence"):
        wilson_interval(1, 2, 95)
