"""Safety against energy: fronts, hypervolumes and how sure they are, only ever within one scenario."""

from collections.abc import Mapping
from pathlib import Path

import moocore
import numpy as np
import pandas as pd

from dualnav_lite.config import Frozen, NonNegative, Positive, UnusableInput, read_yaml, validated
from dualnav_lite.scenario import SCENARIO_FOLDER
from dualnav_lite.survival import survived

REFERENCE_POINT = SCENARIO_FOLDER.parent / "reference" / "reference_point.yaml"
OBJECTIVES = ("safe_dist_m", "energy_j_per_goal")
MAXIMISE = [True, False]  # clearance is sought, energy is spent
PARETO_COLUMNS = [
    "scenario", "arm", "preference", "episodes", *OBJECTIVES, "survival_rate", "pareto_optimal", "hypervolume_share",
]  # fmt: skip
FRONT_COLUMNS = ["scenario", "arm", "hypervolume", "reference_point", "share_on_front", "low", "high"]
EPISODE_COLUMNS = ["scenario", "arm", "seed", "safe_dist_m", "energy_j", "pareto_optimal"]
TRADE_COLUMNS = [
    "scenario", "arm", "measure", "preference_a", "preference_b", "at_a", "at_b", "difference", "low", "high", "n",
]  # fmt: skip
TRADED = ((0.0, 0.5), (0.5, 1.0), (0.0, 1.0))  # preferences that are held against each other
DRAWS = 1000


class ReferencePoint(Frozen):
    """One block of `reference_point.yaml`."""

    safe_dist_m: NonNegative
    energy_j_per_goal: Positive


def reference_point(scenario: str, path: Path = REFERENCE_POINT) -> tuple[float, float]:
    """(safe_dist_m, energy_j_per_goal) that a point must beat to count, fixed before anything was measured."""
    values = read_yaml(path)
    point = values.get(scenario, values.get("default")) if isinstance(values, dict) else None
    if not isinstance(point, Mapping):
        raise UnusableInput(f"{path}: '{scenario}' (or 'default') must hold {' and '.join(OBJECTIVES)}")
    made = validated(ReferencePoint, point, str(path))
    return made.safe_dist_m, made.energy_j_per_goal


def safe_distance(rows: pd.DataFrame) -> pd.Series:
    """Least hull clearance of each episode [m], 0 for one that ended in a contact or an error."""
    hit = rows.outcome.str.startswith("hit_") | rows.outcome.isin(["error", "too_many_contacts"])
    return rows.min_clearance_m.where(~hit, 0.0).fillna(0.0)


def goals_reached(rows: pd.DataFrame) -> pd.Series:
    """Goals of each episode: counted in a long run, 1 or 0 in a short one."""
    return rows.goals.astype("float64").where(rows.goals.notna(), (rows.outcome == "goal").astype(float))


def on_front(points) -> np.ndarray:
    """(n,) whether no other of the (n, 2) points is at least as good in both objectives and better in one.

    Points whose energy is not finite (no goal reached) are never on it; equal points all are.

    >>> on_front([[0.42, 18.3], [0.31, 22.7], [0.25, 35.1], [0.38, 29.5]]).tolist()  # the article's own table
    [True, False, False, False]
    """
    points = np.asarray(points, float).reshape(-1, 2)
    flags = np.isfinite(points).all(axis=1)
    if flags.any():
        flags[flags] = moocore.is_nondominated(points[flags], maximise=MAXIMISE, keep_weakly=True)
    return flags


def hypervolume(points, reference) -> float:
    """Area [m J] between the front of the (n, 2) points and the reference point."""
    points = np.asarray(points, float).reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)]
    return float(moocore.hypervolume(points, ref=reference, maximise=MAXIMISE)) if len(points) else 0.0


def shares_of_hypervolume(points, reference) -> np.ndarray:
    """(n,) how much of the joint area would be lost without each point, as a share of it."""
    points, total = np.asarray(points, float).reshape(-1, 2), hypervolume(points, reference)
    shares, finite = np.zeros(len(points)), np.isfinite(points).all(axis=1)
    if total > 0:
        shares[finite] = moocore.hv_contributions(points[finite], ref=reference, maximise=MAXIMISE) / total
    return shares


def pareto(rows: pd.DataFrame) -> pd.DataFrame:
    """`pareto.csv`: one point per scenario, arm and preference (or knob scaled to [0, 1]), over all training seeds.

    Args:
        rows: as `read_episodes` gives them.
    """
    values = rows.assign(safe=safe_distance(rows), goals=goals_reached(rows), success=survived(rows))
    table = []
    for scenario, group in values.groupby("scenario", sort=False):
        points = group.groupby(["arm", "preference"], sort=True).agg(
            episodes=("seed", "size"), safe_dist_m=("safe", "mean"), energy=("energy_j", "sum"),
            goals=("goals", "sum"), survival_rate=("success", "mean"),
        ).reset_index()  # fmt: skip
        points["energy_j_per_goal"] = _per_goal(points.energy, points.goals)
        points["pareto_optimal"] = on_front(points[list(OBJECTIVES)])
        points["hypervolume_share"] = shares_of_hypervolume(points[list(OBJECTIVES)], reference_point(scenario))
        table.append(points.assign(scenario=scenario)[PARETO_COLUMNS])
    return pd.concat(table, ignore_index=True) if table else pd.DataFrame(columns=PARETO_COLUMNS)


def _per_goal(energy, goals):
    return np.where(np.asarray(goals) > 0, np.asarray(energy) / np.maximum(goals, 1e-12), np.inf)


def front(rows: pd.DataFrame, draws: int = DRAWS) -> pd.DataFrame:
    """`front.csv`: per scenario and arm its own hypervolume, and which share of its points lies on the joint front.

    `low` and `high` bound the share (95 %), by a bootstrap in two levels: training seeds of an arm, then episode seeds,
    which are drawn once for all arms, since they ran the same ones.
    """
    table = []
    for scenario, group in rows.groupby("scenario", sort=False):
        reference, samples = reference_point(scenario), _Samples(group)
        points = samples.measured()
        drawn = [samples.shares_on_front(drawn) for drawn in samples.bootstrap(draws)]
        bounds = np.percentile(drawn, [2.5, 97.5], axis=0)
        for k, (arm, share) in enumerate(zip(samples.arms, samples.shares_on_front(points), strict=True)):
            volume = hypervolume(points[samples.arm_of == k], reference)
            table.append([scenario, arm, volume, "{:g} m; {:g} J".format(*reference), share, *bounds[:, k]])
    return pd.DataFrame(table, columns=FRONT_COLUMNS)


def trade(rows: pd.DataFrame, draws: int = DRAWS) -> pd.DataFrame:
    """`trade.csv`: what each arm's preference does to either objective; `difference` is at preference b minus at a.

    `low` and `high` (95 %) by the bootstrap of `front`: both preferences ran the same seeds, which are drawn together.
    Pairs of `TRADED` that an arm did not run are left out.
    """
    table = []
    for scenario, group in rows.groupby("scenario", sort=False):
        samples = _Samples(group)
        measured, drawn = samples.measured(), samples.bootstrap(draws)
        pairs = [((arm, one), (arm, other)) for arm in samples.arms for one, other in TRADED]
        for start, end in pairs:
            if start not in samples.points or end not in samples.points:
                continue
            a, b = samples.points.index(start), samples.points.index(end)
            with np.errstate(invalid="ignore"):  # no goal at either preference: infinitely much energy a goal
                differences = measured[b] - measured[a]
                bounds = np.percentile(drawn[:, b] - drawn[:, a], [2.5, 97.5], axis=0)
            for k, measure in enumerate(OBJECTIVES):
                values = measured[a, k], measured[b, k], differences[k]
                table.append([scenario, start[0], measure, start[1], end[1], *values, *bounds[:, k], samples.episodes])
    return pd.DataFrame(table, columns=TRADE_COLUMNS)


class _Samples:
    """Episodes of one scenario as arrays that can be drawn from; only seeds that every point ran count.

    Attributes:
        arms: names; arm_of: (points,) index of each point's arm; points: (arm, preference) of each; episodes: seeds.
    """

    def __init__(self, rows: pd.DataFrame):
        trained = rows.training_seed.fillna(-1).astype(int)
        rows = rows.assign(safe=safe_distance(rows), goals=goals_reached(rows), training_seed=trained)
        keys = ["arm", "preference", "training_seed"]
        shared = set.intersection(*(set(group.seed) for _, group in rows.groupby(keys)))
        if not shared:
            raise ValueError(f"{rows.scenario.iloc[0]}: the arms have no seed in common")
        rows = rows[rows.seed.isin(shared)].sort_values([*keys, "seed"])
        self.episodes, self.arms = len(shared), sorted(rows.arm.unique())
        self._values, self.points, arm_of = [], [], []  # of a point: (training seeds, 3, episode seeds)
        for (arm, preference), point in rows.groupby(keys[:2], sort=True):
            by_training = [one[["safe", "energy_j", "goals"]].to_numpy(float).T for _, one in point.groupby(keys[2])]
            self._values.append(np.stack(by_training))
            self.points.append((arm, preference))
            arm_of.append(self.arms.index(arm))
        self.arm_of = np.array(arm_of)

    def measured(self) -> np.ndarray:
        """(points, 2) objectives over all episodes."""
        means = np.array([values.mean(axis=(0, 2)) for values in self._values])
        return np.column_stack([means[:, 0], _per_goal(means[:, 1], means[:, 2])])

    def bootstrap(self, draws: int) -> np.ndarray:
        """(draws, points, 2) objectives, each over episode and training seeds drawn with replacement."""
        generator, n = np.random.default_rng(0), self.episodes
        weights = generator.multinomial(n, np.full(n, 1 / n), draws) / n
        found = np.empty((draws, len(self._values), 2))
        chosen: dict[int, np.ndarray] = {}  # an arm's training seeds are drawn once for all its points
        for k, (values, arm) in enumerate(zip(self._values, self.arm_of, strict=True)):
            if arm not in chosen:
                chosen[arm] = generator.integers(len(values), size=(draws, len(values)))
            means = (values @ weights.T)[chosen[arm] % len(values), :, np.arange(draws)[:, None]].mean(axis=1)
            found[:, k, 0], found[:, k, 1] = means[:, 0], _per_goal(means[:, 1], means[:, 2])
        return found

    def shares_on_front(self, points) -> list[float]:
        """Share of each arm's points that lie on the joint front of the (points, 2) objectives."""
        flags = on_front(points)
        return [float(flags[self.arm_of == k].mean()) for k in range(len(self.arms))]


def pareto_episodes(rows: pd.DataFrame) -> pd.DataFrame:
    """`pareto_episodes.csv`, the article's view (5.1): runs that survived, flagged within scenario and arm."""
    done = rows[survived(rows)]
    table = []
    for (scenario, arm), group in done.groupby(["scenario", "arm"], sort=False):
        points = pd.DataFrame({"safe_dist_m": safe_distance(group), "energy_j": group.energy_j})
        own = points.assign(scenario=scenario, arm=arm, seed=group.seed, pareto_optimal=on_front(points))
        table.append(own[EPISODE_COLUMNS])
    return pd.concat(table, ignore_index=True) if table else pd.DataFrame(columns=EPISODE_COLUMNS)
