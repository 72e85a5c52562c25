"""Differences by which the article's claims on learners (2.1) and on fleets (4.5) are judged, from their tables."""

import numpy as np
import pandas as pd

from dualnav_lite.metrics import t_interval, wilson_interval

COLUMNS = ["question", "difference", "low", "high", "n"]
WEIGHT = 0.3  # of the cross-agent term, article 4.5
# Of two learners: the column compared, who is expected to have more of it, and beside whom.
LEARNERS = {
    "dqn_jitters": ("accel_rms", "dqn", "ppo"),
    "sac_hits_early": ("learning_collisions_early", "sac", "ppo"),
    "ppo_survives_dqn": ("survival_rate", "ppo", "dqn"),
    "ppo_survives_sac": ("survival_rate", "ppo", "sac"),
}


def learner_differences(table: pd.DataFrame) -> pd.DataFrame:
    """Each question of `LEARNERS`: mean difference over the training seeds that both have, and its 95 % t interval.

    One seed has no interval and is left out: a difference between two trainings says nothing of the learners.
    """
    rows = []
    for question, (column, one, other) in LEARNERS.items():
        values = table.pivot(index="training_seed", columns="algorithm", values=column).astype(float)
        if not {one, other} <= set(values):
            continue
        gaps = (values[one] - values[other]).dropna().to_numpy()
        if len(gaps) < 2:
            continue
        rows.append([question, *t_interval(gaps), len(gaps)])
    return pd.DataFrame(rows, columns=COLUMNS)


def fleet_differences(table: pd.DataFrame) -> pd.DataFrame:
    """Robots that arrive with the article's weight minus those that arrive without the term, all sizes together.

    The interval treats both as independent samples (Newcombe's method 10 on Wilson's limits); on the same seeds the
    true one is no wider.
    """
    sums = {}
    for chosen in (WEIGHT, 0.0):
        rows = table[np.isclose(table.cross_weight, chosen)]
        if rows.empty:
            return pd.DataFrame(columns=COLUMNS)
        sums[chosen] = int(rows.robots_arrived.sum()), int((rows.robots * rows.runs).sum())
    (a, n), (b, m) = sums[WEIGHT], sums[0.0]
    (low_a, high_a), (low_b, high_b) = wilson_interval(a, n), wilson_interval(b, m)
    gap = a / n - b / m
    low = gap - np.hypot(a / n - low_a, high_b - b / m)
    high = gap + np.hypot(high_a - a / n, b / m - low_b)
    return pd.DataFrame([["cross_term_helps", gap, low, high, n]], columns=COLUMNS)
