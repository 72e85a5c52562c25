"""What trainings reached, and what the preference and the battery's band change: Markdown of `models/README.md`."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from dualnav_lite.metrics import t_interval
from dualnav_lite.report import markdown
from dualnav_lite.survival import paired, survival, survived

SHIPPED = "ppo"
OBJECTIVES = {"energy_j_per_goal": ("energy a goal [J]", ".0f"), "safe_dist_m": ("least clearance [m]", ".2f")}
COSTS = {"time_s": ("s", ".2f"), "energy_j": ("J", ".1f")}
BAND = "command |v| on the same states [m/s]"


def paired_lines(rows: pd.DataFrame, pairs: Iterable[tuple[str, str]]) -> list[str]:
    """A line a scenario: each pair's first arm minus its second, in points of survival, on the same seeds."""
    tables = {f"`{a}` minus `{b}`": paired(rows, a, b).set_index("scenario") for a, b in pairs}
    scenarios = sorted(set().union(*(table.index for table in tables.values())))
    cells = [
        [scenario, *(_points(table.loc[scenario]) if scenario in table.index else "" for table in tables.values())]
        for scenario in scenarios
    ]
    return markdown(["scenario", *tables], cells)


def _points(row) -> str:
    return f"{100 * row.difference:+.1f} ({100 * row.low:+.1f} to {100 * row.high:+.1f})"


def cost_lines(rows: pd.DataFrame, pairs: Iterable[tuple[str, str]]) -> list[str]:
    """A line a scenario: what each pair's first arm takes more than its second, over the seeds that both survive.

    Args:
        rows: episodes, one a scenario, arm and seed.
        pairs: two arms each.

    Returns:
        Lines; time [s] and energy [J] of a run, means with 95 % by Student's t.
    """
    kept = rows[survived(rows)].set_index(["scenario", "arm", "seed"])[list(COSTS)]
    cells = {scenario: [scenario] for scenario in sorted(rows.scenario.unique())}
    heads = ["scenario"]
    for a, b in pairs:
        change = (kept.xs(a, level="arm") - kept.xs(b, level="arm")).dropna()
        for name, (unit, digits) in COSTS.items():
            heads.append(f"`{a}` minus `{b}` [{unit}]")
            for scenario, line in cells.items():
                line.append(_mean(change.loc[change.index.get_level_values("scenario") == scenario, name], digits))
    return markdown(heads, [line for line in cells.values() if any(line[1:])])


def _mean(values: pd.Series, digits: str) -> str:
    if len(values) < 2:
        return ""
    mean, low, high = (format(value, "+" + digits) for value in t_interval(values))
    return f"{mean} ({low} to {high})"


def training_lines(rows: pd.DataFrame, shipped: pd.DataFrame) -> list[str]:
    """A line a scenario: how many of the same seeds each policy of `models/trainings` survives, the shipped one first.

    Args:
        rows: episodes whose arms are the paths of policies.
        shipped: episodes of `ppo` among others.

    Returns:
        Lines; after the counts, PPO minus imitation for each training that has both (`record_X`, `imitated_X`): in
        points of survival, then what a survived run takes.
    """
    rows = pd.concat([shipped[shipped.arm == SHIPPED], rows.assign(arm=rows.arm.map(lambda arm: Path(arm).stem))])
    table = survival(rows)
    arms = [SHIPPED, *sorted(set(table.arm) - {SHIPPED})]
    counts = {(row.scenario, row.arm): f"{row.survived} of {row.episodes}" for row in table.itertuples()}
    cells = [
        [scenario, *(counts.get((scenario, arm), "") for arm in arms)]
        for scenario in sorted({scenario for scenario, arm in counts if arm != SHIPPED})
    ]
    both = [(f"record_{name}", f"imitated_{name}") for name in _names(arms, "record_") if f"imitated_{name}" in arms]
    lines = markdown(["scenario", *(f"`{arm}`" for arm in arms)], cells)
    return [*lines, "", *paired_lines(rows, both), "", *cost_lines(rows, both)] if both else lines


def _names(arms, start: str) -> list[str]:
    return [arm.removeprefix(start) for arm in arms if arm.startswith(start)]


def preference_lines(trade: pd.DataFrame) -> list[str]:
    """A line a scenario: both objectives at preference 0, 0.5 and 1, and the last minus the first with 95 %."""
    rows = trade[trade.arm == SHIPPED].set_index(["scenario", "measure", "preference_a", "preference_b"])
    cells = []
    for scenario in rows.index.unique("scenario"):
        line = [scenario]
        for measure, (_, digits) in OBJECTIVES.items():
            half, whole = rows.loc[(scenario, measure, 0.0, 0.5)], rows.loc[(scenario, measure, 0.0, 1.0)]
            line.append(", ".join(format(value, digits) for value in (half.at_a, half.at_b, whole.at_b)))
            line.append(_change(whole, digits))
        cells.append(line)
    heads = [head for what, _ in OBJECTIVES.values() for head in (f"{what} at 0, 0.5, 1", "1 minus 0 (95 %)")]
    return markdown(["scenario", *heads], cells)


def _change(row, digits: str) -> str:
    low, high = format(row.low, "+" + digits), format(row.high, "+" + digits)
    return f"{format(row.difference, '+' + digits)} ({low} to {high})"


def band_lines(intervention: pd.DataFrame) -> list[str]:
    """A line a scenario: mean |v| on the same states, the battery's band at 100 and at 15 %, and the change."""
    rows = intervention[intervention.measure == BAND]
    cells = [[row.scenario, f"{row.at_100:.3f}", f"{row.at_15:.3f}", _change(row, ".3f")] for row in rows.itertuples()]
    return markdown(["scenario", "mean \\|v\\| at 100 % [m/s]", "at 15 %", "change (95 %)"], cells)
