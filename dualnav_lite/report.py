"""Tables as text: for a terminal and Markdown alike, and as LaTeX with booktabs for a thesis."""

import platform
from collections.abc import Mapping, Sequence

import pandas as pd

from dualnav_lite import __version__
from dualnav_lite.judge import BLIND, CEILING, FLOOR, PUBLISHED, beside_claim, bounds, is_kind
from dualnav_lite.scenario import all_scenarios

HEADER = ("scenario", "arm", "survived", "rate", "95 %", "article", "best blind arm", "ceiling", "clearance", "energy")
PAIRED_HEADER = ("scenario", "a", "b", "only a", "only b", "a - b", "95 %", "p (McNemar)")
NUMBERS = ("survived", "rate", "95 %", "article", "ceiling", "clearance", "energy", "only a", "only b", "a - b")


def percent(share: float, digits: int = 1) -> str:
    """A share as percent; empty where there is none."""
    return "" if pd.isna(share) else f"{100 * share:.{digits}f} %"


def survival_cells(table: pd.DataFrame, chosen: Sequence[str] | None = None) -> list[tuple[str, ...]]:
    """Cells under `HEADER`, one row per scenario and arm.

    Args:
        table: `survival.csv`, with the published rows, which the bounds are taken from.
        chosen: arms to show; None for those that were measured (all, where none was).
    """
    titles = {name: scenario.title for name, scenario in all_scenarios().items()}
    rows = table[table.source != PUBLISHED] if chosen is None else table[table.arm.isin(chosen)]
    cells: list[tuple[str, ...]] = []
    for row in (table if rows.empty and chosen is None else rows).itertuples():
        beside = bounds(table, row.scenario)
        blind, ceiling = beside.get("blind"), beside.get("ceiling")
        cells.append((
            titles.get(row.scenario, row.scenario),
            row.arm,
            f"{row.survived} of {row.episodes}",
            percent(row.survival_rate),
            f"{100 * row.wilson_low:.1f} to {100 * row.wilson_high:.1f}",
            percent(row.article_claim, 0),
            "" if blind is None else f"{percent(blind.survival_rate, 0)} {blind.arm.partition('@')[0]}",
            "" if ceiling is None else percent(ceiling.survival_rate),
            f"{row.mean_min_clearance_m:.2f} m",
            f"{row.mean_energy_j / 1000:.1f} kJ" if row.mean_energy_j > 10_000 else f"{row.mean_energy_j:.0f} J",
        ))  # fmt: skip
    return cells


def paired_cells(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """Cells under `PAIRED_HEADER`."""
    titles = {name: scenario.title for name, scenario in all_scenarios().items()}
    return [
        (
            titles.get(row.scenario, row.scenario),
            row.arm_a,
            row.arm_b,
            str(row.only_a),
            str(row.only_b),
            f"{100 * row.difference:+.1f}",
            f"{100 * row.low:+.1f} to {100 * row.high:+.1f}",
            f"{row.mcnemar_p:.2g}",
        )
        for row in table.itertuples()
    ]


def markdown(header: Sequence[str], cells: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table whose columns also line up in a terminal."""
    widths = [max(len(row[k]) for row in (header, *cells)) for k in range(len(header))]
    is_number = [name in NUMBERS for name in header]

    def line(row):
        cells = zip(row, widths, is_number, strict=True)
        parts = (text.rjust(width) if number else text.ljust(width) for text, width, number in cells)
        return "| " + " | ".join(parts) + " |"

    rule = ["-" * (w - 1) + (":" if number else "-") for w, number in zip(widths, is_number, strict=True)]
    return [line(header), line(rule), *(line(row) for row in cells)]


def latex(header: Sequence[str], cells: Sequence[Sequence[str]], caption: str, label: str) -> str:
    r"""A table for `\usepackage{booktabs}`."""
    columns = "".join("r" if name in NUMBERS else "l" for name in header)
    lines = [r"\begin{table}", r"\centering", rf"\caption{{{escaped(caption)}}}", rf"\label{{tab:{label}}}"]
    lines += [rf"\begin{{tabular}}{{{columns}}}", r"\toprule"]
    lines += [" & ".join(escaped(name) for name in header) + r" \\", r"\midrule"]
    lines += [" & ".join(escaped(text) for text in row) + r" \\" for row in cells]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""])


def escaped(text: str) -> str:
    r"""Text that LaTeX prints as it is.

    >>> print(escaped("92 % of wait_s & more"))
    92 \% of wait\_s \& more
    """
    plain = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    plain |= {character: "\\" + character for character in "&%$#_{}"}
    return "".join(plain.get(character, character) for character in text)


def survival_lines(table: pd.DataFrame, chosen: Sequence[str] | None = None) -> list[str]:
    """The survival table as lines of Markdown; arguments as in `survival_cells`."""
    return markdown(HEADER, survival_cells(table, chosen))


def verdict_lines(table: pd.DataFrame) -> list[str]:
    """A sentence for each measured row that the article makes a claim about."""
    titles, lines = {name: scenario.title for name, scenario in all_scenarios().items()}, []
    for row in table[table.source != PUBLISHED].itertuples():
        stands = beside_claim(row)
        if stands:
            word = {"beaten": "is beaten", "missed": "is missed", "open": "is not beaten with certainty"}[stands]
            if row.article_claim >= 1.0 and stands == "open":
                word = "is met by these runs, which a longer series may end"
            bounds = f"{percent(row.exact_low)} to {percent(row.exact_high)} (exact, 95 %)"
            lines.append(
                f"- {titles.get(row.scenario, row.scenario)}, `{row.arm}`: {row.survived} of {row.episodes}, {bounds}; "
                f"the article's {percent(row.article_claim, 0)} {word}."
            )
    return lines


def report(tables: Mapping[str, pd.DataFrame], command: str, failed: Sequence[tuple[str, str]]) -> str:
    """A page with the verdicts and what is needed to read and to repeat them."""
    table, strict = tables["survival"], tables["survival_strict"]
    measured = table[table.source != PUBLISHED]
    seeds = ", ".join(sorted({f"{row.seed_first} to {row.seed_last}" for row in measured.itertuples()}))
    machine = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    others = [arm for arm in table[table.source == PUBLISHED].arm.unique()]
    lines = ["# Stress test", "", f"`{command}`, kit {__version__}, {machine}. Seeds {seeds}; every arm runs the same."]
    if failed:
        lines += ["", "## Failed", "", *(f"- `{what}`: {reason}" for what, reason in failed)]
    lines += ["", "## Who survives", "", *survival_lines(table), ""]
    lines += [
        "Survived: goal reached in time, no contact, charge left. Interval: Wilson, 95 %. `article` is what the",
        "article claims for its own policy. Best blind arm: the best of those that know the goal's bearing and the",
        f"clock alone ({', '.join(BLIND)});",
        f"`{FLOOR}` is the floor, `{CEILING}` knows where everything is and how fast it moves. Clearance: mean",
        "over runs of the least distance of the hull from anything solid; energy: mean of a run. `ppo` drives with the",
        "guide's point on an A* path; of `ppo_filter` every command is also checked by the safety filter.",
    ]
    if not any(is_kind(arm, (*BLIND, CEILING, FLOOR)) for arm in table.arm):
        lines += ["", "No published row has one of these seeds, so blind arms and ceiling are missing here."]
    lines += ["", "## Against the article", "", *verdict_lines(table)]
    if len(strict):
        contacts = tables["episodes"].groupby(["scenario", "arm"]).contacts.sum()
        lines += ["", "## Three hours, no contact allowed", ""]
        lines += [
            f"- `{row.arm}`: {row.survived} of {row.episodes} without any contact"
            + (f", {contacts[row.scenario, row.arm]} contacts in all" if (row.scenario, row.arm) in contacts else "")
            for row in strict.itertuples()
        ]
    lines += ["", "## On the same seeds", "", *markdown(PAIRED_HEADER, paired_cells(tables["paired"]))]
    if others:
        lines += ["", "## Published arms, joined by seed", "", *survival_lines(table, others)]
    return "\n".join(lines).rstrip() + "\n"


def latex_tables(tables: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """`survival.tex` and `paired.tex` by file name."""
    runs = tables["survival"].episodes
    count = f"{runs.min()}" if runs.min() == runs.max() else f"{runs.min()} to {runs.max()}"
    survival_caption = (
        f"Survival with Wilson intervals, {count} runs a row; the article's claims are not measured here."
    )
    paired_caption = (
        "Arms on the same seeds: difference of rates in points with Newcombe's interval, exact McNemar test."
    )
    return {
        "survival.tex": latex(HEADER, survival_cells(tables["survival"]), survival_caption, "survival"),
        "paired.tex": latex(PAIRED_HEADER, paired_cells(tables["paired"]), paired_caption, "paired"),
    }
