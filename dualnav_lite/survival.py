"""Rows of episodes to tables: how often an arm survives, and which of two arms does better on the same seeds."""

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO

import numpy as np
import pandas as pd

from dualnav_lite import __version__
from dualnav_lite.episodes import COLUMNS, OUTCOMES, rows_to_csv
from dualnav_lite.metrics import exact_interval, mcnemar_exact, paired_difference, wilson_interval
from dualnav_lite.scenario import all_scenarios

# fmt: off
SURVIVAL_COLUMNS = [
    "scenario", "arm", "training_seed", "episodes", "survived", "survival_rate", "wilson_low", "wilson_high",
    "exact_low", "exact_high", "collisions", "timeouts", "flat_batteries", "article_claim", "mean_min_clearance_m",
    "mean_energy_j", "energy_j_per_m", "seed_first", "seed_last", "source", "policy_sha256", "config_sha256",
    "kit_version",
]
PAIRED_COLUMNS = [
    "scenario", "arm_a", "arm_b", "both", "only_a", "only_b", "neither", "difference", "low", "high", "mcnemar_p",
]
# fmt: on


def read_episodes(source: str | Path | IO) -> pd.DataFrame:
    """Rows of an `episodes.csv` (also compressed), typed as `episodes.COLUMNS` says; empty text stays empty text."""
    text = [name for name, kind in COLUMNS.items() if kind == "str"]
    rows = pd.read_csv(source, dtype=COLUMNS, encoding="utf-8")
    return rows.assign(**{name: rows[name].fillna("") for name in text})


def rows_of(episodes: Iterable[Mapping]) -> pd.DataFrame:
    """Rows as `read_episodes` would give them back after they were written."""
    return read_episodes(io.BytesIO(rows_to_csv(episodes)))


def survived(rows: pd.DataFrame, strict: bool = False) -> pd.Series:
    """Whether each episode counts as survived.

    Args:
        rows: as `read_episodes` gives them.
        strict: a contact also loses a three-hour run (short runs end at a contact anyway).
    """
    success = rows.outcome.map(OUTCOMES) == "survived"
    return success & (rows.contacts.fillna(0) == 0) if strict else success


def survival(
    rows: pd.DataFrame,
    *,
    strict: bool = False,
    source: str = "measured",
    policy_sha256: Mapping[str, str] | None = None,
    config_sha256: str = "",
) -> pd.DataFrame:
    """One row per scenario, arm and training seed: survival rate with intervals, failures by kind, means.

    An `error` is a failure like any other: episodes minus survived, collisions, timeouts and flat batteries are the
    errors. `energy_j_per_m` is the energy of all episodes over the metres of all episodes.

    Args:
        rows: as `read_episodes` gives them, of one preference.
        strict: as in `survived`.
        source: where the rows come from, "measured" or "published".
        policy_sha256: by arm; empty for arms without weights.
        config_sha256: of the resolved config.

    Raises:
        ValueError: an arm has several rows for one seed of a scenario (several preferences, say).
    """
    key = ["scenario", "arm", "training_seed"]
    _one_row_per_seed(rows, [*key, "seed"])
    claims = {name: scenario.article_claim for name, scenario in all_scenarios().items()}
    table = []
    for (scenario, arm, training_seed), group in rows.assign(
        kind=rows.outcome.map(OUTCOMES), success=survived(rows, strict)
    ).groupby(key, dropna=False, sort=True):
        successes, kinds = int(group.success.sum()), group.kind[~group.success].value_counts()
        wilson, exact = wilson_interval(successes, len(group)), exact_interval(successes, len(group))
        length = group.path_m.sum()
        contact = kinds.get("collision", 0) + kinds.get("survived", 0)  # the latter: lost by the strict rule alone
        claim, policy = claims.get(scenario), (policy_sha256 or {}).get(arm, "")
        rates = [len(group), successes, successes / len(group), *wilson, *exact]
        failures = [contact, kinds.get("timeout", 0), kinds.get("flat_battery", 0), claim]
        energy_j_per_m = group.energy_j.sum() / length if length > 0 else np.nan
        means = [group.min_clearance_m.mean(), group.energy_j.mean(), energy_j_per_m]
        origin = [group.seed.min(), group.seed.max(), source, policy, config_sha256, __version__]
        table.append([scenario, arm, training_seed, *rates, *failures, *means, *origin])
    columns = pd.DataFrame(table, columns=SURVIVAL_COLUMNS)
    return columns.astype({"training_seed": "Int64", "article_claim": "float64"})


def paired(rows: pd.DataFrame, arm_a: str, arm_b: str) -> pd.DataFrame:
    """One row per scenario: on which seeds both, one or no arm survived, difference a - b, interval and exact p.

    Only seeds that both arms ran count; scenarios without any are left out.

    Raises:
        ValueError: an arm is missing, or has several rows for one seed (several training seeds or preferences).
    """
    chosen = rows[rows.arm.isin([arm_a, arm_b])]
    missing = {arm_a, arm_b} - set(chosen.arm)
    if missing or arm_a == arm_b:
        known = ", ".join(sorted(set(rows.arm)))
        raise ValueError(f"need two arms that have rows, got '{arm_a}' and '{arm_b}'; known: {known}")
    _one_row_per_seed(chosen, ["scenario", "arm", "seed"])
    table = []
    for scenario, group in chosen.assign(success=survived(chosen)).groupby("scenario", sort=True):
        pairs = group.pivot(index="seed", columns="arm", values="success").reindex(columns=[arm_a, arm_b]).dropna()
        a, b = pairs[arm_a].to_numpy(bool), pairs[arm_b].to_numpy(bool)
        counts = [int(cell.sum()) for cell in (a & b, a & ~b, ~a & b, ~a & ~b)]
        if len(pairs):
            table.append([scenario, arm_a, arm_b, *counts, *paired_difference(*counts), mcnemar_exact(*counts[1:3])])
    return pd.DataFrame(table, columns=PAIRED_COLUMNS)


def _one_row_per_seed(rows: pd.DataFrame, key: list[str]) -> None:
    """Refuse rows in which an episode would count twice."""
    repeated = rows[rows.duplicated(key)]
    if len(repeated):
        first = ", ".join(f"{name} {repeated.iloc[0][name]}" for name in key)
        raise ValueError(
            f"{len(repeated)} rows repeat an episode (first: {first}); choose one preference or training seed"
        )


def failures(rows: pd.DataFrame) -> pd.DataFrame:
    """The first three failed episodes of each scenario and arm: what a reader would want to see again."""
    columns = ["scenario", "arm", "seed", "outcome", "time_s", "path_m", "energy_j"]
    return rows[~survived(rows)].groupby(["scenario", "arm"]).head(3)[columns].reset_index(drop=True)
