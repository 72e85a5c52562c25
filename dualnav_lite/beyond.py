"""What lies beyond this kit's own world, by name: small tables, committed in `stress_tests/reference/beyond`."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from dualnav_lite.config import UnusableInput, write_atomic


def crowdnav(quick: bool) -> pd.DataFrame:
    """CrowdNav's circle crossing with its own arms and this kit's, lidar only (minutes; needs pyrvo)."""
    from dualnav_lite.crowdnav_robot import crowdnav_table
    from dualnav_lite.deploy import MODEL_FOLDER

    policy = ("ppo", "ppo_filter") if (MODEL_FOLDER / "ppo_actor.onnx").exists() else ()
    planners = ("cv_sampling",) if quick else ("cv_sampling", "cv_sampling+", "astar")
    return crowdnav_table((5,) if quick else (5, 10), planners + policy, 10 if quick else 500)


TABLES: dict[str, Callable[[bool], pd.DataFrame]] = {"crowdnav": crowdnav}


def run(name: str, out: str | Path, quick: bool = False) -> pd.DataFrame:
    """Measure one table and write it to `<name>.csv`.

    Args:
        name: one of `TABLES`.
        out: folder.
        quick: a few episodes, to see that it works.

    Raises:
        UnusableInput: an unknown name, a package that is missing, a folder that refuses.
    """
    if name not in TABLES:
        raise UnusableInput(f"unknown table '{name}'; known: {', '.join(TABLES)}")
    table = TABLES[name](quick)
    write_atomic(Path(out) / f"{name}.csv", table.to_csv(index=False, lineterminator="\n", float_format="%.6g"))
    return table
