"""Three hours on one battery, minute by minute."""

import pandas as pd

from dualnav_lite.measures.tables import Options
from dualnav_lite.traces import drive

COLUMNS = ["arm", "time_s", "battery", "goals", "contacts"]
EVERY_STEPS = 600  # a simulated minute


def battery_trace(options: Options) -> pd.DataFrame:
    """Charge, goals and contacts of one long run an arm, once a simulated minute."""
    table = []
    for arm in options.arms or ("ppo", "ppo_filter", "astar@max_speed=0.5", "astar@max_speed=0.8"):
        for step, (env, info) in enumerate(drive(arm, "battery", options.seed_base)):
            if step % EVERY_STEPS == 0 or env.is_done[0]:
                counts = int(env.journal.goals[0]), int(env.journal.contacts[0])
                table.append([arm, float(info["time_s"]), float(info["battery"]), *counts])
            if options.episodes and step >= options.episodes * EVERY_STEPS:
                break
    return pd.DataFrame(table, columns=COLUMNS)
