"""The stress test: one notebook a group of scenarios through papermill, then one table of who survived."""

import platform
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite import __version__
from dualnav_lite.config import Config, UnusableInput, write_atomic
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.episodes import COLUMNS
from dualnav_lite.notebooks import ROOT, run_notebook
from dualnav_lite.planners import make_planner
from dualnav_lite.scenario import all_scenarios
from dualnav_lite.survival import read_episodes, survival, survived

FOLDER = ROOT / "stress_tests"
LONG = "04_battery"  # three hours a run, so it gets arms and a count of its own
TABLE = "| {:<32} | {:<20} | {:>11} | {:>7} | {:>15} | {:>7} | {:>9} | {:>8} |"
HEADER = ("scenario", "arm", "survived", "rate", "95 % (Wilson)", "article", "clearance", "energy")


def notebook_names() -> list[str]:
    """Names of the stress notebooks, in the order of the article's table."""
    return sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def table_lines(table: pd.DataFrame) -> list[str]:
    """The survival table as lines of Markdown that also read well in a terminal.

    Args:
        table: as `survival.survival` gives it.
    """
    titles = {name: scenario.title for name, scenario in all_scenarios().items()}
    lines = [TABLE.format(*HEADER), TABLE.format(*("-" * len(name) for name in HEADER))]
    for row in table.itertuples():
        claim = "" if pd.isna(row.article_claim) else f"{row.article_claim:.0%}"
        interval = f"{row.wilson_low:.1%} - {row.wilson_high:.1%}"
        lines.append(
            TABLE.format(
                titles.get(row.scenario, row.scenario)[:32],
                row.arm,
                f"{row.survived} of {row.episodes}",
                f"{row.survival_rate:.1%}",
                interval,
                claim,
                f"{row.mean_min_clearance_m:.2f} m",
                f"{row.mean_energy_j:.0f} J",
            )
        )
    return lines


def _joined(files: Sequence[Path]) -> str:
    """The rows of several `episodes.csv` under one header."""
    texts = [path.read_text(encoding="utf-8").split("\n", 1) for path in files]
    return ",".join(COLUMNS) + "\n" + "".join(body for _, body in texts)


def _report(table: pd.DataFrame, command: str, failed: Sequence[str]) -> str:
    """A page with the table and what it needs to be read and repeated."""
    machine = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    seeds = ", ".join(sorted({f"{row.seed_first} to {row.seed_last}" for row in table.itertuples()}))
    undone = [f"- `{name}` ended with an error: the executed notebook shows where." for name in failed]
    lines = [
        "# Stress test",
        "",
        f"`{command}`, kit {__version__}, {machine}. Seeds {seeds}; every arm runs the same ones.",
        "",
        *table_lines(table),
        "",
        "A short run survives when the goal is reached in time, without a contact and with charge left. `article` is",
        "the rate that the article reports for its own policy; the arms here are planners. Clearance is the mean over",
        "runs of the least distance between the hull and anything solid, energy the mean of a run.",
        "",
        *undone,
    ]
    return "\n".join(lines).rstrip() + "\n"


def run_stress(
    arms: Sequence[str],
    episodes: int,
    long_arms: Sequence[str],
    long_runs: int,
    seed_base: int,
    jobs: int,
    out: Path,
    command: str,
) -> tuple[pd.DataFrame, list[str]]:
    """Survival table of all stress notebooks, and the names of those that ended with an error.

    Writes the executed notebooks, `episodes.csv`, `survival.csv` and `report.md` to `out`; chunks that an earlier run
    with the same settings finished are not run again.

    Args:
        arms: ids of planners.
        episodes: seeds of each short scenario, from `seed_base`.
        long_arms, long_runs: the same for the three-hour scenario.
        jobs: worker processes.
        out: results folder.
        command: what the reader would type to get the same, for the report.

    Raises:
        UnusableInput: no notebook ran, or `out` refuses.
    """
    import papermill

    names, failed, out = notebook_names(), [], Path(out).resolve()
    for number, name in enumerate(names, start=1):
        drivers, count = (long_arms, long_runs) if name == LONG else (arms, episodes)
        print(f"[{number}/{len(names)}] {name}: seeds {count}, arms {', '.join(drivers)}", file=sys.stderr, flush=True)
        rows = out / name / "episodes.csv"
        rows.unlink(missing_ok=True)  # what an earlier run left does not stand for this one
        parameters = {
            "arms": list(drivers),
            "episodes": count,
            "seed_base": seed_base,
            "jobs": jobs,
            "out": str(rows.parent),
        }
        try:
            run_notebook(FOLDER / f"{name}.ipynb", out / f"{name}.ipynb", parameters, sys.stderr)
        except papermill.PapermillExecutionError as error:
            print(f"{name}: {error.ename}: {error.evalue}", file=sys.stderr, flush=True)
        if not rows.exists():
            failed.append(name)
    files = [out / name / "episodes.csv" for name in names if name not in failed]
    if not files:
        raise UnusableInput(f"no stress notebook came to its end; the executed copies in {out} show why")
    write_atomic(out / "episodes.csv", _joined(files))
    episodes_table = read_episodes(out / "episodes.csv")
    order = list(episodes_table.scenario.unique())  # the article's, not the alphabet's
    table = survival(episodes_table).sort_values("scenario", key=lambda ids: ids.map(order.index), kind="stable")
    write_atomic(out / "survival.csv", table.to_csv(index=False, lineterminator="\n"))
    write_atomic(out / "report.md", _report(table, command, failed))
    return table, failed


def picture(arm: str, scenario: str, seed: int, until_s: float = np.inf) -> np.ndarray:
    """(H, W, 3) uint8 view of an episode at a time, or at its end if that comes first."""
    planner = make_planner(arm, Config())
    env = DynamicNavVectorEnv(
        1,
        scenario=scenario,
        truth=planner.needs_truth,
        full_map=planner.needs_full_map,
        autoreset=False,
        render_mode="rgb_array",
    )
    observations, infos = env.reset(seed=seed)
    planner.reset(np.arange(1))
    ended = False
    while not ended and infos["time_s"][0] < until_s:
        actions = planner.act(observations, split_infos(infos, 1))
        observations, _, terminated, truncated, infos = env.step(actions)
        ended = bool(terminated[0] or truncated[0])
    view = env.render()[0]
    env.close()
    return view


def failures(rows: pd.DataFrame, count: int = 3) -> pd.DataFrame:
    """The first failed episodes of each scenario and arm: what a reader would want to see again."""
    columns = ["scenario", "arm", "seed", "outcome", "time_s", "path_m", "energy_j"]
    return rows[~survived(rows)].groupby(["scenario", "arm"]).head(count)[columns].reset_index(drop=True)
