"""The stress test: papermill runs `case.ipynb` once a case, then rows become tables, figures and a report."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dualnav_lite.cases import all_cases, load_case
from dualnav_lite.chunks import arm_name, plan_chunks
from dualnav_lite.config import Config, UnknownName, UnusableInput, with_overrides, write_atomic
from dualnav_lite.encoder import num_channels
from dualnav_lite.evaluate import evaluate, library_arm
from dualnav_lite.execution import run_notebook
from dualnav_lite.judge import judge_folder
from dualnav_lite.pace import duration, seconds_of
from dualnav_lite.pages import write_report
from dualnav_lite.planners import ARMS
from dualnav_lite.report import text_tables
from dualnav_lite.scenario import SCENARIO_FOLDER, load_scenario

FOLDER = SCENARIO_FOLDER.parent
POLICY_ARMS = ("ppo", "ppo_filter")
FAILED = "failed.csv"


@dataclass(frozen=True)
class Plan:
    """What is run: which arms, on how many seeds, where, and by whom.

    Attributes:
        arms, episodes: of the short scenarios; long_arms, long_runs: of the three-hour scenario.
        seed_base: first seed.
        shard: "k/n" runs every n-th chunk from the k-th and judges nothing.
        cluster: address of a Dask scheduler, or empty.
        command: what a reader would type to get the same, for the report.
        pace: processor time of a control step by arm [s], to say how long a case takes; empty if nobody measured it.
    """

    arms: Sequence[str]
    episodes: int
    long_arms: Sequence[str]
    long_runs: int
    seed_base: int
    jobs: int
    out: Path
    command: str
    shard: str = "1/1"
    cluster: str = ""
    preference: float = 0.5
    overrides: dict[str, Any] = field(default_factory=dict)
    pace: dict[str, float] = field(default_factory=dict)

    def parameters(self, name: str) -> dict[str, Any]:
        """What `case.ipynb` is given for a case: every name of its parameters cell."""
        arms, count = (self.long_arms, self.long_runs) if load_case(name).is_long else (self.arms, self.episodes)
        return {
            "case": name,
            "arms": list(arms),
            "episodes": count,
            "seed_base": self.seed_base,
            "jobs": self.jobs,
            "shard": self.shard,
            "cluster": self.cluster,
            "preference": self.preference,
            "overrides": dict(self.overrides),
            "out": str(self.out / name),
        }


def shard_of(text: str) -> tuple[int, int]:
    """(k, n) of `k/n`.

    >>> shard_of("2/8")
    (2, 8)
    """
    try:
        index, count = (int(part) for part in text.split("/"))
    except ValueError:
        raise UnusableInput(f"a shard reads k/n, such as 2/8; got '{text}'") from None
    if not 1 <= index <= count:
        raise UnusableInput(f"shard must be k/n with 1 <= k <= n, got {text}")
    return index, count


def all_arms() -> list[str]:
    """Every arm that can drive here: the policy, its filtered twin, the planners, the ablations that were trained."""
    from dualnav_lite.drivers import trained_ablations

    found = []
    for arm in (*POLICY_ARMS, *ARMS, *trained_ablations()):
        try:
            library_arm(arm, Config())
        except UnusableInput as error:
            print(f"left out: {error}", file=sys.stderr, flush=True)
        else:
            found.append(arm)
    return found


def broken_arms(arms: Sequence[str]) -> dict[str, str]:
    """Why each of these arms cannot drive, by arm; arms that can are left out.

    A name that nobody knows and a model that is not there raise at once; a model that is there and cannot be used is
    one arm's failure, and the others go on without it.

    Raises:
        UnusableInput: an unknown arm or knob, a model file that does not exist.
    """
    broken, config = {}, Config()
    observations = np.zeros((1, num_channels(config.observation), 64, 64), np.float32)
    for arm in dict.fromkeys(arms):
        if arm.partition("@")[0] in ARMS:
            library_arm(arm, config)
            continue
        try:
            driver = library_arm(arm, config)
            if not hasattr(driver, "own_config"):
                continue
            own = driver.own_config(config)
            if own.observation.intensity == config.observation.intensity and hasattr(driver, "output"):
                driver.output(observations)
        except UnknownName:
            raise
        except UnusableInput as error:
            broken[arm] = str(error)
        except Exception as error:  # whatever a foreign network raises is what is wrong with it
            broken[arm] = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return broken


def run_case(
    case: str,
    arms: Sequence[str],
    episodes: int,
    seed_base: int,
    out: str | Path,
    jobs: int = 1,
    shard: str = "1/1",
    cluster: str = "",
    preference: float = 0.5,
    overrides: dict[str, Any] | None = None,
) -> pd.DataFrame:
    """Rows of a case; arguments as in `evaluate`."""
    seeds = range(seed_base, seed_base + episodes)
    return evaluate(
        arms,
        load_case(case).scenarios,
        seeds,
        out,
        overrides=overrides,
        preference=preference,
        jobs=jobs,
        shard=shard_of(shard),
        cluster=cluster,
    )


def without_broken(plan: Plan) -> tuple[Plan, list[tuple[str, str]]]:
    """The plan with the arms that can drive, and (arm, reason) of the others.

    Raises:
        UnusableInput: none can, or as in `broken_arms`.
    """
    broken = broken_arms([*plan.arms, *plan.long_arms])
    usable, long = ([arm for arm in arms if arm not in broken] for arms in (plan.arms, plan.long_arms))
    for arm, reason in broken.items():
        print(f"{arm} cannot drive: {reason}", file=sys.stderr, flush=True)
    if not usable:
        raise UnusableInput("no arm can drive: " + "; ".join(f"{arm}: {why}" for arm, why in broken.items()))
    return replace(plan, arms=usable, long_arms=long or usable[:1]), list(broken.items())


def run_cases(plan: Plan) -> list[tuple[str, str]]:
    """Run `case.ipynb` for every case; (case, reason) of each that failed. Nothing that one does stops another."""
    failed, names = [], list(all_cases())
    for number, name in enumerate(names, start=1):
        given = plan.parameters(name)
        if not given["episodes"]:
            (plan.out / name / "episodes.csv").unlink(missing_ok=True)  # an earlier run's
            continue
        what = f"seeds {given['episodes']}, arms {', '.join(map(arm_name, given['arms']))}"
        if plan.pace and not plan.cluster and shard_of(plan.shard)[1] == 1:
            what += f"; {duration(seconds_of(given, plan.pace) / min(plan.jobs, given['episodes']))} or less"
        print(f"[{number}/{len(names)}] {name}: {what}", file=sys.stderr, flush=True)
        rows, reason = plan.out / name / "episodes.csv", ""
        try:
            rows.unlink(missing_ok=True)  # what an earlier run left does not stand for this one
            run_notebook(FOLDER / "case.ipynb", plan.out / f"{name}.ipynb", given, sys.stderr)
            if shard_of(plan.shard)[1] == 1 and not rows.exists():
                reason = "the notebook ended without rows"
        except Exception as error:
            # A cell that raised, a kernel that died, a disk that is full: this case's failure and no other's.
            reason = _reason(error)
        if reason:
            print(f"{name} failed: {reason}", file=sys.stderr, flush=True)
            failed.append((name, reason))
    return failed


def _reason(error: Exception) -> str:
    """One line for what went wrong in a notebook."""
    name, value = getattr(error, "ename", type(error).__name__), getattr(error, "evalue", error)
    return f"{name}: {' '.join(str(value).split())}"[:300]


def error_rows(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """(scenario and arm, reason) where episodes ended because something raised."""
    found = []
    for (scenario, arm), group in rows[rows.outcome == "error"].groupby(["scenario", "arm"], sort=True):
        found.append((f"{scenario}, {arm}", f"{len(group)} episodes raised; the first: {group.reason.iloc[0]}"))
    return found


def run_stress(plan: Plan) -> tuple[dict[str, pd.DataFrame], list[tuple[str, str]]]:
    """Tables of the whole stress test, and what failed with its reason.

    Writes the executed notebooks, the tables of `judge.judge`, figures, `failed.csv` and the report (`pages`) to
    `plan.out`; chunks that an earlier run with the same settings finished are not run again. A shard writes chunks
    alone, and its tables are empty: `merge` has the last word.

    Raises:
        UnusableInput: an arm nobody knows, no case came to its end, or the folder refuses.
    """
    try:
        plan.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnusableInput(f"{plan.out}: cannot be written: {error.strerror}") from None
    plan, failed = without_broken(plan)
    failed += run_cases(plan)
    if shard_of(plan.shard)[1] > 1:
        return {}, failed
    if not any((plan.out / name / "episodes.csv").exists() for name in all_cases()):
        reasons = "; ".join(dict.fromkeys(reason for _, reason in failed))
        raise UnusableInput(f"no case came to its end: {reasons}")
    tables = judge_folder(plan.out)
    failed += error_rows(tables["episodes"])
    print("tables and figures", file=sys.stderr, flush=True)
    try:
        summary = {"results": str(plan.out), "language": "en"}
        run_notebook(FOLDER / "summary.ipynb", plan.out / "summary.ipynb", summary, sys.stderr)
    except Exception as error:
        failed.append(("summary", _reason(error)))
    text = pd.DataFrame(failed, columns=["what", "reason"]).to_csv(index=False, lineterminator="\n")
    write_atomic(plan.out / FAILED, text)
    for name, content in text_tables(tables).items():
        write_atomic(plan.out / name, content)
    draw_chinese(plan.out)
    write_report(plan.out, tables, plan.command, failed)
    return tables, failed


def draw_chinese(out: Path) -> None:
    """The figures of the Chinese report that come from tables alone; a line where no Chinese font is installed."""
    from dualnav_lite.figures.results import make_result_figures

    try:
        make_result_figures(out, "zh", ("svg",), ("survival", "runs"))
    except UnusableInput as error:
        print(f"figures of the Chinese report are in English: {error}", file=sys.stderr, flush=True)


def merge_shards(folders: Sequence[Path], plan: Plan) -> tuple[dict[str, pd.DataFrame], list[tuple[str, str]]]:
    """Bring the chunks of several machines together in `plan.out` and judge them; nothing is run again.

    Raises:
        UnusableInput: a folder without a run, or chunks that are still missing, of the settings in `plan`.
    """
    for folder in folders:
        if not any(Path(folder).glob("*/run.json")):
            raise UnusableInput(f"{folder}: no stress run here")
        for chunk in sorted(Path(folder).glob("*/chunks/*.csv")):  # few chunks for many shards leave some with none
            write_atomic(plan.out / chunk.relative_to(folder), chunk.read_bytes())
    plan, broken = without_broken(plan)
    for name in all_cases():
        missing = missing_chunks(plan.parameters(name))
        if missing:
            raise UnusableInput(f"{name}: {missing} chunks of these settings are missing; run their shards first")
    tables, failed = run_stress(plan)
    return tables, broken + failed


def missing_chunks(given: dict[str, Any]) -> int:
    """Number of chunks of a case that no shard has finished."""
    config = with_overrides(Config(), given["overrides"] | {"preference": given["preference"]})
    prints = {arm: getattr(library_arm(arm, config), "fingerprint", "") for arm in given["arms"]}
    scenarios = [load_scenario(name) for name in load_case(given["case"]).scenarios]
    seeds = range(given["seed_base"], given["seed_base"] + given["episodes"])
    return sum(not chunk.is_done() for chunk in plan_chunks(prints, scenarios, seeds, config, Path(given["out"])))
