"""What the battery band does: the same states with 15 and with 100 % written into it, and runs begun at either."""

from functools import partial

import numpy as np
import pandas as pd

from dualnav_lite.chunks import Chunk
from dualnav_lite.config import Config, dump_config
from dualnav_lite.drivers import make_driver
from dualnav_lite.encoder import BAND_EDGES, BANDS, EGO
from dualnav_lite.env import split_infos
from dualnav_lite.evaluate import library_env, run_episodes
from dualnav_lite.measures.kept import all_kept, fingerprint
from dualnav_lite.measures.tables import Options
from dualnav_lite.metrics import bootstrap_rate
from dualnav_lite.pareto import safe_distance
from dualnav_lite.scenario import Range, load_scenario
from dualnav_lite.survival import rows_of, survived

LOW, HIGH = 0.15, 1.0  # charge
EPISODES = 100
DEFAULT_SCENARIOS = ("pop_up", "crowd_crossing", "low_light", "comms_dropout")
COLUMNS = ["scenario", "measure", "at_15", "at_100", "difference", "low", "high", "n"]


def with_charge(observations, charge: float) -> np.ndarray:
    """A copy of (n, C, 64, 64) observations that says this charge and nothing else differently."""
    band = BANDS.index("battery")
    changed = np.array(observations)
    changed[:, EGO, BAND_EDGES[band] : BAND_EDGES[band + 1]] = charge
    return changed


def frozen_states(arm: str, scenario: str, seeds) -> np.ndarray:
    """(episodes, 2, 2) mean |v| [m/s] and |omega| [rad/s] of each episode's states with a low and with a full battery.

    The policy drives as it always does; two copies of it, each with its own memory, are shown every state it passes
    with the band changed, and their commands are written down and never driven.
    """
    config = Config()
    driver, twins = make_driver(arm, config), [make_driver(arm, config) for _ in (LOW, HIGH)]
    env = library_env(len(seeds), config, load_scenario(scenario), driver)
    observations, infos = env.reset(seed=list(seeds))
    everything = np.arange(env.num_envs)
    for one in (driver, *twins):
        one.reset(everything)
    sums, steps = np.zeros((env.num_envs, 2, 2)), np.zeros(env.num_envs)
    while not env.is_done.all():
        active, worlds = ~env.is_done, split_infos(infos, env.num_envs)
        for k, (twin, charge) in enumerate(zip(twins, (LOW, HIGH), strict=True)):
            sums[active, k] += np.abs(twin.act(with_charge(observations, charge), worlds))[active]
        steps += active
        actions = np.where(active[:, None], driver.act(observations, worlds), 0.0)
        observations, _, _, _, infos = env.step(actions)
    env.close()
    return sums / steps[:, None, None]


def whole_runs(arm: str, scenario: str, seeds, charge: float) -> pd.DataFrame:
    """Rows of episodes that all begin with this charge."""
    fixed = load_scenario(scenario).model_copy(update={"start_charge": Range(low=charge, high=charge)})
    chunk = Chunk(fixed, arm, tuple(seeds), None)
    return rows_of(run_episodes(chunk, chunk.seeds, Config(), 16, make_driver, library_env))


def of_scenario(arm: str, scenario: str, seeds) -> pd.DataFrame:
    """Rows of `intervention.csv` of one scenario."""
    states = frozen_states(arm, scenario, seeds)
    pairs = {
        "command |v| on the same states [m/s]": states[:, :, 0],
        "command |omega| on the same states [rad/s]": states[:, :, 1],
    }
    low, high = (whole_runs(arm, scenario, seeds, charge) for charge in (LOW, HIGH))
    for measure, of in (
        ("survived", lambda rows: survived(rows).astype(float)),
        ("least clearance of a run [m]", safe_distance),
        ("energy of a run [J]", lambda rows: rows.energy_j),
        ("mean speed of a run [m/s]", lambda rows: rows.path_m / rows.time_s),
    ):
        pairs[measure] = np.column_stack([of(low), of(high)])
    table = []
    for measure, values in pairs.items():
        difference = bootstrap_rate((values[:, 0] - values[:, 1])[None])
        table.append([scenario, measure, *values.mean(axis=0), *difference, len(values)])
    return pd.DataFrame(table, columns=COLUMNS)


def intervention(options: Options) -> pd.DataFrame:
    """`intervention.csv`: value at 15 %, at 100 %, and their difference on the same states or seeds with 95 %."""
    arm, seeds = options.arm, options.seeds(EPISODES)
    tasks = {}
    for scenario in options.scenarios or DEFAULT_SCENARIOS:
        made_of = [arm, fingerprint(arm), dump_config(load_scenario(scenario)), seeds.start, len(seeds)]
        tasks[scenario] = made_of, partial(of_scenario, arm, scenario, seeds)
    return all_kept(options.out / "intervention", tasks, options.jobs)
