"""`survival`: does a policy reach the goal without a contact often enough? Decided by an exact interval.

An interval that lies above the threshold passes, one below fails; one that straddles it buys as many seeds again, up to
the budget, where the rate itself decides. Each look at the interval uses up its share of the error (Bonferroni).
"""

from grading.rubric import Survival

PASSED, FAILED, UNDECIDED = "passed", "failed", "undecided"


def looks(rule: Survival) -> list[int]:
    """Numbers of seeds after which the interval is looked at: first, twice that, ..., most.

    >>> looks(Survival(points=1, thresholds={"navigation": 0.5}, first=20, most=80))
    [20, 40, 80]
    """
    counts = [rule.first]
    while counts[-1] < rule.most:
        counts.append(min(2 * counts[-1], rule.most))
    return counts


def interval(survived: int, episodes: int, rule: Survival) -> tuple[float, float]:
    """Clopper-Pearson interval of the rate at one of the looks."""
    from dualnav_lite.metrics import exact_interval

    low, high = exact_interval(survived, episodes, 1.0 - (1.0 - rule.confidence) / len(looks(rule)))
    return float(low), float(high)


def decide(survived: int, episodes: int, threshold: float, rule: Survival) -> str:
    """`PASSED`, `FAILED` or `UNDECIDED` after so many episodes."""
    low, high = interval(survived, episodes, rule)
    if low >= threshold or high < threshold:
        return PASSED if low >= threshold else FAILED
    if episodes < rule.most:
        return UNDECIDED
    return PASSED if survived >= threshold * episodes else FAILED
