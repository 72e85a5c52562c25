"""What both roles of differential evolution use: commands that are changed, episodes that are kept, two searches.

`perturb` pushes the front, `failures` looks for failures; random search with as many episodes stands beside both.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution

from dualnav_lite.chunks import Chunk
from dualnav_lite.config import Config, dump_config
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import library_arm, library_env, run_episodes
from dualnav_lite.measures.kept import fingerprint, kept
from dualnav_lite.scenario import Scenario
from dualnav_lite.survival import read_episodes, rows_of

SEARCH_SEED = SEEDS["tuning"].start + 60_000  # searches choose, so they run on tuning seeds
FRESH_SEED = SEEDS["tuning"].start + 80_000  # nothing was chosen on these
PERTURBATIONS = {"speed_factor": (0.7, 1.15), "speed_shift_m_s": (-0.05, 0.05), "turn_factor": (0.85, 1.15)}
EACH = 10  # episodes an evaluation
BUDGET = 2000  # episodes a method


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


def perturbed_arm(change: Sequence[float], arm: str, config: Config) -> Perturbed:
    """An arm whose commands are changed."""
    return Perturbed(library_arm(arm, config), change, config)


def episodes_of(
    folder: Path, scenario: Scenario, arm: str, first: int, count: int, change: Sequence[float] | None = None
) -> pd.DataFrame:
    """Rows of an arm on seeds in a row, its commands changed or not; kept in `folder`."""

    def run() -> pd.DataFrame:
        chunk = Chunk(scenario, arm, tuple(range(first, first + count)), Path())
        make = library_arm if change is None else partial(perturbed_arm, change)
        return rows_of(run_episodes(chunk, chunk.seeds, Config(), min(16, count), make, library_env))

    made_of = [dump_config(scenario), arm, fingerprint(arm), first, count, None if change is None else list(change)]
    return kept(folder / "episodes", scenario.id, made_of, run, read_episodes)


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
