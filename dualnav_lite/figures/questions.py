"""Figures of what is asked of the policy: its battery band, its changed commands, settings in which it fails."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualnav_lite.figures.sheet import QUIET, SMALL, Read, Sheet, Words
from dualnav_lite.metrics import wilson_interval
from dualnav_lite.scenario import load_scenario

METHODS = {"none": ("#000000", "X"), "random": ("#e69f00", "s"), "evolution": ("#0072b2", "o")}


def intervention(words: Words, read: Read) -> Figure:
    """Difference between 15 and 100 % of charge: a panel a measure, a row a scenario, with intervals."""
    table = read("intervention")
    measures, scenarios = list(dict.fromkeys(table.measure)), list(dict.fromkeys(table.scenario))
    columns, height = 3, 0.42 * len(scenarios) + 0.2
    sheet = Sheet(13.4, (height + 1.45) * (-(-len(measures) // columns)) + 0.6)
    for k, measure in enumerate(measures):
        axes = sheet.axes(2.9 + 3.5 * (k % columns), 0.8 + (height + 1.45) * (k // columns), 3.0, height)
        rows = table[table.measure == measure].set_index("scenario").reindex(scenarios)
        y = np.arange(len(rows))
        axes.hlines(y, rows.low, rows.high, color="#0072b2", linewidth=2.2)
        axes.plot(rows.difference, y, "o", color="#0072b2", markersize=7)
        axes.axvline(0.0, color=QUIET, linewidth=1.2)
        names = [words.title(load_scenario(name)) for name in scenarios] if k % columns == 0 else []
        axes.set_yticks(y if names else [], names)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.locator_params(axis="x", nbins=4)
        axes.set_title(textwrap.fill(words(measure), 24), fontsize=SMALL, fontweight="normal", loc="left")
        axes.grid(True, axis="x")
    sheet.figure.supxlabel(words("15 % minus 100 % of charge, 95 % interval"), fontsize=SMALL + 1, y=0.01)
    return sheet.figure


def perturbed(words: Words, read: Read) -> Figure:
    """Points that were searched (left) and the fronts' points on fresh seeds (right), a row a scenario."""
    table = read("perturbed_front")
    table = table[np.isfinite(table.energy_j_per_goal)]
    names = list(dict.fromkeys(table.scenario))
    sheet = Sheet(12.9, 4.5 * len(names) + 0.8)
    for k, name in enumerate(names):
        panels = [sheet.axes(0.95 + 6.3 * j, 0.6 + 4.5 * k, 5.3, 3.1) for j in (0, 1)]
        for method, points in table[table.scenario == name].groupby("method", sort=False):
            colour, marker = METHODS[method]
            style: dict[str, Any] = {"color": colour, "linestyle": "", "marker": marker, "mew": 0}
            best = points[points.pareto_optimal.astype(bool)].sort_values("safe_dist_m")
            panels[0].plot(points.safe_dist_m, points.energy_j_per_goal, markersize=3.5, alpha=0.4, **style)
            panels[0].plot(best.safe_dist_m, best.energy_j_per_goal, markersize=8, **style)
            panels[1].plot(best.fresh_safe_dist_m, best.fresh_energy_j_per_goal, markersize=8, **style)
        for axes, text in zip(panels, ("on the seeds of the search", "the same points on fresh seeds"), strict=True):
            axes.set_title(words.row(words.title(load_scenario(name)), words(text)), fontsize=SMALL, loc="left")
            axes.set(xlabel=words("mean least clearance [m]"), ylabel=words("energy a goal [J]"))
            axes.locator_params(nbins=6)
            axes.grid(True)
    keys = [
        Line2D([], [], linestyle="", marker=METHODS[name][1], color=METHODS[name][0], markersize=8, label=words(text))
        for name, text in (
            ("none", "policy as it is"), ("random", "random search"), ("evolution", "differential evolution"),
        )
    ]  # fmt: skip
    sheet.figure.legend(handles=keys, loc="lower center", ncols=3, fontsize=SMALL)
    return sheet.figure


def failures(words: Words, read: Read) -> Figure:
    """Failure rates: of the scenario as it is, over each search, and in the worst settings that it found."""
    table = read("failure_search")
    sheet = Sheet(12.0, 1.5 + 0.45 * (len(table) + 2 * table.scenario.nunique()))
    axes = sheet.axes(4.6, 0.5, 6.9, 0.45 * (len(table) + 2 * table.scenario.nunique()) - 0.3)
    labels, ticks, y = [], [], 0.0
    looks = {"default": ("#000000", "X"), "search": ("#e69f00", "s"), "fresh": ("#d55e00", "o")}

    def rate(kind: str, failed: int, count: int, height: float) -> None:
        low, high = wilson_interval(failed, count)
        axes.plot([100 * low, 100 * high], [height, height], color=looks[kind][0], linewidth=2.0)
        axes.plot(100 * failed / count, height, looks[kind][1], color=looks[kind][0], markersize=8, clip_on=False)

    for name, rows in table.groupby("scenario", sort=False):
        sheet.text(0.15, 0.5 + 0.45 * (y + 0.75), words.title(load_scenario(name)), fontweight="bold")
        first = rows.iloc[0]
        rate("default", first.default_failures_on_fresh, first.fresh_episodes, y + 1.0)
        labels.append(words("as it is"))
        ticks.append(y + 1.0)
        for row in rows.itertuples():
            y += 1.0
            rate("search", row.failures, row.episodes, y + 0.85)
            rate("fresh", row.fresh_failures, row.fresh_episodes, y + 1.15)
            labels.append(words("differential evolution" if row.method == "evolution" else "random search"))
            ticks.append(y + 1.0)
        y += 2.0
    axes.set_yticks(ticks, labels)
    axes.set(ylim=(y - 0.4, 0.3), xlim=(0, None), xlabel=words("failed, 95 % interval [%]"))
    axes.grid(True, axis="x")
    texts = {
        "default": "scenario as it is",
        "search": "all settings of a search",
        "fresh": "worst settings, fresh seeds",
    }
    keys = [
        Line2D([], [], linestyle="", marker=looks[kind][1], color=looks[kind][0], markersize=8, label=words(text))
        for kind, text in texts.items()
    ]
    sheet.figure.legend(handles=keys, loc="lower center", ncols=3, fontsize=SMALL)
    return sheet.figure
