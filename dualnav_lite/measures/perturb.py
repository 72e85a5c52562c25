"""Bounded changes of the policy's commands, driven in the simulator: does evolution push the front more than chance?"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite.config import dump_config
from dualnav_lite.measures.adversary import BUDGET, EACH, FRESH_SEED, PERTURBATIONS, SEARCH_SEED, episodes_of, search
from dualnav_lite.measures.kept import all_kept, fingerprint
from dualnav_lite.measures.tables import Options
from dualnav_lite.pareto import goals_reached, hypervolume, on_front, reference_point, safe_distance
from dualnav_lite.scenario import load_scenario
from dualnav_lite.survival import survived

WEIGHTS = (0.1, 0.3, 0.5, 0.7, 0.9)  # of safety against energy
SCALE_M, SCALE_J = 0.4, 400.0  # what counts as much, in the weighted sum
FRONT_COLUMNS = [
    "scenario", "method", "weight", *PERTURBATIONS, "safe_dist_m", "energy_j_per_goal", "survival_rate", "episodes",
    "pareto_optimal", "fresh_safe_dist_m", "fresh_energy_j_per_goal", "fresh_hypervolume",
]  # fmt: skip
GAIN_COLUMNS = ["scenario", "question", "difference", "low", "high", "n"]
QUESTIONS = {"evolution_minus_random": ("evolution", "random"), "evolution_minus_none": ("evolution", "none")}
UNCHANGED = (1.0, 0.0, 1.0)
DRAWS = 1000  # of the bootstrap


def objectives(rows: pd.DataFrame) -> tuple[float, float, float]:
    """(safe_dist_m, energy_j_per_goal, survival_rate) of some rows."""
    goals = float(goals_reached(rows).sum())
    energy = float(rows.energy_j.sum()) / goals if goals else np.inf
    return float(safe_distance(rows).mean()), energy, float(survived(rows).mean())


def perturbed_points(folder: Path, name: str, arm: str, method: str, budget: int) -> pd.DataFrame:
    """Rows of `perturbed_front.csv` of one scenario and method."""
    scenario, evaluations = load_scenario(name), max(1, budget // EACH // len(WEIGHTS))
    points: list[list] = []

    def loss(change, weight: float) -> float:
        change = [float(value) for value in change]
        safe, energy, survival_rate = objectives(episodes_of(folder, scenario, arm, SEARCH_SEED, EACH, change))
        points.append([weight, *change, safe, energy, survival_rate, EACH])
        spent = min(energy, 10 * SCALE_J) / SCALE_J
        return (1 - weight) * spent - weight * safe / SCALE_M + (1 - survival_rate)

    if method == "none":
        loss(UNCHANGED, 0.5)
    else:
        for k, weight in enumerate(WEIGHTS):
            search(partial(loss, weight=weight), list(PERTURBATIONS.values()), evaluations, k, method)
    flags = on_front([point[4:6] for point in points])
    fresh = {k: fresh_rows(folder, name, arm, points[k][1:4], budget) for k in np.flatnonzero(flags)}
    again = {k: objectives(rows)[:2] for k, rows in fresh.items()}
    volume = hypervolume(list(again.values()), reference_point(name)) if again else 0.0
    nothing = (np.nan, np.nan)
    rows = [
        [name, method, *point, bool(flags[k]), *again.get(k, nothing), volume if flags[k] else np.nan]
        for k, point in enumerate(points)
    ]
    return pd.DataFrame(rows, columns=FRONT_COLUMNS)


def fresh_rows(folder: Path, name: str, arm: str, change: Sequence[float], budget: int) -> pd.DataFrame:
    """Rows of a point on seeds that no search saw."""
    return episodes_of(folder, load_scenario(name), arm, FRESH_SEED, min(100, budget), list(change))


def perturbed_front(options: Options) -> tuple[pd.DataFrame, pd.DataFrame]:
    """`perturbed_front.csv`: every point that was driven, and what the front's points reach on fresh seeds;
    `perturbed_gain.csv`: differences of the methods' areas on fresh seeds, with 95 %.

    Rows of the methods `none` (the policy as it is), `evolution` and `random`. `pareto_optimal` is among the points of
    a method on the search's seeds; `fresh_hypervolume` is of all those points together, on fresh ones.
    """
    arm, budget = options.arm, options.episodes or BUDGET
    folder, tasks = options.out / "perturb", {}
    names = list(options.scenarios or ("crowd_crossing", "pop_up"))
    for name in names:
        for method in ("none", "evolution", "random"):
            made_of = [dump_config(load_scenario(name)), arm, fingerprint(arm), method, budget]
            tasks[f"{name}.{method}"] = made_of, partial(perturbed_points, folder, name, arm, method, budget)
    points = all_kept(folder, tasks, options.jobs)
    gains = [gain_of(points[points.scenario == name], folder, name, arm, budget) for name in names]
    return points, pd.concat(gains, ignore_index=True)


def gain_of(points: pd.DataFrame, folder: Path, name: str, arm: str, budget: int) -> pd.DataFrame:
    """Rows of `perturbed_gain.csv` of one scenario: a bootstrap over the fresh seeds, drawn once for all points."""
    reference = reference_point(name)
    values: dict[str, list[np.ndarray]] = {}
    for point in points[points.pareto_optimal].itertuples():
        rows = fresh_rows(folder, name, arm, [getattr(point, key) for key in PERTURBATIONS], budget)
        columns = [safe_distance(rows), rows.energy_j, goals_reached(rows)]
        values.setdefault(point.method, []).append(np.stack([column.to_numpy(float) for column in columns]))
    count = min(100, budget)
    weights = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), DRAWS) / count
    weights = np.vstack([np.full(count, 1 / count), weights])  # the first: as measured

    def areas(method: str) -> np.ndarray:
        if method not in values:  # no point of it reached a goal
            return np.zeros(DRAWS + 1)
        means = np.stack([values_of @ weights.T for values_of in values[method]])  # (points, 3, draws)
        energy = np.where(means[:, 2] > 0, means[:, 1] / np.maximum(means[:, 2], 1e-12), np.inf)
        return np.array(
            [hypervolume(pair, reference) for pair in np.stack([means[:, 0], energy], axis=-1).swapaxes(0, 1)]
        )

    table = []
    for question, (one, other) in QUESTIONS.items():
        gaps = areas(one) - areas(other)
        table.append([name, question, gaps[0], *np.percentile(gaps[1:], [2.5, 97.5]), count])
    return pd.DataFrame(table, columns=GAIN_COLUMNS)
