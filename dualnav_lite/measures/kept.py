"""Parts of a measurement, written as soon as they are known, so that the same command goes on where it was stopped."""

import json
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import joblib
import pandas as pd
from tqdm import tqdm

from dualnav_lite.chunks import code_sha256, sha256
from dualnav_lite.config import Config, write_atomic
from dualnav_lite.evaluate import library_arm
from dualnav_lite.workers import pool


@cache
def fingerprint(arm: str) -> str:
    """SHA-256 of an arm's weights; empty for planners."""
    return getattr(library_arm(arm, Config()), "fingerprint", "")


def kept(
    folder: Path,
    label: str,
    made_of: Any,
    make: Callable[[], pd.DataFrame],
    read: Callable[[Path], pd.DataFrame] = pd.read_csv,
) -> pd.DataFrame:
    """The table that `make` gives, from `folder` where an earlier run with the same code and settings wrote it.

    Args:
        folder: of the parts; label: the part's name, a human's clue.
        made_of: whatever the table depends on besides the code, as JSON can hold it.
        read: how the file is read back; what is fresh is read back as well, so that both are the same.
    """
    stem = re.sub(r"[^\w.-]", "_", f"{label}.{sha256(json.dumps([made_of, code_sha256()]))[:12]}")
    path = Path(folder) / f"{stem}.csv"
    if not path.exists():
        write_atomic(path, make().to_csv(index=False, lineterminator="\n"))
    return read(path)


def _one(folder: Path, label: str, made_of: Any, make) -> tuple[str, pd.DataFrame]:
    return label, kept(folder, label, made_of, make)


def all_kept(folder: Path, tasks: Mapping[str, tuple[Any, Callable[[], pd.DataFrame]]], jobs: int) -> pd.DataFrame:
    """The tables of all tasks below one another, in the tasks' order; each is kept as soon as it is made.

    Args:
        tasks: by label, what the table is made of and who makes it (to be sent to another process).
        jobs: processes.
    """
    calls = [joblib.delayed(_one)(folder, label, *task) for label, task in tasks.items()]
    found: dict[str, pd.DataFrame] = {}
    with tqdm(total=len(tasks), desc=Path(folder).name, unit="part") as bar, pool(min(jobs, len(tasks))) as parallel:
        for label, table in parallel(calls):
            found[label] = table
            bar.update()
    return pd.concat([found[label] for label in tasks], ignore_index=True)
