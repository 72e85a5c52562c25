"""What the studies of `training/studies` found, from their rows alone: summaries, differences, `docs/STUDIES.md`."""

from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite.config import ROOT, read_yaml
from dualnav_lite.judge import REFERENCE
from dualnav_lite.metrics import t_interval
from dualnav_lite.report import markdown

FOLDER = ROOT / "training" / "studies"
PUBLISHED = REFERENCE / "studies.csv"
KEY = ["study", "variant", "training_seed", "scenario"]
COLUMNS = [
    *KEY, "episodes", "survived", "survival_rate", "wilson_low", "wilson_high", "collisions", "timeouts",
    "mean_min_clearance_m", "mean_energy_j", "train_steps",
]  # fmt: skip
SUMMARY = [
    "study", "variant", "scenario", "runs", "mean_rate", "low", "high", "deviation", "coefficient_of_variation",
    "difference", "difference_low", "difference_high",
]  # fmt: skip
STABILITY = ["question", "difference", "low", "high", "n"]
# Contrasts of the study `stability`: what is said to be steadier, and beside what.
CONTRASTS = {
    "article_choice": (["returns_015"], ["gae_020"]),
    "returns": (["returns_015", "returns_020"], ["gae_015", "gae_020"]),
    "clip_015": (["gae_015", "returns_015"], ["gae_020", "returns_020"]),
}
DRAWS = 4000


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per variant and scenario: mean survival over training seeds, its t interval, and how much seeds differ.

    `coefficient_of_variation` is the deviation across training seeds over their mean: the studies' measure of
    stability. One seed has neither interval nor deviation. `difference` is to the study's first variant, training seed
    by training seed.
    """
    table = []
    first = {study: group.variant.iloc[0] for study, group in rows.groupby("study", sort=False)}
    rates = rows.set_index(["study", "variant", "scenario", "training_seed"]).survival_rate.astype(float).sort_index()
    for (study, variant, scenario), group in rows.groupby(["study", "variant", "scenario"], sort=False):
        own = rates[study, variant, scenario]
        mean, low, high = t_interval(own)
        deviation = own.std(ddof=1)
        spread = deviation / mean if mean > 0 else np.nan
        gaps = (own - rates[study, first[study], scenario]).dropna()
        difference = t_interval(gaps) if variant != first[study] and len(gaps) else (np.nan,) * 3
        measured = [len(group), mean, max(low, 0.0), min(high, 1.0), deviation, spread]
        table.append([study, variant, scenario, *measured, *difference])
    return pd.DataFrame(table, columns=SUMMARY)


def stability(rows: pd.DataFrame) -> pd.DataFrame:
    """Each of `CONTRASTS`: by what share the coefficient of variation across training seeds falls, with 95 %.

    Variants on one side are averaged. The interval is a bootstrap over training seeds, drawn once for all variants.

    Returns:
        Columns `STABILITY`; `difference` 0.42 reads "42 % more stable".
    """
    rates = rows.pivot(index="training_seed", columns="variant", values="survival_rate").astype(float)
    values, n = rates.to_numpy(), len(rates)
    drawn = values[np.random.default_rng(0).integers(n, size=(DRAWS, n))]
    found = []
    with np.errstate(divide="ignore", invalid="ignore"):  # a draw of one seed, many times, does not vary
        for question, sides in CONTRASTS.items():
            better, worse = (rates.columns.get_indexer(side) for side in sides)
            measured, falls = (
                1.0 - spread[..., better].mean(axis=-1) / spread[..., worse].mean(axis=-1)
                for spread in (_variation(values), _variation(drawn))
            )
            found.append([question, measured, *np.nanpercentile(falls, [2.5, 97.5]), n])
    return pd.DataFrame(found, columns=STABILITY)


def _variation(rates) -> np.ndarray:
    """Coefficient of variation over the second axis from the end, the training seeds."""
    return rates.std(axis=-2, ddof=1) / rates.mean(axis=-2)


def read_studies(path: Path = PUBLISHED) -> pd.DataFrame:
    """Rows of every study in a `studies.csv`; none where there is no such file."""
    return pd.read_csv(path, encoding="utf-8") if path.exists() else pd.DataFrame(columns=COLUMNS)


def in_order(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows by the names of their studies; within one they stay as they are."""
    return rows.sort_values("study", kind="stable")


def _points(value: float, low: float, high: float, sign: str = "") -> str:
    if pd.isna(value):
        return ""
    interval = "" if pd.isna(low) else f" ({100 * low:{sign}.1f} to {100 * high:{sign}.1f})"
    return f"{100 * value:{sign}.1f}{interval}"


def study_lines(rows: pd.DataFrame) -> list[str]:
    """A study's table: a line a variant, a column a scenario; survival and difference to the first variant."""
    table = summarise(rows)
    scenarios, cells = list(table.scenario.unique()), []
    for variant, group in table.groupby("variant", sort=False):
        by_scenario = {row.scenario: row for row in group.itertuples()}
        line = [f"`{variant}`"]
        for scenario in scenarios:
            row = by_scenario[scenario]
            gap = _points(row.difference, row.difference_low, row.difference_high, "+")
            line.append(_points(row.mean_rate, row.low, row.high) + (f"; {gap}" if gap else ""))
        cells.append(line)
    return markdown(["variant", *(f"`{one}`" for one in scenarios)], cells)


def stability_lines(rows: pd.DataFrame) -> list[str]:
    """The contrasts of the study `stability`."""
    cells = [
        [
            f"`{row.question}`",
            *(" and ".join(f"`{one}`" for one in side) for side in CONTRASTS[row.question]),
            _points(row.difference, row.low, row.high, "+"),
        ]
        for row in stability(rows).itertuples()
    ]
    return markdown(["question", "said to be steadier", "than", "coefficient of variation falls by [%] (95 %)"], cells)


def studies_page(studies: pd.DataFrame, folder: Path = FOLDER) -> str:
    """`docs/STUDIES.md`: each study's question, command and table."""
    lines = [
        "# Studies",
        "",
        "Made by `python kit.py claims` from `stress_tests/reference/studies.csv`; no number is typed in.",
        "Survival in percent on tuning seeds, mean over training seeds; behind it, in points, the difference to the",
        "study's first variant. In brackets 95 %, by Student's t over training seeds (none where there is one seed).",
    ]
    for name, rows in studies.groupby("study", sort=False):
        seeds, episodes = rows.training_seed.nunique(), rows.episodes.max()
        how = f"`python kit.py study {name}`, {seeds} training seed{'s' * (seeds > 1)}, {episodes} episodes a scenario."
        lines += ["", f"## {name}", "", read_yaml(folder / f"{name}.yaml")["question"], "", how, "", *study_lines(rows)]
        if name == "stability":
            lines += ["", *stability_lines(rows)]
    return "\n".join(lines) + "\n"
