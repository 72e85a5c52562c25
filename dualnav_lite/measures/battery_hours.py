"""Three hours on one battery, minute by minute."""

from functools import partial

import pandas as pd

from dualnav_lite.measures.kept import all_kept, fingerprint
from dualnav_lite.measures.tables import Options
from dualnav_lite.traces import drive

COLUMNS = ["arm", "time_s", "battery", "goals", "contacts"]
ARMS = ("ppo", "ppo_filter", "astar@max_speed=0.5", "astar@max_speed=0.8")
EVERY_STEPS = 600  # a simulated minute


def minutes_of(arm: str, seed: int, minutes: int = 0) -> pd.DataFrame:
    """Rows of `COLUMNS` of one run; of its first `minutes` if not 0."""
    table = []
    for step, (env, info) in enumerate(drive(arm, "battery", seed)):
        if step % EVERY_STEPS == 0 or env.is_done[0]:
            counts = int(env.journal.goals[0]), int(env.journal.contacts[0])
            table.append([arm, float(info["time_s"]), float(info["battery"]), *counts])
        if minutes and step >= minutes * EVERY_STEPS:
            break
    return pd.DataFrame(table, columns=COLUMNS)


def battery_trace(options: Options) -> pd.DataFrame:
    """Charge, goals and contacts of one long run an arm, once a simulated minute."""
    tasks = {}
    for arm in options.arms or ARMS:
        made_of = [arm, fingerprint(arm), options.seed_base, options.episodes]
        tasks[arm] = made_of, partial(minutes_of, arm, options.seed_base, options.episodes)
    return all_kept(options.out / "hours", tasks, options.jobs)
