"""Every claim of the article beside what was measured: `claims.csv` and `docs/CLAIMS.md`, made from tables alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from dualnav_lite.beyond.differences import fleet_differences, learner_differences
from dualnav_lite.config import Frozen, UnusableInput, read_yaml, validated
from dualnav_lite.drivers import MODEL_FOLDER
from dualnav_lite.judge import REFERENCE, published_rows
from dualnav_lite.metrics import wilson_interval
from dualnav_lite.pareto import pareto_episodes
from dualnav_lite.scenario import SCENARIO_FOLDER
from dualnav_lite.study_tables import stability
from dualnav_lite.survival import survival

CLAIM_FILE = SCENARIO_FOLDER.parent / "claims.yaml"
COLUMNS = [
    "claim", "article_text", "article_value", "verdict", "our_value", "low", "high", "n", "command", "figure",
]  # fmt: skip
NOT_MEASURED = "not measured yet"
RATE_COMMAND = "python kit.py stress"


class Claim(Frozen):
    """One claim and where our number comes from; exactly one of the sources is named.

    Attributes:
        wants: when it stands. `above`: our lower bound lies above the article's value, or, of a claim of 100 %, none
            failed. `at_most`: ours is no more. `positive`, `negative`, `not_positive`: the sign of a difference.
        rate, pair, pareto_episodes: rows of those tables; `from` with `where` or `sum_where`: of any other table.
        note: what our number is; not_measured: why there is none.
    """

    claim: str
    article_text: str
    article_value: float
    wants: Literal["above", "at_most", "positive", "negative", "not_positive"]
    note: str = ""
    rate: dict[str, str] | None = None
    pair: dict[str, str] | None = None
    pareto_episodes: dict[str, str] | None = None
    source: Annotated[str | None, Field(alias="from")] = None
    where: dict[str, str] | None = None
    sum_where: dict[str, list[str]] | None = None
    value: str = ""
    low: str = ""
    high: str = ""
    n: str = ""
    model_bytes: bool = False
    not_measured: str = ""
    command: str = RATE_COMMAND
    figure: str = ""


class Found(Frozen):
    """Our number with its interval and count."""

    value: float
    low: float | None = None
    high: float | None = None
    n: int | None = None


def all_claims(path: Path = CLAIM_FILE) -> list[Claim]:
    """The claims of a file; `UnusableInput` names a key that is wrong, or a claim that stands there twice."""
    values = read_yaml(path)
    if not isinstance(values, list):
        raise UnusableInput(f"{path}: holds a list of claims")
    claims = [validated(Claim, value, f"{path}, claim {k + 1}") for k, value in enumerate(values)]
    names = [one.claim for one in claims]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise UnusableInput(f"{path}: '{repeated[0]}' stands there twice")
    return claims


def read_tables(folders: list[Path]) -> dict[str, pd.DataFrame]:
    """Tables by name, each from the first folder that has it."""
    found: dict[str, pd.DataFrame] = {}
    for folder in folders:
        for path in sorted(Path(folder).glob("*.csv")):
            if path.stem not in found and path.stem != "claims":
                found[path.stem] = pd.read_csv(path, encoding="utf-8")
    return found


def find(claim: Claim, tables: Mapping[str, pd.DataFrame]) -> Found | None:
    """Our number, None where its table or its row does not exist yet."""
    if claim.rate:
        row = _row(tables.get("survival"), claim.rate)
        if row is None:
            return None
        return Found(value=row["survival_rate"], low=row["exact_low"], high=row["exact_high"], n=row["episodes"])
    if claim.pair:
        row = _row(tables.get("ablations_paired"), claim.pair)
        if row is None:
            return None
        counts = sum(row[name] for name in ("both", "only_a", "only_b", "neither"))
        return Found(value=row["difference"], low=row["low"], high=row["high"], n=counts)
    if claim.pareto_episodes:
        points = _rows(tables.get("pareto_episodes"), claim.pareto_episodes)
        if not len(points):
            return None
        best = int(points.pareto_optimal.astype(bool).sum())
        low, high = wilson_interval(best, len(points))
        return Found(value=best / len(points), low=low, high=high, n=len(points))
    if claim.model_bytes:
        sizes = [path.stat().st_size for path in MODEL_FOLDER.glob("ppo_actor.*")]
        return Found(value=max(sizes) / 1e6, n=len(sizes)) if sizes else None
    if claim.source is None:
        return None
    return _of_table(claim, tables.get(claim.source))


def _rows(table: pd.DataFrame | None, where: Mapping[str, str]) -> pd.DataFrame:
    if table is None or not set(where) <= set(table):
        return pd.DataFrame()
    chosen = np.logical_and.reduce([table[name].astype(str) == value for name, value in where.items()])
    return table[chosen]


def _row(table: pd.DataFrame | None, where: Mapping[str, str]) -> dict[str, Any] | None:
    rows = _rows(table, where)
    return None if rows.empty else rows.iloc[0].to_dict()


def _of_table(claim: Claim, table: pd.DataFrame | None) -> Found | None:
    if claim.sum_where:
        (column, names), *_ = claim.sum_where.items()
        picked = [_row(table, {column: name}) for name in names]
        if None in picked:
            return None
        return Found(value=sum(row[claim.value] for row in picked), n=int(picked[0][claim.n]) if claim.n else None)
    row = _row(table, claim.where or {})
    if row is None or pd.isna(row.get(claim.value)) or np.isinf(row[claim.value]):
        return None
    bounds = {name: row[getattr(claim, name)] for name in ("low", "high") if getattr(claim, name)}
    return Found(value=row[claim.value], n=int(row[claim.n]) if claim.n else None, **bounds)


def verdict(claim: Claim, found: Found | None) -> str:
    """`stands`, `falls`, or `open` where the interval allows both; `not measured yet` without a number."""
    if found is None:
        return NOT_MEASURED
    low = found.value if found.low is None else found.low
    high = found.value if found.high is None else found.high
    if claim.wants == "at_most":
        return "stands" if found.value <= claim.article_value else "falls"
    if claim.wants == "above" and claim.article_value >= 1.0:
        return "stands" if found.value >= 1.0 else "falls"
    target = claim.article_value if claim.wants == "above" else 0.0
    if claim.wants in ("above", "positive"):
        return "stands" if low > target else "falls" if high < target else "open"
    if claim.wants == "negative":
        return "stands" if high < 0 else "falls" if low > 0 else "open"
    return "falls" if low > 0 else "stands" if high <= 0 else "open"


def claims_table(claims: list[Claim], tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """`claims.csv`."""
    rows = []
    for claim in claims:
        found = find(claim, tables)
        numbers = [None] * 4 if found is None else [found.value, found.low, found.high, found.n]
        judged = verdict(claim, found)
        rows.append(
            [claim.claim, claim.article_text, claim.article_value, judged, *numbers, claim.command, claim.figure]
        )
    table = pd.DataFrame(rows, columns=COLUMNS)
    return table.astype({"our_value": "float64", "low": "float64", "high": "float64"}).astype({"n": "Int64"})


def _shown(value: float) -> str:
    """Three digits, or as many as keep what is below 1 from reading 1.

    >>> _shown(0.9464), _shown(0.99975), _shown(1.0), _shown(23.04)
    ('0.946', '0.9998', '1', '23')
    """
    digits = 3
    while value < 1.0 and f"{value:.{digits}g}" == "1":
        digits += 1
    return f"{value:.{digits}g}"


def claims_page(claims: list[Claim], table: pd.DataFrame) -> str:
    """`docs/CLAIMS.md`: a row a claim, then what each number is."""
    counts = table.verdict.value_counts()
    summary = ", ".join(
        f"{word}: {counts[word]}" for word in ("stands", "falls", "open", NOT_MEASURED) if word in counts
    )
    lines = [
        "# The article's claims, measured",
        "",
        "Made by `python kit.py claims` from `stress_tests/claims.yaml` and the tables in `stress_tests/reference/`;",
        f"no number of ours is typed in. {len(table)} claims ({summary}).",
        "",
        "A claim *stands* where our 95 % bound is on its side of the article's number, *falls* where it is on the",
        "other, and is *open* where the interval allows both. Where there is no interval (a quantile, a file's size, a",
        "share of moments that hang together) the number itself decides. Ours are numbers of this kit's simulator, not",
        "of the article's robot.",
        "",
        "| claim | article | verdict | ours | 95 % | n |",
        "|---|---|---|---:|---|---:|",
    ]
    for row in table.itertuples():
        interval = "" if pd.isna(row.low) else f"{_shown(row.low)} to {_shown(row.high)}"
        ours, count = "" if pd.isna(row.our_value) else _shown(row.our_value), "" if pd.isna(row.n) else f"{row.n}"
        text = row.article_text.replace("|", "\\|")
        lines.append(f"| `{row.claim}` | {text} | {row.verdict} | {ours} | {interval} | {count} |")
    lines += ["", "## What each number is", ""]
    for claim, row in zip(claims, table.itertuples(), strict=True):
        note = claim.note or ("survival rate, exact interval" if claim.rate else "")
        how = f"`{claim.command}`" if claim.command else "no command"
        shown = f"; figure `{claim.figure}`" if claim.figure else ""
        why = claim.not_measured or "its rows are not there yet"
        missing = f" Not measured: {why}." if row.verdict == NOT_MEASURED else ""
        note = f"{note}. " if note else ""
        lines.append(f"- `{claim.claim}`: article {claim.article_value:g}. {note}{how}{shown}.{missing}")
    return "\n".join(lines) + "\n"


def reference_tables(results: Path | None = None) -> dict[str, pd.DataFrame]:
    """What the claims are judged by: the published tables, or those of a results folder where it has them.

    The survival table and the article's view are made from the published rows where no folder has them.
    """
    tables = read_tables([folder for folder in (results, REFERENCE, REFERENCE / "beyond") if folder])
    rows = published_rows()
    if len(rows):
        tables.setdefault("survival", survival(rows))
        tables.setdefault("pareto_episodes", pareto_episodes(rows))
    if "algorithms" in tables:
        tables["learners"] = learner_differences(tables["algorithms"])
    if "studies" in tables and (tables["studies"].study == "stability").any():
        tables["stability"] = stability(tables["studies"].query("study == 'stability'"))
    if "fleet" in tables:
        tables["fleets"] = fleet_differences(tables["fleet"])
    return tables
