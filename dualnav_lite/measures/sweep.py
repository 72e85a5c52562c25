"""The policy under eleven preferences and planners under eleven top speeds, on the same seeds."""

import numpy as np
import pandas as pd

from dualnav_lite.config import UnusableInput
from dualnav_lite.evaluate import evaluate
from dualnav_lite.measures.tables import Options
from dualnav_lite.planners import ARMS

VALUES = 11
EPISODES = 200
SLOWEST_M_S, FASTEST_M_S = 0.25, 0.8  # of a planner's knob: preference 1 and 0
DEFAULT_ARMS = ("ppo", "cv_sampling", "orca", "astar", "rrtstar")
DEFAULT_SCENARIOS = ("pop_up", "crowd_crossing", "low_light", "comms_dropout")


def knob(arm: str, preference: float) -> str:
    """Arm id of a planner at this setting of its top speed.

    >>> knob("astar", 0.0), knob("astar", 1.0)
    ('astar@max_speed=0.8', 'astar@max_speed=0.25')
    """
    return f"{arm}@max_speed={round(FASTEST_M_S + preference * (SLOWEST_M_S - FASTEST_M_S), 4):g}"


def sweep(options: Options) -> pd.DataFrame:
    """Rows as `episodes.csv`; `arm` is the planner without its knob, `preference` the setting scaled to [0, 1].

    Finished chunks in `options.out` are not run again.
    """
    scenarios = list(options.scenarios or DEFAULT_SCENARIOS)
    seeds = options.seeds(EPISODES)
    preferences = np.linspace(0.0, 1.0, VALUES).round(6).tolist()
    parts = []
    for arm in options.arms or DEFAULT_ARMS:
        if "@" in arm:
            raise UnusableInput(f"'{arm}': the sweep turns the knob itself; name the planner alone")
        if arm in ARMS:
            setting = {knob(arm, preference): preference for preference in preferences}
            rows = evaluate(list(setting), scenarios, seeds, options.out / "sweep" / arm, jobs=options.jobs)
            parts.append(rows.assign(preference=rows.arm.map(setting), arm=arm))
            continue
        for preference in preferences:
            folder = options.out / "sweep" / f"{arm.replace('/', '_')}_{preference:g}"
            parts.append(evaluate([arm], scenarios, seeds, folder, preference=preference, jobs=options.jobs))
    return pd.concat(parts, ignore_index=True)
