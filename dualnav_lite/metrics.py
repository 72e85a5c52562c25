"""How sure a rate is: intervals for one arm, difference and exact test for two arms on the same seeds."""

import numpy as np
from scipy.special import bdtr, betaincinv, betaln, ndtri, stdtrit


def _counts(successes, trials):
    """Successes and trials as float arrays of one shape; `ValueError` where they are no counts."""
    successes, trials = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    if np.any(successes < 0) or np.any(successes > trials):
        raise ValueError(f"need 0 <= successes <= trials, got {successes} of {trials}")
    return successes, trials


def _half_tail(confidence):
    """Probability left out on each side."""
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie between 0 and 1, got {confidence}")
    return (1 - confidence) / 2


def wilson_interval(successes, trials, confidence=0.95):
    """Wilson's score interval of a rate: the one for plots, close to its nominal coverage on average.

    Args:
        successes, trials: counts, scalars or arrays that broadcast.
        confidence: nominal coverage.

    Returns:
        (low, high), shares in [0, 1]; (0, 1) where there was no trial.

    Raises:
        ValueError: counts out of order, confidence outside (0, 1).

    Source: Wilson, JASA 22 (1927) 209; Newcombe, Stat Med 17 (1998) 857, method 3.

    >>> [round(float(end), 4) for end in wilson_interval(81, 263)]
    [0.2553, 0.3662]
    """
    k, n = _counts(successes, trials)
    z2 = ndtri(_half_tail(confidence)) ** 2
    safe_n = np.maximum(n, 1)
    centre = (k + z2 / 2) / (safe_n + z2)
    half = np.sqrt(z2 * (k * (n - k) / safe_n + z2 / 4)) / (safe_n + z2)
    low = np.where(k == 0, 0.0, centre - half)
    high = np.where(k == n, 1.0, centre + half)
    return low[()], high[()]


def exact_interval(successes, trials, confidence=0.95):
    """Clopper-Pearson interval of a rate: the one for pass or fail, coverage never below nominal.

    Arguments, returns and errors as in `wilson_interval`.

    Source: Clopper and Pearson, Biometrika 26 (1934) 404, by quantiles of the beta distribution.

    >>> [round(float(end), 4) for end in exact_interval(0, 20)]
    [0.0, 0.1684]
    """
    k, n = _counts(successes, trials)
    tail = _half_tail(confidence)
    low = np.where(k == 0, 0.0, betaincinv(np.maximum(k, 1), n - k + 1, tail))
    high = np.where(k == n, 1.0, betaincinv(k + 1, np.maximum(n - k, 1), 1 - tail))
    return low[()], high[()]


def repeat_range(successes: int, trials: int, more: int, confidence=0.95) -> tuple[int, int]:
    """Successes to expect of `more` new trials: wider than the interval of the rate, since chance enters twice.

    Args:
        successes, trials: what was seen.
        more: trials to come.
        confidence: nominal coverage.

    Returns:
        (least, most) counts.

    Raises:
        ValueError: as `wilson_interval`.

    Source: the beta-binomial that follows from Jeffreys' prior Beta(1/2, 1/2) for the rate.

    >>> repeat_range(47, 50, 50)
    (41, 50)
    """
    _counts(successes, trials)
    a, b, counts = successes + 0.5, trials - successes + 0.5, np.arange(more + 1)
    chances = np.exp(betaln(counts + a, more - counts + b) - betaln(a, b) - betaln(counts + 1, more - counts + 1))
    below = np.cumsum(chances) / (more + 1)
    tail = _half_tail(confidence)
    return int(np.searchsorted(below, tail)), min(more, int(np.searchsorted(below, 1 - tail)))


def paired_difference(both, only_a, only_b, neither, confidence=0.95):
    """Rate of a minus rate of b on the same seeds, with Newcombe's score interval for paired rates.

    Args:
        both, only_a, only_b, neither: seeds on which both, just one or no arm succeeded.
        confidence: nominal coverage.

    Returns:
        (difference, low, high), shares in [-1, 1]; (nan, -1, 1) where there was no seed.

    Source: Newcombe, Stat Med 17 (1998) 2635, method 10: Wilson's limits of both rates, joined through their
    correlation phi with a continuity correction.

    >>> [round(float(value), 4) for value in paired_difference(36, 12, 2, 0)]
    [0.2, 0.0569, 0.3404]
    """
    e, f, g, h = (float(count) for count in (both, only_a, only_b, neither))
    n = e + f + g + h
    if min(e, f, g, h) < 0:
        raise ValueError(f"counts must not be negative, got {(both, only_a, only_b, neither)}")
    if n == 0:
        return np.nan, -1.0, 1.0
    rate_a, rate_b, difference = (e + f) / n, (e + g) / n, (f - g) / n
    low_a, high_a = wilson_interval(e + f, n, confidence)
    low_b, high_b = wilson_interval(e + g, n, confidence)
    margins = (e + f) * (g + h) * (e + g) * (f + h)
    cross = e * h - f * g
    corrected = max(cross - n / 2, 0.0) if cross > 0 else cross
    phi = corrected / np.sqrt(margins) if margins > 0 else 0.0

    def reach(towards_a, towards_b):
        return np.sqrt(towards_a**2 - 2 * phi * towards_a * towards_b + towards_b**2)

    low = difference - reach(rate_a - low_a, high_b - rate_b)
    high = difference + reach(high_a - rate_a, rate_b - low_b)
    return difference, float(max(low, -1.0)), float(min(high, 1.0))


def mean_interval(values):
    """(mean, low, high): the mean and 1.96 standard errors to either side; no interval from a single value.

    >>> [round(float(end), 3) for end in mean_interval([1.0, 2.0, 3.0])]
    [2.0, 0.868, 3.132]
    """
    values = np.asarray(values, float)
    if not len(values):
        return np.nan, np.nan, np.nan
    half = 1.96 * values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return values.mean(), values.mean() - half, values.mean() + half


def t_interval(values, confidence=0.95):
    """(mean, low, high) of few values, by Student's t: training seeds; no interval from a single value.

    >>> [round(float(end), 3) for end in t_interval([0.5, 0.7, 0.9])]
    [0.7, 0.203, 1.197]
    """
    values = np.asarray(values, float)
    n = len(values)
    half = -stdtrit(n - 1, _half_tail(confidence)) * values.std(ddof=1) / np.sqrt(n) if n > 1 else np.nan
    return values.mean(), values.mean() - half, values.mean() + half


def mcnemar_exact(only_a, only_b):
    """Two-sided p that two arms are equally good, from the seeds on which just one of them succeeded.

    Source: McNemar, Psychometrika 12 (1947) 153, with the exact binomial tail at one half, doubled.

    >>> round(mcnemar_exact(12, 2), 4)
    0.0129
    """
    if min(only_a, only_b) < 0:
        raise ValueError(f"counts must not be negative, got {(only_a, only_b)}")
    return float(min(1.0, 2 * bdtr(min(only_a, only_b), int(only_a + only_b), 0.5)))


def bootstrap_rate(successes, confidence=0.95, draws=4000):
    """Mean of a table of outcomes with a bootstrap interval in two levels: rows are drawn, then columns.

    Args:
        successes: (training seeds, episode seeds) 0 or 1; every training seed ran the same episode seeds.
        confidence: nominal coverage.
        draws: resamples, from a generator of its own that always begins alike.

    Returns:
        (rate, low, high).

    Source: Davison and Hinkley, Bootstrap Methods and Their Application (1997), section 3.8, strategy 1.
    """
    table = np.asarray(successes, float)
    generator, (rows, columns) = np.random.default_rng(0), table.shape
    chosen = generator.multinomial(rows, np.full(rows, 1 / rows), draws) / rows
    weights = generator.multinomial(columns, np.full(columns, 1 / columns), draws) / columns
    rates = ((chosen @ table) * weights).sum(axis=1)
    tail = _half_tail(confidence)
    low, high = np.quantile(rates, [tail, 1 - tail])
    return float(table.mean()), float(low), float(high)
