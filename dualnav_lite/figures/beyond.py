"""Figures from beyond the kit's own world: traffic's front, a fleet with its cross-agent term, three learners."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualnav_lite.figures.sheet import COLOURS, MARKERS, QUIET, SMALL, Read, Sheet, Words


def _bars(axes, x, middle, low, high, **style) -> None:
    """Points with their intervals."""
    middle = np.asarray(middle, float)
    spread = np.maximum(np.stack([middle - np.asarray(low, float), np.asarray(high, float) - middle]), 0.0)
    axes.errorbar(x, middle, np.nan_to_num(spread), capsize=3, linewidth=1.6, markersize=7, **style)


def traffic(words: Words, read: Read) -> Figure:
    """Energy of a journey over the least gap: colour a training, marker a preference; a planner beside them."""
    table = read("traffic")
    sheet = Sheet(9.0, 5.0)
    axes = sheet.axes(1.0, 0.4, 5.2, 3.7)
    taught = table[table.training_seed.notna()]
    marker = dict(zip(sorted(taught.preference.unique()), MARKERS, strict=False))
    keys = []
    for k, ((arm, seed), points) in enumerate(table.groupby(["arm", "training_seed"], dropna=False, sort=False)):
        points, colour = points.sort_values("preference"), COLOURS[k % 4]
        axes.plot(points.safe_dist_m, points.energy_kj, color=colour)
        for row in points.itertuples():
            across = [[row.safe_dist_m - row.safe_low], [row.safe_high - row.safe_dist_m]]
            up = [[row.energy_kj - row.energy_low], [row.energy_high - row.energy_kj]]
            shape = "X" if pd.isna(seed) else marker[row.preference]
            axes.errorbar(
                row.safe_dist_m, row.energy_kj, up, across, color=colour, marker=shape, capsize=3, markersize=8
            )
        label = arm if pd.isna(seed) else words.row(arm, f"{words('training seed')} {int(seed)}")
        keys.append(Line2D([], [], color=colour, marker="X" if pd.isna(seed) else None, markersize=8, label=label))
    for preference, shape in marker.items():
        label = f"{words('preference')} {preference:g}"
        keys.append(Line2D([], [], color=QUIET, marker=shape, linestyle="", markersize=8, label=label))
    axes.set(xlabel=words("mean least gap to another car [m]"), ylabel=words("energy of a journey [kJ]"))
    axes.grid(True)
    axes.legend(handles=keys, loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=SMALL)
    return sheet.figure


def fleet(words: Words, read: Read) -> Figure:
    """Robots that arrive, and how far they were from where neighbours expected them, over the cross-agent weight."""
    table = read("fleet")
    sheet = Sheet(12.6, 4.9)
    left, right = sheet.axes(1.0, 0.4, 5.0, 3.3), sheet.axes(7.3, 0.4, 5.0, 3.3)
    for k, (robots, rows) in enumerate(table.groupby("robots")):
        # A little apart, so that intervals can be read.
        x = np.arange(len(rows)) + 0.08 * (k - 1)
        look = {"color": COLOURS[k % 4], "marker": MARKERS[k % 4], "label": words("{n} robots").format(n=robots)}
        rates = [100.0 * rows[name] for name in ("arrived_rate", "wilson_low", "wilson_high")]
        _bars(left, x, *rates, **look)
        _bars(right, x, rows.deviation_m, rows.deviation_low, rows.deviation_high, **look)
    for axes in (left, right):
        axes.set_xticks(range(table.cross_weight.nunique()), [f"{one:g}" for one in table.cross_weight.unique()])
        axes.set_xlabel(words("weight of the cross-agent term"))
        axes.grid(True, axis="y")
    left.set_ylabel(words("robots that arrived, 95 % interval [%]"))
    right.set_ylabel(words("off the predicted way [m]"))
    handles, labels = left.get_legend_handles_labels()
    sheet.figure.legend(handles, labels, loc="lower center", ncols=len(labels), fontsize=SMALL)
    return sheet.figure


def algorithms(words: Words, read: Read) -> Figure:
    """Survival, jitter and contacts while learning of PPO, DQN and SAC, a point a training seed."""
    table = read("algorithms")
    names = list(dict.fromkeys(table.algorithm))
    sheet = Sheet(13.2, 3.9)
    panels = (
        ("survived, 95 % interval [%]", "survival_rate", "wilson_low", "wilson_high", 100.0),
        ("acceleration, rms [m/s²]", "accel_rms", "accel_low", "accel_high", 1.0),
        ("turns the other way a second", "turns_a_second", "turns_low", "turns_high", 1.0),
        ("contacts while learning", "learning_collisions", "learning_collisions", "learning_collisions", 1.0),
    )
    for k, (text, middle, low, high, scale) in enumerate(panels):
        axes = sheet.axes(0.75 + 3.25 * k, 0.8, 2.4, 2.4)
        for j, name in enumerate(names):
            rows = table[table.algorithm == name]
            x = j + 0.15 * (np.arange(len(rows)) - 0.5 * (len(rows) - 1))
            values = [scale * rows[column] for column in (middle, low, high)]
            _bars(axes, x, *values, color=COLOURS[j % 4], marker=MARKERS[j % 4], linestyle="")
        axes.set_xticks(range(len(names)), [name.upper() for name in names])
        axes.set(xlim=(-0.6, len(names) - 0.4), ylim=(0, None))
        axes.set_title(words(text), fontsize=SMALL, fontweight="normal", loc="left")
        axes.grid(True, axis="y")
    return sheet.figure


# Name of a figure, the tables it needs, and who draws it; drawn where the table stands in the folder, or when asked.
BEYOND: dict[str, tuple[tuple[str, ...], Callable[[Words, Read], Figure]]] = {
    "traffic": (("traffic",), traffic),
    "fleet": (("fleet",), fleet),
    "algorithms": (("algorithms",), algorithms),
}
