"""Rows to every table of the stress test, and the published rows that stand beside what is measured now.

The tables are pure functions of rows, so no number depends on how or where those were run.
"""

import gzip
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite.cases import all_cases
from dualnav_lite.chunks import ABLATION
from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.episodes import COLUMNS
from dualnav_lite.metrics import bootstrap_rate
from dualnav_lite.pareto import pareto_episodes
from dualnav_lite.scenario import SCENARIO_FOLDER
from dualnav_lite.survival import PAIRED_COLUMNS, paired, read_episodes, survival, survived

REFERENCE = SCENARIO_FOLDER.parent / "reference"
ROWS, MADE_FROM = "episodes.csv.gz", "episodes.json"  # of the published rows, with what made them
FLOOR, CEILING = "stand_still", "ceiling"
BLIND = ("straight", "crawl", "wait_then_straight", "drive_wait_straight")  # know the goal's bearing and the clock
PUBLISHED = "published"
TABLES = ("survival", "survival_strict", "paired", "pareto_episodes", "outcomes", "training_seeds")
ABLATION_DEFAULT = f"{ABLATION}default"  # what the others are held against
ABLATION_TABLES = ("ablations", "ablations_paired")
TRAINING_COLUMNS = ["scenario", "arm", "training_seeds", "episodes", "survival_rate", "low", "high"]


def published_rows(folder: Path = REFERENCE) -> pd.DataFrame:
    """The published rows, typed as `episodes.csv`; none where nothing is published yet."""
    path = Path(folder) / ROWS
    if not path.exists():
        return read_episodes(io.StringIO(",".join(COLUMNS) + "\n"))
    return read_episodes(io.BytesIO(gzip.decompress(path.read_bytes())))


def made_from(folder: Path = REFERENCE) -> dict:
    """Config and weights behind the published rows, and command, commit and CPU of each block; empty without any."""
    path = Path(folder) / MADE_FROM
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def joined(rows: pd.DataFrame, published: pd.DataFrame) -> pd.DataFrame:
    """The published rows of the seeds in `rows`, of arms that `rows` does not hold in that scenario itself."""
    present = pd.MultiIndex.from_frame(rows[["scenario", "seed"]]).unique()
    own = pd.MultiIndex.from_frame(rows[["scenario", "arm"]]).unique()
    is_same_seed = pd.MultiIndex.from_frame(published[["scenario", "seed"]]).isin(present)
    is_other_arm = ~pd.MultiIndex.from_frame(published[["scenario", "arm"]]).isin(own)
    return published[is_same_seed & is_other_arm].reset_index(drop=True)


def is_kind(arm: str, kinds: str | Sequence[str]) -> bool:
    """Whether an arm, with or without knobs behind `@`, is one of these."""
    return arm.partition("@")[0] in ((kinds,) if isinstance(kinds, str) else kinds)


def judge(rows: pd.DataFrame, published: pd.DataFrame, made: Mapping | None = None) -> dict[str, pd.DataFrame]:
    """Every table of the stress test.

    Args:
        rows: measured now; published: of other arms, joined by seed; both as `read_episodes` gives them.
        made: `policy_sha256` (by arm) and `config_sha256` of the measured rows, under "measured", and of the published
            ones, under "published".

    Returns:
        `episodes` (measured) and the tables of `TABLES`, by name; of ablations, which were trained for less and are
        held against their own default alone, those of `ABLATION_TABLES`.
    """
    episodes, is_ablation = rows, rows.arm.str.startswith(ABLATION)
    rows = rows if is_ablation.all() else rows[~is_ablation]
    made, others = made or {}, joined(rows, published)
    order = [scenario for case in all_cases().values() for scenario in case.scenarios]
    order += sorted(set(rows.scenario) - set(order))

    def both(strict: bool) -> pd.DataFrame:
        parts = [
            survival(part, strict=strict, source=source, **made.get(source, {}))
            for part, source in ((rows, "measured"), (others, PUBLISHED))
            if len(part)
        ]
        return pd.concat(parts, ignore_index=True).sort_values("scenario", key=_place(order), kind="stable")

    everything = pd.concat([part for part in (rows, others) if len(part)], ignore_index=True)
    strict = both(strict=True)
    return {
        "episodes": episodes,
        "survival": both(strict=False).reset_index(drop=True),
        "survival_strict": strict[strict.scenario.isin(_long_scenarios())].reset_index(drop=True),
        "paired": all_pairs(rows, everything).sort_values("scenario", key=_place(order), kind="stable"),
        "pareto_episodes": pareto_episodes(rows),
        "outcomes": everything.groupby(["scenario", "arm", "outcome"]).size().rename("episodes").reset_index(),
        "training_seeds": over_training_seeds(everything),
    } | (ablations(episodes[is_ablation]) if is_ablation.any() else {})


def ablations(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The tables of `ABLATION_TABLES`: rates of ablations, and the default minus each on the same seeds."""
    arms = sorted(set(rows.arm) - {ABLATION_DEFAULT})
    pairs = [paired(rows, ABLATION_DEFAULT, arm) for arm in arms] if (rows.arm == ABLATION_DEFAULT).any() else []
    both = pd.concat(pairs, ignore_index=True) if pairs else pd.DataFrame(columns=PAIRED_COLUMNS)
    return {"ablations": survival(rows), "ablations_paired": both}


def with_published(rows: pd.DataFrame) -> pd.DataFrame:
    """`survival.csv` of some rows and of the published arms on their seeds."""
    return judge(rows, published_rows())["survival"] if len(rows) else survival(rows)  # a shard may have none


def _place(order: list[str]):
    return lambda ids: ids.map(order.index)


def _long_scenarios() -> list[str]:
    return [name for case in all_cases().values() if case.is_long for name in case.scenarios]


def all_pairs(rows: pd.DataFrame, everything: pd.DataFrame) -> pd.DataFrame:
    """`paired.csv`: the first measured arm against every other on the seeds that both ran, per scenario.

    With several training seeds of an arm, its lowest stands for it: pairs need one row a seed.
    """
    first = everything.assign(training_seed=everything.training_seed.fillna(-1))
    lowest = first.groupby("arm").training_seed.transform("min")
    single = everything[first.training_seed == lowest]
    main = main_arm(rows)
    parts = [paired(single, main, arm) for arm in sorted(set(single.arm) - {main})]
    parts = [part for part in parts if len(part)]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=PAIRED_COLUMNS)


def main_arm(rows: pd.DataFrame) -> str:
    """The arm that the others are held against: the policy, or else the first in the alphabet."""
    arms = sorted(set(rows.arm))
    return "ppo" if "ppo" in arms else arms[0]


def over_training_seeds(rows: pd.DataFrame) -> pd.DataFrame:
    """Rate of each arm that was trained more than once, with a bootstrap over training seeds and episodes (95 %)."""
    table = []
    for (scenario, arm), group in rows.assign(success=survived(rows)).groupby(["scenario", "arm"], sort=True):
        if group.training_seed.nunique() > 1:
            grid = group.pivot(index="training_seed", columns="seed", values="success").dropna(axis=1)
            rates = bootstrap_rate(grid.to_numpy(float))
            table.append([scenario, arm, len(grid), len(group), *rates])
    return pd.DataFrame(table, columns=TRAINING_COLUMNS)


def bounds(table: pd.DataFrame, scenario: str) -> dict[str, pd.Series]:
    """Rows of a survival table that a rate is read beside: `floor`, `blind` (the best of them) and `ceiling`."""
    own = table[table.scenario == scenario]
    found = {}
    for name, kinds in (("floor", FLOOR), ("blind", BLIND), ("ceiling", CEILING)):
        rows = own[[is_kind(arm, kinds) for arm in own.arm]]
        if len(rows):
            found[name] = rows.loc[rows.survival_rate.idxmax()]
    return found


def beside_claim(row) -> str | None:
    """How a row of a survival table stands to the article's claim; None without one.

    "beaten": the exact 95 % lower bound lies above it. "missed": the upper bound lies below. "open": neither; of a
    claim of 100 %, which cannot be beaten, nobody failed in the runs there are.
    """
    if np.isnan(row.article_claim):
        return None
    return "beaten" if row.exact_low > row.article_claim else "missed" if row.exact_high < row.article_claim else "open"


def judge_folder(results: str | Path) -> dict[str, pd.DataFrame]:
    """The tables of a results folder, written into it as CSV.

    Reads `<case>/episodes.csv` and `<case>/run.json` of every case that has them, and the published rows.

    Raises:
        UnusableInput: there are none.
    """
    results = Path(results)
    files = [results / name / "episodes.csv" for name in all_cases()]
    files = [file for file in files if file.exists()]
    if not files:
        raise UnusableInput(f"{results}: no case has rows here; run `python kit.py stress` first")
    made: dict = {"measured": {"policy_sha256": {}, "config_sha256": ""}}
    for file in files:
        run = json.loads((file.parent / "run.json").read_text(encoding="utf-8"))
        made["measured"]["policy_sha256"] |= run["policy_sha256"]
        made["measured"]["config_sha256"] = run["config_sha256"]
    origin = made_from()
    made[PUBLISHED] = {key: origin[key] for key in ("policy_sha256", "config_sha256") if key in origin}
    rows = pd.concat([read_episodes(file) for file in files], ignore_index=True)
    tables = judge(rows, published_rows(), made)
    texts = [file.read_text(encoding="utf-8").split("\n", 1) for file in files]
    write_atomic(results / "episodes.csv", texts[0][0] + "\n" + "".join(body for _, body in texts))
    for name in (*TABLES, *ABLATION_TABLES):
        if name in tables:
            write_atomic(results / f"{name}.csv", csv_text(tables[name]))
    return tables


def csv_text(table: pd.DataFrame) -> str:
    """Text of a CSV: the same bytes on every system, floats in their shortest form at six decimals."""
    numbers = table.select_dtypes("float").columns
    return table.assign(**{name: table[name].round(6) for name in numbers}).to_csv(index=False, lineterminator="\n")
