"""Make the published rows anew: every arm of SPEC 8 on its number of test seeds, with what made them."""

import gzip
import json
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite import __version__
from dualnav_lite.cases import all_cases
from dualnav_lite.chunks import code_sha256, sha256
from dualnav_lite.config import Config, UnusableInput, dump_config, write_atomic
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import evaluate, library_arm
from dualnav_lite.notebooks import ROOT
from dualnav_lite.reference import MADE_FROM, REFERENCE, ROWS

MAIN = ("ppo", "ppo_filter", "cv_sampling")  # and the best baseline
REST = (
    "ceiling",
    "stand_still",
    "straight",
    "crawl",
    "wait_then_straight",
    "drive_wait_straight@share=0.2+wait_s=4",
    "astar",
    "rrtstar",
    "dwa",
    "orca",
)
LONG_REST = ("ceiling@max_speed=0.45", "astar@max_speed=0.5", "cv_sampling@max_speed=0.5", "stand_still", "straight")
COUNTS = {"main": 1000, "rest": 200, "long_ppo": 100, "long_filter": 20, "long_rest": 3}
EXTRA = ("navigation",)  # belongs to no case, and what the others are variations of


def blocks(share: float = 1.0) -> dict[str, tuple[Sequence[str], Sequence[str], int]]:
    """(arms, scenarios, seeds) by name; `share` of each number of seeds, at least one."""
    short = [name for case in all_cases().values() if not case.is_long for name in case.scenarios] + list(EXTRA)
    long = [name for case in all_cases().values() if case.is_long for name in case.scenarios]
    count = {name: max(1, round(share * number)) for name, number in COUNTS.items()}
    return {
        "main": (MAIN, short, count["main"]),
        "rest": (REST, short, count["rest"]),
        "long_ppo": (MAIN[:1], long, count["long_ppo"]),
        "long_filter": (MAIN[1:2], long, count["long_filter"]),
        "long_rest": (LONG_REST, long, count["long_rest"]),
    }


def publish(
    work: Path, to: Path = REFERENCE, share: float = 1.0, jobs: int = 1, only: Sequence[str] = (), command: str = ""
) -> pd.DataFrame:
    """Run every block (or those of `only`) and write `episodes.csv.gz` and `episodes.json` into `to`.

    Finished chunks in `work` are not run again. Arms whose package is missing here are left out and said so.

    Raises:
        UnusableInput: an unknown block, a model that is missing, a folder that refuses.
    """
    chosen = blocks(share)
    unknown = sorted(set(only) - set(chosen))
    if unknown:
        raise UnusableInput(f"unknown block '{unknown[0]}'; known: {', '.join(chosen)}")
    parts, prints, left_out = [], {}, {}
    for name, (arms, scenarios, count) in chosen.items():
        if only and name not in only:
            continue
        usable = []
        for arm in arms:
            try:
                prints[arm] = getattr(library_arm(arm, Config()), "fingerprint", "")
                usable.append(arm)
            except UnusableInput as error:
                if arm in MAIN:
                    raise
                left_out[arm] = str(error)
                print(f"left out: {error}", file=sys.stderr, flush=True)
        print(f"{name}: {count} seeds, {', '.join(usable)}", file=sys.stderr, flush=True)
        first = SEEDS["test"].start
        parts.append(evaluate(usable, scenarios, range(first, first + count), work / name, jobs=jobs))
    texts = [(work / name / "episodes.csv").read_text(encoding="utf-8").split("\n", 1) for name in only or chosen]
    rows = (texts[0][0] + "\n" + "".join(body for _, body in texts)).encode("utf-8")
    write_atomic(to / ROWS, gzip.compress(rows, mtime=0))
    made = {
        "command": command,
        "commit": commit(),
        "kit_version": __version__,
        "code_sha256": code_sha256(),
        "config_sha256": sha256(dump_config(Config())),
        "policy_sha256": prints,
        "left_out": left_out,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "cpu_flags": cpu_flags(),
        "config": Config().model_dump(mode="json"),
    }
    write_atomic(to / MADE_FROM, json.dumps(made, indent=1, ensure_ascii=False) + "\n")
    return pd.concat(parts, ignore_index=True)


def commit() -> str:
    """The checkout's commit, empty where there is none."""
    try:
        found = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return found.stdout.strip()


def cpu_flags() -> list[str]:
    """Vector extensions that numpy finds here: where they differ, last bits may."""
    features = getattr(np._core._multiarray_umath, "__cpu_features__", {})
    return sorted(name for name, is_there in features.items() if is_there)
