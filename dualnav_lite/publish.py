"""Make the published rows anew: every arm on its number of test seeds, with what made them, tables and a report."""

import gzip
import io
import json
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from dualnav_lite import __version__
from dualnav_lite.cases import all_cases
from dualnav_lite.chunks import Chunk, code_sha256, merged, plan_chunks, sha256
from dualnav_lite.config import ROOT, Config, UnusableInput, dump_config, write_atomic
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import evaluate, library_arm
from dualnav_lite.judge import MADE_FROM, REFERENCE, ROWS, TABLES, csv_text, judge, made_from
from dualnav_lite.pace import seconds_per_step, steps_of
from dualnav_lite.pages import write_report
from dualnav_lite.scenario import load_scenario
from dualnav_lite.survival import read_episodes

MAIN = ("ppo", "ppo_filter", "cv_sampling")  # and the best baseline
REST = (
    "ceiling", "stand_still", "straight", "crawl", "wait_then_straight", "drive_wait_straight@share=0.2+wait_s=4",
    "astar", "rrtstar", "dwa", "orca",
)  # fmt: skip
LONG_REST = (
    "ceiling@max_speed=0.4+calm=0.05", "astar@max_speed=0.5", "cv_sampling@max_speed=0.5", "stand_still", "straight",
)  # fmt: skip
COUNTS = {"main": 1000, "rest": 200, "long_ppo": 100, "long_filter": 20, "long_rest": 3}
MADE_OF = ("dualnav_lite", "models", "stress_tests/scenarios")
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
    """Run every block (or those of `only`) and write what is finished into `to`: rows, their origin, tables, a report.

    Finished chunks in `work` are not run again. A block that an earlier call left in `to` stays, with the commit it was
    made at, where settings, weights and seeds are those of today. Arms whose package is missing here are left out and
    said so.

    Raises:
        UnusableInput: an unknown block, a model that is missing, a folder that refuses.
    """
    chosen = blocks(share)
    unknown = sorted(set(only) - set(chosen))
    if unknown:
        raise UnusableInput(f"unknown block '{unknown[0]}'; known: {', '.join(chosen)}")
    prints, left_out = usable_arms(chosen)
    chosen = {
        name: ([arm for arm in arms if arm in prints], scenarios, count)
        for name, (arms, scenarios, count) in chosen.items()
    }
    plans = {name: chunks_of(block, prints, work / name) for name, block in chosen.items()}
    asked = [name for name in chosen if not only or name in only]
    print(time_left([chunk for name in asked for chunk in plans[name]], jobs), file=sys.stderr, flush=True)
    for number, name in enumerate(asked, start=1):
        (arms, scenarios, count), begin = chosen[name], time.monotonic()
        print(f"[{number}/{len(asked)}] {name}: {count} seeds, {', '.join(arms)}", file=sys.stderr, flush=True)
        evaluate(arms, scenarios, published_seeds(count), work / name, jobs=jobs)
        print(f"{name} done in {(time.monotonic() - begin) / 60:.0f} minutes", file=sys.stderr, flush=True)
    here = {
        "command": command,
        "commit": commit(),
        "code_sha256": code_sha256(),
        "left_out": left_out,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "cpu_flags": cpu_flags(),
    }
    parts, made = put_together(work, to, chosen, plans, prints, here)
    if missing := [name for name in chosen if name not in made["blocks"]]:
        print(f"not made yet: {', '.join(missing)}", file=sys.stderr, flush=True)
    content = merged(parts)
    rows = read_episodes(io.BytesIO(content))
    write_atomic(to / ROWS, gzip.compress(content, mtime=0))
    write_atomic(to / MADE_FROM, json.dumps(made, indent=1, ensure_ascii=False) + "\n")
    origin = {key: made[key] for key in ("policy_sha256", "config_sha256")}
    tables = judge(rows, rows[:0], {"measured": origin})
    for name in (one for one in TABLES if one != "pareto_episodes"):  # megabytes; `claims` makes it from the rows
        write_atomic(to / f"{name}.csv", csv_text(tables[name]))
    commands = dict.fromkeys(block["command"] for block in made["blocks"].values())
    write_report(to, tables, "; ".join(commands), [], ("md",))
    return rows


def put_together(work: Path, to: Path, chosen, plans, prints: dict[str, str], here: dict) -> tuple[list[Chunk], dict]:
    """The chunks of each block that is finished in `work` or stays from an earlier call, and what made each."""
    made: dict = {
        "kit_version": __version__,
        "config_sha256": sha256(dump_config(Config())),
        "policy_sha256": {},
        "blocks": {},
        "config": Config().model_dump(mode="json"),
    }
    earlier, parts = made_from(to), []
    is_same = earlier.get("config_sha256") == made["config_sha256"]
    for name, plan in plans.items():
        arms, scenarios, count = chosen[name]
        if all(chunk.is_done() for chunk in plan):
            made["blocks"][name] = here | {"policy_sha256": {arm: prints[arm] for arm in arms}}
            parts += plan
        elif is_same and (block := earlier["blocks"].get(name)):
            weights = block["policy_sha256"]  # of an arm that cannot drive here as well
            kept = earlier_rows(to, list(weights), scenarios, count, work / f"{name}.csv")
            if kept and all(prints.get(arm, sha) == sha for arm, sha in weights.items()) and set(arms) <= set(weights):
                made["blocks"][name] = block
                parts.append(kept)
    for block in made["blocks"].values():
        made["policy_sha256"] |= block["policy_sha256"]
    return parts, made


def earlier_rows(to: Path, arms: Sequence[str], scenarios: Sequence[str], count: int, path: Path) -> Chunk | None:
    """The rows of a block that lie in `to`, laid at `path`; None where any of them is missing there."""
    rows = pd.read_csv(to / ROWS, dtype=str, keep_default_na=False, encoding="utf-8")
    rows = rows[rows.arm.isin(arms) & rows.scenario.isin(scenarios)]
    seeds = [str(seed) for seed in published_seeds(count)]
    if len(rows) != len(arms) * len(scenarios) * count or set(rows.seed) != set(seeds):
        return None
    write_atomic(path, rows.to_csv(index=False, lineterminator="\n"))
    return Chunk(load_scenario(scenarios[0]), arms[0], (), path)


def usable_arms(chosen) -> tuple[dict[str, str], dict[str, str]]:
    """Weights' hash of each arm that can drive here, and why each of the others cannot."""
    prints, left_out = {}, {}
    for arm in dict.fromkeys(arm for arms, _, _ in chosen.values() for arm in arms):
        try:
            prints[arm] = getattr(library_arm(arm, Config()), "fingerprint", "")
        except UnusableInput as error:
            if arm in MAIN:
                raise
            left_out[arm] = str(error)
            print(f"left out: {error}", file=sys.stderr, flush=True)
    return prints, left_out


def published_seeds(count: int) -> range:
    """The first published test seeds."""
    return range(SEEDS["test"].start, SEEDS["test"].start + count)


def chunks_of(block, prints: dict[str, str], folder: Path) -> list[Chunk]:
    """The chunks that `evaluate` makes of a block."""
    arms, scenarios, count = block
    loaded = [load_scenario(name) for name in scenarios]
    return plan_chunks({arm: prints[arm] for arm in arms}, loaded, published_seeds(count), Config(), folder)


def time_left(chunks: Sequence[Chunk], jobs: int) -> str:
    """One line: how much of these chunks is there, and about how long the rest will take here."""
    todo = [chunk for chunk in chunks if not chunk.is_done()]
    pace = {arm: seconds_per_step(arm) for arm in dict.fromkeys(chunk.arm for chunk in todo)}
    seconds = sum(len(chunk.seeds) * steps_of(chunk.scenario) * pace[chunk.arm] for chunk in todo)
    done = f"{len(chunks) - len(todo)} of {len(chunks)} chunks are there"
    return f"{done}; the rest: about {seconds / 3600 / jobs:.1f} hours on {jobs} processes"


def commit() -> str:
    """The checkout's commit, and whether what rows are made of was changed since; empty where there is none."""
    try:
        found = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    changed = subprocess.run(["git", "diff", "--quiet", "HEAD", "--", *MADE_OF], cwd=ROOT, check=False).returncode
    return found.stdout.strip() + (" with changes" if changed else "")


def cpu_flags() -> list[str]:
    """Vector extensions that numpy finds here: where they differ, last bits may."""
    features = getattr(np._core._multiarray_umath, "__cpu_features__", {})
    return sorted(name for name, is_there in features.items() if is_there)
