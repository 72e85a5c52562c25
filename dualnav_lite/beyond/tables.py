"""What lies beyond this kit's own world, by name: small tables, committed in `stress_tests/reference/beyond`."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from dualnav_lite.beyond.page import write_page
from dualnav_lite.config import UnusableInput, write_atomic

TRAINING_SEEDS = (0, 1, 2)


def crowdnav(quick: bool, save) -> pd.DataFrame:
    """CrowdNav's circle crossing with its own arms and this kit's, lidar only (8 minutes of CPU; needs pyrvo)."""
    from dualnav_lite.beyond.crowdnav_robot import crowdnav_table

    if quick:
        return crowdnav_table((5,), ("ppo",), (), 10, on_row=save)
    return crowdnav_table(on_row=save)


def streets(quick: bool, save) -> pd.DataFrame:
    """DQN in the town against exact ways (2 minutes of CPU)."""
    from dualnav_lite.beyond.streets_dqn import front_table

    return front_table(10, (0,), 2_000, save) if quick else front_table(on_row=save)


def onboard(quick: bool, save) -> pd.DataFrame:
    """The policy in a folder without the simulator: frames a second of one thread, on a recorded log (a minute)."""
    from dualnav_lite.beyond.onboard import onboard_table

    return onboard_table(20 if quick else 300)


def parking(quick: bool, save) -> pd.DataFrame:
    """This kit's PPO parks cars of highway-env, SB3's beside it where installed (9 minutes of CPU)."""
    from dualnav_lite.beyond.highway_agent import highway_table

    if quick:
        return highway_table("parking", (0,), 1_024, 2, on_row=save)
    return highway_table("parking", TRAINING_SEEDS, on_row=save)


def traffic(quick: bool, save) -> pd.DataFrame:
    """Three preferences in the traffic of highway-env, beside a planner (9 minutes of CPU)."""
    from dualnav_lite.beyond.highway_agent import highway_table

    if quick:
        return highway_table("traffic", (0,), 1_024, 2, peers=False, on_row=save)
    return highway_table("traffic", TRAINING_SEEDS, peers=False, on_row=save)


def fleet(quick: bool, save) -> pd.DataFrame:
    """Two to four robots with the shipped policy, the cross-agent term at 0, 0.1, 0.3 and 1.0 (a minute of CPU)."""
    from dualnav_lite.beyond.fleet_drive import fleet_table

    return fleet_table((2,), (0.0, 0.3), 2, on_row=save) if quick else fleet_table(on_row=save)


def algorithms(quick: bool, save) -> pd.DataFrame:
    """PPO, DQN and SAC on one budget: survival, jitter, contacts while learning (15 minutes of CPU)."""
    from dualnav_lite.beyond.algorithms import algorithms_table

    return algorithms_table((0,), 2_400, 3, save) if quick else algorithms_table(on_row=save)


TABLES: dict[str, Callable] = {
    "crowdnav": crowdnav,
    "streets": streets,
    "onboard": onboard,
    "parking": parking,
    "traffic": traffic,
    "fleet": fleet,
    "algorithms": algorithms,
}


def run(name: str, out: str | Path, quick: bool = False) -> pd.DataFrame:
    """Measure one table and write it to `<name>.csv`, while it grows, and into the folder's page where there is one.

    Args:
        name: one of `TABLES`.
        out: folder.
        quick: a few episodes, to see that it works.

    Raises:
        UnusableInput: an unknown name, a package or model that is missing, a folder that refuses.
    """
    if name not in TABLES:
        raise UnusableInput(f"unknown table '{name}'; known: {', '.join(TABLES)}")

    def save(table: pd.DataFrame) -> None:
        write_atomic(Path(out) / f"{name}.csv", table.to_csv(index=False, lineterminator="\n", float_format="%.6g"))

    table = TABLES[name](quick, save)
    save(table)
    write_page(out)
    return table
