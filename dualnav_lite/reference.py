"""Published rows of `stress_tests/reference/`: what every arm does on the test seeds, with what made them."""

import gzip
import io
import json
from pathlib import Path

import pandas as pd

from dualnav_lite.episodes import COLUMNS
from dualnav_lite.scenario import SCENARIO_FOLDER
from dualnav_lite.survival import read_episodes

REFERENCE = SCENARIO_FOLDER.parent / "reference"
ROWS, MADE_FROM = "episodes.csv.gz", "episodes.json"


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
