"""Tables as text: for a terminal, as Markdown, and as LaTeX with booktabs for a thesis."""

from collections.abc import Mapping, Sequence

import pandas as pd

from dualnav_lite.judge import PUBLISHED, beside_claim, bounds
from dualnav_lite.scenario import all_scenarios

HEADER = (
    "scenario", "arm", "survived", "rate", "95 %", "article", "floor", "best blind arm", "ceiling", "clearance",
    "energy",
)  # fmt: skip
PAIRED_HEADER = ("scenario", "a", "b", "only a", "only b", "a - b", "95 %", "p (McNemar)")
NUMBERS = (
    "survived", "rate", "95 %", "article", "floor", "ceiling", "clearance", "energy", "only a", "only b", "a - b",
    "p (McNemar)",
)  # fmt: skip
STANDS = {"beaten": "beaten", "missed": "missed", "open": "open", "met": "met so far"}


def percent(share: float, digits: int = 1) -> str:
    """A share as percent; empty where there is none."""
    return "" if pd.isna(share) else f"{100 * share:.{digits}f} %"


def titles(language: str = "en") -> dict[str, str]:
    """Name of each scenario by id, "en" or "zh"."""
    return {name: one.title if language == "en" else one.title_zh for name, one in all_scenarios().items()}


def rate_beside(row, digits: int = 0) -> str:
    """A floor, blind arm's or ceiling's rate; empty where there is none."""
    return "" if row is None else percent(row.survival_rate, digits)


def energy_text(joules: float) -> str:
    """Energy of a run in a unit that can be read.

    >>> energy_text(236.4), energy_text(134_900), energy_text(float("nan"))
    ('236 J', '134.9 kJ', '')
    """
    if pd.isna(joules):
        return ""
    return f"{joules / 1000:.1f} kJ" if joules > 10_000 else f"{joules:.0f} J"


def measured_rows(table: pd.DataFrame, chosen: Sequence[str] | None = None) -> pd.DataFrame:
    """Rows of a survival table to show: of these arms, or else those that were measured (all, where none was)."""
    rows = table[table.source != PUBLISHED] if chosen is None else table[table.arm.isin(chosen)]
    return table if rows.empty and chosen is None else rows


def survival_cells(
    table: pd.DataFrame, chosen: Sequence[str] | None = None, language: str = "en"
) -> list[tuple[str, ...]]:
    """Cells under `HEADER`, one row per scenario and arm.

    Args:
        table: `survival.csv`, with the published rows, which the bounds are taken from.
        chosen: as in `measured_rows`.
    """
    names, cells = titles(language), list[tuple[str, ...]]()
    for row in measured_rows(table, chosen).itertuples():
        beside = bounds(table, row.scenario)
        blind = beside.get("blind")
        cells.append((
            names.get(row.scenario, row.scenario),
            row.arm,
            f"{row.survived} / {row.episodes}",
            percent(row.survival_rate),
            f"{100 * row.wilson_low:.1f} - {100 * row.wilson_high:.1f}",
            percent(row.article_claim, 0),
            rate_beside(beside.get("floor")),
            "" if blind is None else f"{rate_beside(blind)} {blind.arm.partition('@')[0]}",
            rate_beside(beside.get("ceiling"), 1),
            f"{row.mean_min_clearance_m:.2f} m",
            energy_text(row.mean_energy_j),
        ))  # fmt: skip
    return cells


def terminal_lines(table: pd.DataFrame, strict: pd.DataFrame | None = None) -> list[str]:
    """Who survived, for a screen: a block a scenario, what its rates are read beside in the first line.

    Args:
        table, strict: `survival.csv` and, of three-hour runs without any contact, `survival_strict.csv`.
    """
    rows, names = measured_rows(table), titles()
    width = max([len("arm"), *rows.arm.str.len()])
    head = f"  {'arm':{width}}  {'survived':>12}  {'rate':>7}  {'95 % interval':>13}  {'clearance':>9}  {'energy':>8}"
    lines = [f"{head}  article's rate is"]
    for scenario, group in rows.groupby("scenario", sort=False):
        beside, claim = bounds(table, scenario), group.article_claim.iloc[0]
        blind = beside.get("blind")
        said = [] if pd.isna(claim) else [f"article {percent(claim, 0)}"]
        said += [f"floor {rate_beside(beside['floor'])}"] if "floor" in beside else []
        said += [] if blind is None else [f"best blind arm {rate_beside(blind)} ({blind.arm.partition('@')[0]})"]
        said += [f"ceiling {rate_beside(beside['ceiling'], 1)}"] if "ceiling" in beside else []
        lines += ["", names.get(scenario, scenario) + (": " + ", ".join(said) if said else "")]
        for row in group.itertuples():
            interval = f"{100 * row.wilson_low:.1f} - {100 * row.wilson_high:.1f}"
            lines.append(
                f"  {row.arm:{width}}  {f'{row.survived} / {row.episodes}':>12}  {percent(row.survival_rate):>7}  "
                f"{interval:>13}  {row.mean_min_clearance_m:>7.2f} m  {energy_text(row.mean_energy_j):>8}  "
                f"{STANDS.get(stands(row), '')}".rstrip()
            )
        for row in () if strict is None else strict[strict.scenario == scenario].itertuples():
            if row.source != PUBLISHED:
                lines.append(f"  {row.arm:{width}}  {f'{row.survived} / {row.episodes}':>12}  without any contact")
    told = "beaten, missed: the exact 95 % interval lies above, below the article's rate; open: it holds it"
    return [*lines, "", told] if rows.article_claim.notna().any() else lines


def stands(row) -> str:
    """How a row stands to the article's rate, as `STANDS` names it; of 100 %, which cannot be beaten: "met"."""
    found = beside_claim(row) or ""
    return "met" if found == "open" and row.article_claim >= 1.0 else found


def paired_cells(table: pd.DataFrame, language: str = "en") -> list[tuple[str, ...]]:
    """Cells under `PAIRED_HEADER`."""
    names, to = titles(language), {"en": "to", "zh": "至"}[language]
    return [
        (
            names.get(row.scenario, row.scenario),
            row.arm_a,
            row.arm_b,
            str(row.only_a),
            str(row.only_b),
            f"{100 * row.difference:+.1f}",
            f"{100 * row.low:+.1f} {to} {100 * row.high:+.1f}",
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
    r"""A table as wide as the text; a first column that repeats is said once. Needs `booktabs` and `graphicx`."""
    columns = "".join("r" if name in NUMBERS else "l" for name in header)
    lines = [r"% \usepackage{booktabs,graphicx}", r"\begin{table}", r"\centering", rf"\caption{{{escaped(caption)}}}"]
    lines += [
        rf"\label{{tab:{label}}}",
        r"\resizebox{\textwidth}{!}{%",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
    ]
    lines += [" & ".join(escaped(name) for name in header) + r" \\", r"\midrule"]
    before = None
    for first, *others in cells:
        lines.append(" & ".join(escaped(text) for text in ("" if first == before else first, *others)) + r" \\")
        before = first
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}}", r"\end{table}", ""])


def escaped(text: str) -> str:
    r"""Text that LaTeX prints as it is.

    >>> print(escaped("92 % of wait_s & more"))
    92 \% of wait\_s \& more
    """
    plain = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    plain |= {character: "\\" + character for character in "&%$#_{}"}
    return "".join(plain.get(character, character) for character in text)


def survival_lines(table: pd.DataFrame) -> list[str]:
    """The survival table as lines of Markdown."""
    return markdown(HEADER, survival_cells(table))


def text_tables(tables: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """`survival` and `paired` as LaTeX and as Markdown, by file name."""
    runs = tables["survival"].episodes
    count = f"{runs.min()}" if runs.min() == runs.max() else f"{runs.min()} to {runs.max()}"
    survived, pairs = survival_cells(tables["survival"]), paired_cells(tables["paired"])
    survival_caption = f"Survival with Wilson intervals (95 %), {count} runs a row; the article's rates are its own."
    paired_caption = (
        "Arms on the same seeds: difference of rates in points with Newcombe's interval, exact McNemar test."
    )
    return {
        "survival.tex": latex(HEADER, survived, survival_caption, "survival"),
        "paired.tex": latex(PAIRED_HEADER, pairs, paired_caption, "paired"),
        "survival.md": "\n".join(markdown(HEADER, survived)) + "\n",
        "paired.md": "\n".join(markdown(PAIRED_HEADER, pairs)) + "\n",
    }


def frame_texts(name: str, frame: pd.DataFrame) -> dict[str, str]:
    """Any table as `<name>.tex` and `<name>.md`, numbers to four digits."""
    cells = [
        tuple("" if pd.isna(value) else f"{value:.4g}" if isinstance(value, float) else str(value) for value in row)
        for row in frame.itertuples(index=False)
    ]
    header = tuple(map(str, frame.columns))
    return {
        f"{name}.tex": latex(header, cells, name.replace("_", " "), name),
        f"{name}.md": "\n".join(markdown(header, cells)) + "\n",
    }
