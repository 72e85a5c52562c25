"""Figures of results: each a pure function of the tables in a results folder, or else of the published ones."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.figures import FORMATS, LANGUAGES, _check, _save, questions, runs, style_of
from dualnav_lite.figures.beyond import BEYOND
from dualnav_lite.figures.captions import caption_lines
from dualnav_lite.figures.sheet import COLOURS, MARKERS, QUIET, SMALL, Read, Sheet, Words
from dualnav_lite.figures.studies import ablations, studies
from dualnav_lite.judge import PUBLISHED, REFERENCE, bounds
from dualnav_lite.pareto import reference_point
from dualnav_lite.scenario import load_scenario

ARM_LOOK = {"ppo": 0, "ppo_filter": 1, "cv_sampling": 2, "orca": 3, "astar": 4, "rrtstar": 5, "ceiling": 6, "dwa": 7}


def look(arm: str, others: Sequence[str] = ()) -> tuple[str, str]:
    """(colour, marker) of an arm: the same in every figure."""
    name = arm.partition("@")[0]
    place = ARM_LOOK.get(name, (list(others).index(arm) if arm in others else 7) % len(COLOURS))
    return COLOURS[place], MARKERS[place]


def survival(words: Words, read: Read) -> Figure:
    """Rates with Wilson intervals, and beside them the article's claim, the best blind arm and the ceiling."""
    table = read("survival")
    shown = table[table.source != PUBLISHED] if (table.source != PUBLISHED).any() else table
    groups = [(name, group) for name, group in shown.groupby("scenario", sort=False)]
    row, second, title, head, foot = 0.36, 0.24, 0.46, 0.4, 1.35
    # An arm's knobs get a second line.
    height = len(shown) * row + shown.arm.str.contains("@").sum() * second + len(groups) * title
    sheet = Sheet(11.0, head + height + foot)
    axes = sheet.axes(4.2, head, 6.4, height)
    marks: dict[str, dict] = {
        "claim": {"color": COLOURS[3], "linestyle": (0, (4, 2))},
        "ceiling": {"color": QUIET, "linestyle": "-"},
        "blind": {"color": QUIET, "linestyle": (0, (1, 1.4))},
    }
    drawn: set[str] = set()
    y, labels, ticks = 0.0, [], []
    for name, group in groups:
        top, beside = y - 0.1, bounds(table, name)
        sheet.text(0.15, head + y + 0.24, words.title(load_scenario(name)), fontweight="bold")
        y += title
        for one in group.itertuples():
            colour, marker = look(one.arm)
            room = 0.5 * second * ("@" in one.arm)
            y += room
            axes.plot([one.wilson_low, one.wilson_high], [y, y], color=colour, linewidth=2.2, solid_capstyle="butt")
            axes.plot(one.survival_rate, y, marker, color=colour, markersize=8, clip_on=False, zorder=3)
            ticks.append(y)
            labels.append(words.row(one.arm.replace("@", "\n@"), f"n = {one.episodes}"))
            y += row + room
        low, high = top + 0.22, y - 0.5 * row
        claim = group.article_claim.iloc[0]
        rates = {kind: beside[kind].survival_rate for kind in ("blind", "ceiling") if kind in beside}
        for kind, rate in (rates | ({"claim": claim} if pd.notna(claim) else {})).items():
            axes.plot([rate, rate], [low, high], linewidth=2.0, **marks[kind])
            drawn.add(kind)
    axes.set(xlim=(0, 1.005), ylim=(height, 0), xlabel=words("survived, 95 % interval [%]"))
    axes.set_xticks(np.linspace(0, 1, 6), ["0", "20", "40", "60", "80", "100"])
    axes.set_yticks(ticks, labels)
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")
    texts = {"claim": "claimed in the article", "ceiling": "ceiling: knows the truth", "blind": "best blind arm"}
    keys = [Line2D([], [], linewidth=2.0, label=words(texts[kind]), **marks[kind]) for kind in texts if kind in drawn]
    if keys:
        sheet.figure.legend(handles=keys, loc="lower center", ncols=len(keys), fontsize=SMALL)
    return sheet.figure


def fronts(words: Words, read: Read) -> Figure:
    """Energy a goal over clearance, a panel a scenario, one line an arm through its preferences or knob settings."""
    table = read("pareto")
    table = table[np.isfinite(table.energy_j_per_goal)]
    names = list(dict.fromkeys(table.scenario))
    columns = min(2, len(names))
    rows = -(-len(names) // columns)
    sheet = Sheet(6.3 * columns + 0.5, 4.6 * rows + 0.7)
    arms = list(dict.fromkeys(table.arm))
    for k, name in enumerate(names):
        axes = sheet.axes(0.95 + 6.3 * (k % columns), 0.5 + 4.6 * (k // columns), 5.2, 3.3)
        for arm, points in table[table.scenario == name].groupby("arm", sort=False):
            colour, marker = look(arm, arms)
            points = points.sort_values("preference")
            axes.plot(points.safe_dist_m, points.energy_j_per_goal, color=colour, linewidth=1.2, alpha=0.6)
            best = points.pareto_optimal.astype(bool)
            for chosen, face in ((points[best], colour), (points[~best], "white")):
                axes.plot(
                    chosen.safe_dist_m, chosen.energy_j_per_goal, marker, color=colour, markerfacecolor=face,
                    markersize=7,
                )  # fmt: skip
        axes.set_title(words.title(load_scenario(name)), loc="left")
        axes.set(xlabel=words("mean least clearance [m]"), ylabel=words("energy a goal [J]"))
        dearest = reference_point(name)[1]
        energies = table.energy_j_per_goal[table.scenario == name]
        if (beyond := int((energies > dearest).sum())) and beyond < len(energies):
            least = energies.min()
            axes.set_ylim(least - 0.05 * (dearest - least), dearest)
            note = words("{n} points lie above, beyond the reference point").format(n=beyond)
            axes.text(0.98, 0.96, note, transform=axes.transAxes, ha="right", va="top", fontsize=SMALL, color=QUIET)
        axes.locator_params(nbins=6)
        axes.grid(True)
    keys = [Line2D([], [], color=look(a, arms)[0], marker=look(a, arms)[1], markersize=7, label=a) for a in arms]
    keys.append(Line2D([], [], color=QUIET, marker="o", linestyle="", markersize=7, label=words("on the joint front")))
    sheet.figure.legend(handles=keys, loc="lower center", ncols=min(len(keys), 6), fontsize=SMALL)
    return sheet.figure


def cloud(words: Words, read: Read) -> Figure:
    """The article's view: every run that arrived as a point, those that no other run of its arm dominates filled."""
    table = read("pareto_episodes")
    table = table[table.scenario.map(lambda name: load_scenario(name).dispatcher is None)]
    names, arms = list(dict.fromkeys(table.scenario)), list(dict.fromkeys(table.arm))[:3]
    columns = min(2, len(names))
    rows = -(-len(names) // columns)
    sheet = Sheet(6.3 * columns + 0.5, 4.4 * rows + 1.0)
    for k, name in enumerate(names):
        axes = sheet.axes(0.95 + 6.3 * (k % columns), 0.5 + 4.4 * (k // columns), 5.2, 3.1)
        for arm in arms:
            points = table[(table.scenario == name) & (table.arm == arm)]
            colour, marker = look(arm, arms)
            axes.plot(points.safe_dist_m, points.energy_j, marker, color=colour, markersize=3, alpha=0.35, mew=0)
            best = points[points.pareto_optimal.astype(bool)].sort_values("safe_dist_m")
            axes.step(best.safe_dist_m, best.energy_j, color=colour, where="pre", linewidth=1.0)
            axes.plot(best.safe_dist_m, best.energy_j, marker, color=colour, markersize=7)
        axes.set_title(words.title(load_scenario(name)), loc="left")
        axes.set(xlabel=words("least clearance of a run [m]"), ylabel=words("energy of a run [J]"))
        axes.locator_params(nbins=6)
        axes.grid(True)
    keys = [Line2D([], [], color=look(a, arms)[0], marker=look(a, arms)[1], markersize=7, label=a) for a in arms]
    sheet.figure.legend(handles=keys, loc="lower center", ncols=len(keys), fontsize=SMALL)
    return sheet.figure


def latency(words: Words, read: Read) -> Figure:
    """Wall-clock of each stage of a control step, and how many ticks the first answer to a pop-up takes."""
    table = read("latency")
    stages = table[table.stage != "response_ticks"]
    sheet = Sheet(12.6, 4.8)
    axes = sheet.axes(1.5, 0.5, 5.6, 3.4)
    y = np.arange(len(stages))
    for column, colour, marker in (
        ("p50_ms", COLOURS[0], "o"),
        ("p95_ms", COLOURS[2], "^"),
        ("p99_ms", COLOURS[1], "s"),
    ):
        axes.plot(stages[column], y, marker, color=colour, markersize=8, label=column.removesuffix("_ms"))
    axes.hlines(y, stages.p50_ms, stages.p99_ms, color=QUIET, linewidth=1.2, zorder=0)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_yticks(y, [words(stage) for stage in stages.stage])
    axes.set(ylim=(len(stages) - 0.4, -0.6), xlabel=words("time of a control step [ms]"))
    axes.grid(True, axis="x")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    ticks = read("response_ticks")
    right = sheet.axes(8.1, 0.5, 4.2, 3.4)
    counts = ticks.ticks.clip(upper=20).value_counts(normalize=True).sort_index()
    right.bar(counts.index, 100 * counts.to_numpy(), color=COLOURS[0], width=0.8)
    right.set_axisbelow(True)
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.axvline(2.5, color=COLOURS[3], linestyle=(0, (4, 2)), linewidth=2.0, label=words("article: 200 ms"))
    right.set(xlabel=words("ticks of 0.1 s until the command changes"), ylabel=words("share of runs [%]"))
    right.grid(True, axis="y")
    right.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return sheet.figure


def battery_hours(words: Words, read: Read) -> Figure:
    """Charge over three hours of each arm, and goals reached."""
    table = read("battery_trace")
    sheet = Sheet(12.6, 5.0)
    left, right = sheet.axes(0.95, 0.4, 5.2, 3.6), sheet.axes(7.2, 0.4, 5.0, 3.6)
    arms = list(dict.fromkeys(table.arm))
    for arm, run in table.groupby("arm", sort=False):
        style: dict[str, Any] = {"color": look(arm, arms)[0], "linewidth": 2.2, "label": arm}
        alike = [one for one in arms[: arms.index(arm)] if look(one, arms)[0] == style["color"]]
        style["linestyle"] = (0, (2, 1.2)) if alike else "-"  # one planner at two speeds
        left.plot(run.time_s / 60, 100 * run.battery, **style)
        right.plot(run.time_s / 60, run.goals, **style)
    left.axhline(15, color=QUIET, linestyle=(0, (4, 2)), linewidth=1.6)
    left.set(xlabel=words("time [min]"), ylabel=words("charge [%]"), xlim=(0, 180), ylim=(0, 100))
    right.axhline(520, color=QUIET, linestyle=(0, (4, 2)), linewidth=1.6)
    right.set(xlabel=words("time [min]"), ylabel=words("goals reached"), xlim=(0, 180), ylim=(0, None))
    for axes in (left, right):
        axes.set_xticks(range(0, 181, 30))
        axes.grid(True)
    handles, labels = left.get_legend_handles_labels()
    sheet.figure.legend(handles, labels, loc="lower center", ncols=len(labels), fontsize=SMALL)
    return sheet.figure


Known = dict[str, tuple[tuple[str, ...], Callable[[Words, Read], Figure | None]]]
# Name of a figure, the tables it needs, and who draws it: None where they hold nothing that it could show.
RESULTS: Known = {
    "survival": (("survival",), survival),
    "fronts": (("pareto",), fronts),
    "runs": (("pareto_episodes",), cloud),
    "latency": (("latency", "response_ticks"), latency),
    "battery_hours": (("battery_trace",), battery_hours),
    "ablations": (("ablations",), ablations),
    "intervention": (("intervention",), questions.intervention),
    "perturbed": (("perturbed_front",), questions.perturbed),
    "failures": (("failure_search",), questions.failures),
    "trajectories": ((), lambda words, read: runs.trajectories(words)),
    "reward_terms": ((), lambda words, read: runs.reward_terms(words)),
}

# Drawn where its table stands in the folder, or when asked: a report of the stress scenarios has no use for these.
APART: Known = {**BEYOND, "studies": (("studies",), studies)}


def table_path(name: str, results: Path, reference: Path = REFERENCE) -> Path | None:
    """Where a table stands: in the results, or else among the published ones; None if nowhere."""
    places = (results / f"{name}.csv", reference / f"{name}.csv", reference / "beyond" / f"{name}.csv")
    return next((path for path in places if path.exists()), None)


def make_result_figures(
    results: str | Path,
    language: str = "en",
    formats: Sequence[str] = FORMATS,
    names: Sequence[str] | None = None,
    reference: Path = REFERENCE,
    out: str | Path | None = None,
) -> list[Path]:
    """Draw every figure whose tables exist into a folder, with `captions.md` beside them.

    Args:
        results: folder with the tables of `judge.judge_folder` or of a measurement.
        language: "en" or "zh"; formats: of `figures.FORMATS`; names: of `RESULTS` and `APART`, None for all that can
            be drawn.
        reference: where a table is looked for that `results` lacks.
        out: the folder; `<results>/figures` if None.

    Raises:
        UnusableInput: an unknown name, language or format, a font or a table that is missing.
    """
    results = Path(results)
    folder = Path(out) if out else results / "figures"
    known = RESULTS | APART
    _check(names or (), known, "figure of results")
    _check([language], LANGUAGES, "language")
    _check(formats, FORMATS, "format")

    def read(name: str) -> pd.DataFrame:
        return pd.read_csv(table_path(name, results, reference), encoding="utf-8")

    written, drawn = [], []
    with matplotlib.rc_context(style_of(language)):
        own = [name for name in APART if (results / f"{name}.csv").exists()]
        for name in names or [*RESULTS, *own]:
            needed, draw = known[name]
            missing = [table for table in needed if table_path(table, results, reference) is None]
            if missing and names:
                raise UnusableInput(f"figure '{name}' needs {missing[0]}.csv, which is not in {results}")
            if missing or (needed and read(needed[0]).empty):
                continue
            figure, ending = draw(Words(language), read), ".zh" if language == "zh" else ""
            if figure is None:
                if names:
                    raise UnusableInput(f"figure '{name}': {needed[0]}.csv holds nothing that it could show")
                continue
            drawn.append(name)
            written += [_save(figure, folder, f"{name}{ending}.{kind}", kind) for kind in formats]
    write_atomic(folder / f"captions{'.zh' if language == 'zh' else ''}.md", caption_lines(drawn, language))
    return written
