"""DQN in the town, held against exact ways: trained for one goal, judged on walks it never saw."""

import numpy as np
import pandas as pd

from dualnav_lite import streams
from dualnav_lite.beyond.streets import (
    DAY_MIN,
    StreetsVectorEnv,
    Town,
    Walk,
    build_town,
    exact_walk,
    frozen_walk,
    street_mask,
    weigh,
)
from dualnav_lite.dqn import DQN, QNetwork, td_target, train_dqn
from dualnav_lite.episodes import SEEDS
from dualnav_lite.metrics import mean_interval, wilson_interval

GOAL = 48  # the corner of the town where the walker lives
APART_M = 300.0  # of a judged walk's ends
STEPS, WALKERS, HIDDEN = 60_000, 32, 128
SETTINGS = DQN(learning_rate=1e-3, gamma=1.0, train_every=8)  # a walk ends, so nothing needs to count less
PREFERENCES = (0.0, 0.25, 0.5, 0.75, 1.0)
COLUMNS = [
    "arm", "training_seed", "preference", "walks", "arrived_rate", "wilson_low", "wilson_high", "mean_metres",
    "mean_risk", "mean_excess", "excess_low", "excess_high",
]  # fmt: skip


def train_walker(
    town: Town, steps: int = STEPS, seed: int = 0, goals=(GOAL,), on_step=lambda infos, share: None, targets=td_target
):
    """A Q-network that knows the way home at any hour for any preference."""
    env = StreetsVectorEnv(WALKERS, town, goals)
    return train_dqn(env, SETTINGS, steps, seed, street_mask, HIDDEN, on_step, targets)


def draw_trips(town: Town, count: int, seed: int = SEEDS["test"].start):
    """`count` triples: start, goal and minute of departure, at least `APART_M` apart; other ones for another seed."""
    rng = streams.stream(seed, "trips")
    trips: list[tuple[int, int, int]] = []
    while len(trips) < count:
        start, minute = int(rng.integers(len(town.places))), int(rng.integers(DAY_MIN))
        if np.hypot(*(town.places[start] - town.places[GOAL])) >= APART_M:
            trips.append((start, GOAL, minute))
    return trips


def walks_of_network(network: QNetwork, town: Town, trips, preference: float) -> list[tuple[float, float, bool]]:
    """Metres, risk and whether it arrived, of each trip that the network walks."""
    env = StreetsVectorEnv(len(trips), town)
    observations, _ = env.reset(options={"trips": np.column_stack([trips, np.full(len(trips), preference)])})
    found: list = [None] * len(trips)
    while any(one is None for one in found):
        observations, _, terminated, truncated, infos = env.step(network.best(observations))
        for i, walk in zip(np.flatnonzero(terminated | truncated), infos.get("walks", ()), strict=True):
            found[i] = found[i] or walk[4:]
    return found


def row_of(arm: str, training_seed, preference: float, walks, best) -> dict:
    """A row: arrivals with Wilson's interval, means, and the mean excess over the exact way with its 95 % interval.

    Walks that did not arrive count in the arrivals and nowhere else.
    """
    arrived = np.array([walk[2] for walk in walks])
    metres, risk = np.array([walk[:2] for walk in walks], float)[arrived].T
    excess = weigh(metres, risk, preference) / np.asarray(best)[arrived] - 1.0
    rates = [len(walks), arrived.mean(), *wilson_interval(arrived.sum(), len(walks))]
    means = [metres.mean(), risk.mean()] if len(excess) else [np.nan, np.nan]
    return dict(zip(COLUMNS, [arm, training_seed, preference, *rates, *means, *mean_interval(excess)], strict=True))


def front_table(walks: int = 100, seeds=(0, 1, 2), steps: int = STEPS, on_row=lambda table: None) -> pd.DataFrame:
    """Exact ways, ways planned for the risk at departure, and DQN, on the same walks for each preference."""
    town, rows = build_town(0), []
    trips = draw_trips(town, walks)
    best: dict[float, np.ndarray] = {}
    for preference in PREFERENCES:
        arms: dict[str, list[Walk]] = {
            "exact": [exact_walk(town, start, goal, minute, preference) for start, goal, minute in trips],
            "risk_at_departure": [frozen_walk(town, start, goal, minute, preference) for start, goal, minute in trips],
        }
        best[preference] = np.array([weigh(walk.metres, walk.risk, preference) for walk in arms["exact"]])
        for arm, found in arms.items():
            judged = [(walk.metres, walk.risk, True) for walk in found]
            rows.append(row_of(arm, None, preference, judged, best[preference]))
    for seed in seeds:
        network = train_walker(town, steps, seed)
        for preference in PREFERENCES:
            judged = walks_of_network(network, town, trips, preference)
            rows.append(row_of("dqn", seed, preference, judged, best[preference]))
        on_row(pd.DataFrame(rows, columns=COLUMNS))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"training_seed": "Int64"})
