"""Figures of what the variants of a training reached: ablations, and studies of several training seeds."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualnav_lite.chunks import ABLATION
from dualnav_lite.figures.sheet import COLOURS, MARKERS, SMALL, Read, Sheet, Words
from dualnav_lite.judge import ABLATION_DEFAULT
from dualnav_lite.scenario import load_scenario
from dualnav_lite.study_tables import summarise

LINE, GAP = 0.6, 0.75  # inches: a variant, and what a study's title takes
APART = 0.24  # of a line, between the scenarios of a variant


def ablations(words: Words, read: Read) -> Figure:
    """Rate of each ablation beside `ablation_default`, trained alike, with intervals."""
    table = read("ablations")
    names = list(dict.fromkeys(table.scenario))
    arms = sorted(table.arm.unique(), key=lambda arm: (arm != ABLATION_DEFAULT, arm))
    columns, height = min(len(names), 5), 0.42 * len(arms)
    lines, width = -(-len(names) // columns), 9.2 / columns
    sheet = Sheet(12.6, (height + 1.4) * lines + 0.6)
    for k, name in enumerate(names):
        place = 3.1 + width * (k % columns), 0.9 + (height + 1.4) * (k // columns)
        axes = sheet.axes(*place, width - 0.45, height)
        for y, arm in enumerate(arms):
            for one in table[(table.scenario == name) & (table.arm == arm)].itertuples():
                is_default = arm == ABLATION_DEFAULT
                style: dict[str, Any] = {"color": COLOURS[1 if is_default else 0], "clip_on": False}
                axes.plot([one.wilson_low, one.wilson_high], [y, y], linewidth=2.0, **style)
                axes.plot(one.survival_rate, y, "s" if is_default else "o", markersize=7, **style)
        title = textwrap.fill(words.title(load_scenario(name)), 15)  # five panels leave each little room
        axes.set_title(title, fontsize=SMALL, loc="left", fontweight="normal")
        axes.set(xlim=(0, 1.02), ylim=(len(arms) - 0.4, -0.6))
        axes.set_xticks([0, 0.5, 1], ["0", "50", "100"])
        axes.set_yticks(range(len(arms)), [arm.removeprefix(ABLATION) for arm in arms] if k % columns == 0 else [])
        axes.grid(True, axis="x")
    sheet.text(5.2, (height + 1.4) * lines + 0.3, words("survived, 95 % interval [%]"))
    return sheet.figure


def studies(words: Words, read: Read) -> Figure | None:
    """A panel a study with several training seeds: strokes are seeds, a mark is their mean with its interval."""
    rows = read("studies")
    rows = rows[rows.groupby("study").training_seed.transform("nunique") > 1]
    if rows.empty:
        return None
    scenarios = list(dict.fromkeys(rows.scenario))
    panels = [(name, group) for name, group in rows.groupby("study", sort=False)]
    half = sum(GAP + LINE * group.variant.nunique() for _, group in panels) / 2
    tops, column, top = [], 0, 0.0
    for _, group in panels:
        tops.append((column, top))
        top += GAP + LINE * group.variant.nunique()
        if column == 0 and top >= half:
            column, deepest, top = 1, top, 0.0
    sheet = Sheet(13.4, max(deepest if column else top, top) + 1.7)
    for (name, group), (column, top) in zip(panels, tops, strict=True):
        _panel(sheet.axes(2.6 + 6.6 * column, top + 0.6, 3.9, LINE * group.variant.nunique()), name, group, scenarios)
    keys = [
        Line2D([], [], color=COLOURS[k], marker=MARKERS[k], linestyle="", label=words.title(load_scenario(name)))
        for k, name in enumerate(scenarios)
    ]
    sheet.figure.legend(handles=keys, loc="lower center", ncols=4, fontsize=SMALL)
    sheet.figure.supxlabel(
        words("survived, 95 % interval [%]"), fontsize=SMALL + 1, y=0.9 / sheet.figure.get_figheight()
    )
    return sheet.figure


def _panel(axes, name, rows, scenarios) -> None:
    """One study: variants from top to bottom, within each its scenarios a little apart."""
    variants, judged = list(dict.fromkeys(rows.variant)), [one for one in scenarios if one in set(rows.scenario)]
    means = summarise(rows).set_index(["variant", "scenario"])
    for y, variant in enumerate(variants):
        for j, scenario in enumerate(judged):
            height, k = y + APART * (j - 0.5 * (len(judged) - 1)), scenarios.index(scenario)
            seeds = 100 * rows[(rows.variant == variant) & (rows.scenario == scenario)].survival_rate
            look = {"color": COLOURS[k], "linestyle": "", "clip_on": False}
            axes.plot(seeds, np.full(len(seeds), height), marker="|", markersize=11, alpha=0.6, **look)
            mean = means.loc[(variant, scenario)]
            axes.hlines(height, 100 * mean.low, 100 * mean.high, color=COLOURS[k], linewidth=1.6)
            axes.plot(100 * mean.mean_rate, height, marker=MARKERS[k], markersize=7, **look)
    axes.set_yticks(range(len(variants)), variants)
    least = 100 * min(rows.survival_rate.min(), means.low.min())
    axes.set(xlim=(max(0, 20 * ((least - 2) // 20)), 100), ylim=(len(variants) - 0.5, -0.5))
    axes.set_title(name, fontsize=SMALL, loc="left")
    axes.grid(True, axis="x")
