"""Figure of the studies: what each variant of a training reached, a stroke a training seed."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualnav_lite.figures.sheet import COLOURS, MARKERS, SMALL, Read, Sheet, Words
from dualnav_lite.scenario import load_scenario
from dualnav_lite.study_tables import summarise

LINE, GAP = 0.6, 0.75  # inches: a variant, and what a study's title takes
APART = 0.24  # of a line, between the scenarios of a variant


def studies(words: Words, read: Read) -> Figure:
    """A panel a study with several training seeds: strokes are seeds, a mark is their mean with its interval."""
    rows = read("studies")
    rows = rows[rows.groupby("study").training_seed.transform("nunique") > 1]
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
    axes.set(xlim=(0, 100), ylim=(len(variants) - 0.5, -0.5))
    axes.set_title(name, fontsize=SMALL, loc="left")
    axes.grid(True, axis="x")
