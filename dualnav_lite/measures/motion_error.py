"""Endpoint error of every motion method against the simulator's truth, and what ego compensation is worth."""

from collections import defaultdict, deque
from functools import partial

import numpy as np
import pandas as pd

from dualnav_lite.chunks import sha256
from dualnav_lite.config import Config, dump_config
from dualnav_lite.env import split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.forecast import SHIPPED
from dualnav_lite.measures.kept import all_kept, fingerprint
from dualnav_lite.measures.motion_methods import METHODS, Methods, true_velocities
from dualnav_lite.measures.tables import Options
from dualnav_lite.metrics import bootstrap_rate
from dualnav_lite.perception import FLOW_SCANS
from dualnav_lite.scenario import load_scenario
from dualnav_lite.truth import truth_of

PAIRS = (  # a method, and what it is held against
    ("farneback", "farneback_raw"),
    ("forecast", "forecast_raw"),
    ("forecast", "farneback"),
    ("forecast_lstm", "forecast"),
)
STANDS = "drive_wait_straight@share=0.3+wait_s=8"  # the policy never stands; this one waits where a crowd will cross
STILL = 0.02  # of |v| [m/s] and |omega| [rad/s] in all three scans of a flow: standing; everything else is driving
DEFAULT_SCENARIOS = ("crowd_crossing", "crowd_reactive", "pop_up")
EPISODES = 100
BLOCK = 10  # episodes that are kept together
CELLS = ("moving", "static")
_OF_AN_EPISODE = ("mean_m_s", "median_m_s", "cells")
EPISODE_COLUMNS = ["scenario", "state", "seed", "method", *(f"{c}_{what}" for c in CELLS for what in _OF_AN_EPISODE)]
_OF_A_METHOD = ("epe_mean_m_s", "epe_low_m_s", "epe_high_m_s", "epe_median_m_s", "cells", "episodes")
ERROR_COLUMNS = ["scenario", "state", "method", *(f"{c}_{what}" for c in CELLS for what in _OF_A_METHOD)]
_OF_A_PAIR = ("gain_m_s", "gain_low_m_s", "gain_high_m_s", "episodes")
PAIRED_COLUMNS = ["scenario", "state", "method", "against", *(f"{c}_{what}" for c in CELLS for what in _OF_A_PAIR)]


def of_episodes(scenario: str, state: str, arm: str, seeds) -> pd.DataFrame:
    """Rows of `EPISODE_COLUMNS`: a method in an episode, over all cells of its frames in one state of the robot.

    Args:
        scenario: id.
        state: "standing" or "driving"; frames of the other state are left out.
        arm: who drives.
        seeds: one world each, all at once.
    """
    config, n = Config(), len(seeds)
    driver = library_arm(arm, config)
    env = library_env(n, config, load_scenario(scenario), driver)
    observations, infos = env.reset(seed=list(seeds))
    driver.reset(np.arange(n))
    methods, stills = Methods(infos["scan"], infos["pose"]), deque([np.ones(n, bool)], FLOW_SCANS)
    errors: defaultdict[tuple, list] = defaultdict(list)
    while not env.is_done.all():
        active = ~env.is_done
        actions = np.where(active[:, None], driver.act(observations, split_infos(infos, n)), 0.0)
        observations, _, _, _, infos = env.step(actions)
        methods.see(infos["scan"], infos["pose"], active, env.sim)
        stills.append((np.abs(env.sim.robots.twist) < STILL).all(axis=1))
        if len(stills) < FLOW_SCANS:
            continue
        truth, is_standing = truth_of(env.sim), np.logical_and.reduce(stills)
        for i in np.flatnonzero(active & (is_standing == (state == "standing"))):
            cells, said = methods.say(i)
            velocities, is_moving = true_velocities(truth, i, cells)
            for method in METHODS:
                error = np.linalg.norm(said[method] - velocities, axis=1)
                errors[i, method, "moving"].append(error[is_moving])
                errors[i, method, "static"].append(error[~is_moving])
    env.close()
    table = []
    for i, seed in enumerate(seeds):
        for method in METHODS:
            summaries = [_summary(errors[i, method, kind]) for kind in CELLS]
            table.append([scenario, state, seed, method, *summaries[0], *summaries[1]])
    return pd.DataFrame(table, columns=EPISODE_COLUMNS)


def _summary(errors):
    """(mean, median, number) of the errors of an episode's frames; no mean without any."""
    values = np.concatenate([np.zeros(0), *errors])
    return (values.mean(), np.median(values), len(values)) if len(values) else (np.nan, np.nan, 0)


def _interval(values):
    """[mean, low, high, number] over episodes, 95 % by a bootstrap that draws whole episodes; empty without any."""
    values = values[np.isfinite(values)]
    return [*bootstrap_rate(values[None]), len(values)] if len(values) else [np.nan, np.nan, np.nan, 0]


def error_table(episodes: pd.DataFrame) -> pd.DataFrame:
    """`motion_error.csv`: mean over episodes of an episode's mean endpoint error with 95 %, and of its median.

    The error of `none` on moving cells is how fast they move; that of any method on static cells is false motion.
    """
    table = []
    for key, rows in episodes.groupby(["scenario", "state", "method"], sort=False):
        line = list(key)
        for kind in CELLS:
            *mean, count = _interval(rows[f"{kind}_mean_m_s"].to_numpy())
            line += [*mean, rows[f"{kind}_median_m_s"].mean(), rows[f"{kind}_cells"].sum(), count]
        table.append(line)
    return pd.DataFrame(table, columns=ERROR_COLUMNS)


def paired_table(episodes: pd.DataFrame) -> pd.DataFrame:
    """`motion_error_paired.csv`: error of `against` minus that of `method` on the same cells with 95 %."""
    table = []
    for (scenario, state), rows in episodes.groupby(["scenario", "state"], sort=False):
        for method, against in PAIRS:
            line = [scenario, state, method, against]
            for kind in CELLS:
                means = rows.pivot(index="seed", columns="method", values=f"{kind}_mean_m_s")
                line += _interval((means[against] - means[method]).to_numpy())
            table.append(line)
    return pd.DataFrame(table, columns=PAIRED_COLUMNS)


def episode_errors(options: Options) -> pd.DataFrame:
    """Rows of `EPISODE_COLUMNS` of all scenarios, seeds and states; `options.arm` is who drives."""
    tasks, seeds, lstm = {}, options.seeds(EPISODES), sha256(SHIPPED.read_bytes())
    for scenario in options.scenarios or DEFAULT_SCENARIOS:
        for state, arm in (("standing", STANDS), ("driving", options.arm)):
            for first in range(0, len(seeds), BLOCK):
                part = seeds[first : first + BLOCK]
                made_of = [state, arm, fingerprint(arm), lstm, dump_config(load_scenario(scenario)), list(part)]
                make = partial(of_episodes, scenario, state, arm, part)
                tasks[f"{scenario}.{state}.{part.start}"] = made_of, make
    return all_kept(options.out / "motion", tasks, options.jobs)
