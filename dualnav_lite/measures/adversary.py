"""Differential evolution in two roles: pushing the front, and looking for failures; random search beside both."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution

from dualnav_lite.chunks import Chunk
from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import library_arm, library_env, run_episodes
from dualnav_lite.measures.tables import Options
from dualnav_lite.pareto import goals_reached, hypervolume, on_front, reference_point, safe_distance
from dualnav_lite.scenario import Scenario, load_scenario
from dualnav_lite.survival import rows_of, survived

SEARCH_SEED = SEEDS["tuning"].start + 60_000  # searches choose, so they run on tuning seeds
FRESH_SEED = SEEDS["tuning"].start + 80_000  # nothing was chosen on these
PERTURBATIONS = {"speed_factor": (0.7, 1.15), "speed_shift_m_s": (-0.05, 0.05), "turn_factor": (0.85, 1.15)}
WEIGHTS = (0.1, 0.3, 0.5, 0.7, 0.9)  # of safety against energy
SCALE_M, SCALE_J = 0.4, 400.0  # what counts as much, in the weighted sum
EACH = 10  # episodes an evaluation
CANNOT_BE = 2.0  # loss of settings without a layout; a run without failures loses less
BUDGET = 2000  # episodes a method
# Settings of each scenario that are searched, and how far: round what the scenario file says, within what can be met.
SETTINGS = {
    "pop_up": {
        "pop_up.speed_m_s": (0.8, 2.2),
        "pop_up.ahead_m": (1.5, 2.4),
        "pop_up.passage_m": (0.7, 1.0),
        "people.speed_m_s.high": (0.5, 1.4),
    },
    "crowd_crossing": {
        "crowd.speed_m_s": (0.5, 1.3),
        "crowd.gap_m.high": (0.2, 0.9),
        "crowd.aim_error_s": (0.0, 1.2),
        "crowd.lead_s.low": (0.8, 3.0),
    },
}
FAILURE_COLUMNS = [
    "scenario", "method", "episodes", "failures", "failure_rate", "worst_settings", "worst_rate_in_search",
    "fresh_episodes", "fresh_failures", "default_failures_on_fresh",
]  # fmt: skip
FRONT_COLUMNS = [
    "scenario", "method", "weight", *PERTURBATIONS, "safe_dist_m", "energy_j_per_goal", "survival_rate", "episodes",
    "pareto_optimal", "fresh_safe_dist_m", "fresh_energy_j_per_goal", "fresh_hypervolume",
]  # fmt: skip


class Perturbed:
    """A driver whose commands are changed within bounds before they are driven, so every point is one that it reaches.

    Args:
        driver: as `evaluate` takes it; change: values of `PERTURBATIONS`, in their order.
        config: its hardware limits still hold.
    """

    def __init__(self, driver, change, config: Config):
        self._driver, self._change = driver, change
        self._limits = config.hardware.limits
        self.needs_truth, self.needs_full_map = driver.needs_truth, driver.needs_full_map
        self.training_seed = getattr(driver, "training_seed", None)

    def reset(self, indices) -> None:
        """Pass on."""
        self._driver.reset(indices)

    def act(self, observations, infos) -> np.ndarray:
        """(n, 2) commands; a robot that is told to stand stands."""
        commands = np.asarray(self._driver.act(observations, infos), float)
        speed_factor, shift, turn_factor = self._change
        moved = commands * [speed_factor, turn_factor]
        moved[:, 0] += np.where(np.abs(commands[:, 0]) > 0.05, shift, 0.0)
        return np.clip(moved, -self._limits, self._limits)


def episodes_of(scenario: Scenario, arm: str, first: int, count: int, make=library_arm) -> pd.DataFrame:
    """Rows of an arm on seeds in a row."""
    chunk = Chunk(scenario, arm, tuple(range(first, first + count)), None)
    return rows_of(run_episodes(chunk, chunk.seeds, Config(), min(16, count), make, library_env))


def search(loss: Callable, bounds, evaluations: int, seed: int, method: str) -> None:
    """Call `loss` about `evaluations` times: by differential evolution, or at random points of the same box."""
    bounds = np.asarray(bounds, float)
    if method == "random":
        for point in np.random.default_rng(seed + 1000).uniform(*bounds.T, (evaluations, len(bounds))):
            loss(point)
        return
    members = min(max(5, evaluations // 8), 5 * len(bounds))  # scipy's smallest population has five members
    generations = max(0, evaluations // members - 1)
    start = np.random.default_rng(seed).uniform(*bounds.T, (members, len(bounds)))
    differential_evolution(loss, bounds, maxiter=generations, init=start, polish=False, rng=seed, tol=0.0)


def objectives(rows: pd.DataFrame) -> tuple[float, float, float]:
    """(safe_dist_m, energy_j_per_goal, survival_rate) of some rows."""
    goals = float(goals_reached(rows).sum())
    energy = float(rows.energy_j.sum()) / goals if goals else np.inf
    return float(safe_distance(rows).mean()), energy, float(survived(rows).mean())


def perturbed_front(options: Options) -> pd.DataFrame:
    """`perturbed_front.csv`: every point that was driven, and what the front's points reach on fresh seeds.

    Rows of the methods `none` (the policy as it is), `evolution` and `random`. `pareto_optimal` is among the points of
    a method on the search's seeds; `fresh_hypervolume` is of all those points together, on fresh ones.
    """
    arm, budget = options.arm, options.episodes or BUDGET
    table = []
    for name in options.scenarios or ("crowd_crossing", "pop_up"):
        scenario = load_scenario(name)
        evaluations = max(1, budget // EACH // len(WEIGHTS))
        fresh = min(100, budget)

        def drive(change, first, count, scenario=scenario):
            def make(arm_id, config):
                return Perturbed(library_arm(arm_id, config), change, config)

            return objectives(episodes_of(scenario, arm, first, count, make))

        for method in ("none", "evolution", "random"):
            points: list[list] = []

            def loss(change, weight, drive=drive, points=points):
                safe, energy, survival_rate = drive(change, SEARCH_SEED, EACH)
                points.append([weight, *change, safe, energy, survival_rate, EACH])
                spent = min(energy, 10 * SCALE_J) / SCALE_J
                return (1 - weight) * spent - weight * safe / SCALE_M + (1 - survival_rate)

            if method == "none":
                loss((1.0, 0.0, 1.0), 0.5)
            else:
                for k, weight in enumerate(WEIGHTS):
                    bounds = list(PERTURBATIONS.values())
                    search(lambda x, w=weight, loss=loss: loss(x, w), bounds, evaluations, k, method)
            table += _with_fresh(name, method, points, lambda x, d=drive, n=fresh: d(x, FRESH_SEED, n))
    return pd.DataFrame(table, columns=FRONT_COLUMNS)


def _with_fresh(name: str, method: str, points: list[list], drive: Callable) -> list[list]:
    """Rows of the points of one method; those on their front are driven again on fresh seeds."""
    flags = on_front([point[4:6] for point in points])
    again = {k: drive(points[k][1:4])[:2] for k in np.flatnonzero(flags)}
    volume = hypervolume(list(again.values()), reference_point(name)) if again else 0.0
    nothing = (np.nan, np.nan)
    return [
        [name, method, *point, bool(flags[k]), *again.get(k, nothing), volume if flags[k] else np.nan]
        for k, point in enumerate(points)
    ]


def failure_search(options: Options) -> pd.DataFrame:
    """`failure_search.csv`: how many failures each method finds in the same number of episodes, and whether they stay.

    The settings with the most failures are run again on fresh seeds, and so is the scenario as it is.
    """
    arm, budget = options.arm, options.episodes or BUDGET
    table = []
    for name in options.scenarios or SETTINGS:
        fresh = min(200, budget)
        default = int((~survived(episodes_of(load_scenario(name), arm, FRESH_SEED, fresh))).sum())
        keys = list(SETTINGS[name])
        for method in ("evolution", "random"):
            tried: list[tuple] = []

            def loss(values, name=name, keys=keys, tried=tried):
                changed = with_overrides(load_scenario(name), dict(zip(keys, map(float, values), strict=True)))
                try:
                    rows = episodes_of(changed, arm, SEARCH_SEED, EACH)
                except UnusableInput:
                    return CANNOT_BE  # no room can hold this event: not a failure of the robot
                failures = int((~survived(rows)).sum())
                clearance = float(safe_distance(rows).mean())
                tried.append((failures, -clearance, changed, values))
                return clearance - failures / EACH

            search(loss, list(SETTINGS[name].values()), max(1, budget // EACH), 0, method)
            if not tried:
                raise UnusableInput(f"{name}: in {budget} episodes {method} search met no settings that can be")
            worst = max(tried, key=lambda one: one[:2])
            again = int((~survived(episodes_of(worst[2], arm, FRESH_SEED, fresh))).sum())
            failures, episodes = sum(one[0] for one in tried), EACH * len(tried)
            described = "; ".join(f"{key} {value:.3g}" for key, value in zip(keys, worst[3], strict=True))
            found = [failures, failures / episodes, described, worst[0] / EACH]
            table.append([name, method, episodes, *found, fresh, again, default])
    return pd.DataFrame(table, columns=FAILURE_COLUMNS)
