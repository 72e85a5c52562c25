"""The stress suite: run it, and bring its shards together."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.commands import CORES, TEST_SEED, Cluster, Episodes, Jobs, Seeds, Shard, app, words

Arms = Annotated[str, typer.Option(help="Arms, separated by commas, or all; ppo,ppo_filter if empty.")]
LongRuns = Annotated[int, typer.Option(min=0, help="Three-hour runs, driven by the first arm; 0 leaves them out.")]
Quick = Annotated[bool, typer.Option("--quick", help="5 seeds and one three-hour run.")]
Preference = Annotated[float, typer.Option(min=0, max=1, help="0 all safety, 1 all thrift.")]
Results = Annotated[Path | None, typer.Option(help="Results folder; stress_tests/results if not given.")]


def stress_plan(arms, episodes, long_runs, quick, seed_base, jobs, shard, cluster, preference, out):
    """What the options of `stress` and `merge` ask for, checked before anything runs."""
    from dualnav_lite.stress import FOLDER, POLICY_ARMS, Plan, all_arms, shard_of
    from dualnav_lite.workers import checked_address

    listed = arms if isinstance(arms, list) else words(arms or ",".join(POLICY_ARMS))
    chosen = all_arms() if arms == "all" else listed
    shard_of(shard)
    return Plan(
        arms=chosen,
        episodes=5 if quick else episodes,
        long_arms=chosen if arms == "all" else chosen[:1],
        long_runs=min(1, long_runs) if quick else long_runs,
        seed_base=seed_base,
        jobs=jobs,
        out=(out or FOLDER / "results").resolve(),
        command=" ".join(["python -m dualnav_lite", *sys.argv[1:]]),
        shard=shard,
        cluster=checked_address(cluster) if cluster else "",
        preference=preference,
    )


def show_stress(plan, tables, failed) -> int:
    """Print who survived, what failed and where the rest is; 1 where something failed or missed the article's rate."""
    from dualnav_lite.judge import PUBLISHED, beside_claim
    from dualnav_lite.report import terminal_lines
    from dualnav_lite.stress import POLICY_ARMS

    missed = False
    if tables:
        survival = tables["survival"]
        measured = survival[(survival.source != PUBLISHED) & survival.arm.isin(POLICY_ARMS)]
        missed = any(beside_claim(row) == "missed" for row in measured.itertuples())
        print("\n".join(terminal_lines(survival, tables["survival_strict"])))
        if "ablations" in tables:
            print("\nablations, held against ablation_default: ablations.csv, ablations_paired.csv, figure ablations")
        print(f"\nreport.html (report.zh.html), tables, figures and executed notebooks: {plan.out}")
    else:
        print(f"shard {plan.shard} is done: bring the shards' folders together by `merge`")
    for what, reason in failed:
        print(f"FAILED {what}: {reason}", file=sys.stderr)
    return 1 if failed or missed else 0


@app.command()
def stress(
    arms: Arms = "",
    episodes: Episodes = 1000,
    long_runs: LongRuns = 10,
    quick: Quick = False,
    seed_base: Seeds = TEST_SEED,
    jobs: Jobs = CORES,
    shard: Shard = "1/1",
    cluster: Cluster = "",
    preference: Preference = 0.5,
    parts: Annotated[
        Path | None, typer.Option(help="Your notebooks, or what `status --export` wrote: encoder, rewards, policy.")
    ] = None,
    out: Results = None,
) -> int:
    """The stress scenarios through papermill; prints who survived. Stopped, the same command goes on."""
    from dualnav_lite.pace import estimate, paces
    from dualnav_lite.stress import run_stress

    chosen: str | list[str] = arms
    if parts:
        from dualnav_lite.parts import arms_with_parts

        chosen = arms_with_parts(parts, words(arms) if arms else [])
    plan = stress_plan(chosen, episodes, long_runs, quick, seed_base, jobs, shard, cluster, preference, out)
    pace = paces([*plan.arms, *plan.long_arms])
    if pace:
        plan = replace(plan, pace=pace)
        print(estimate(plan, pace), file=sys.stderr, flush=True)
    return show_stress(plan, *run_stress(plan))


@app.command()
def merge(
    folders: Annotated[str, typer.Argument(help="Results folders of the shards, separated by commas.")],
    arms: Arms = "",
    episodes: Episodes = 1000,
    long_runs: LongRuns = 10,
    quick: Quick = False,
    seed_base: Seeds = TEST_SEED,
    preference: Preference = 0.5,
    out: Results = None,
) -> int:
    """Shards of `stress`, given the settings they ran with, to the tables of the whole."""
    from dualnav_lite.stress import merge_shards

    plan = stress_plan(arms, episodes, long_runs, quick, seed_base, 1, "1/1", "", preference, out)
    return show_stress(plan, *merge_shards([Path(folder).resolve() for folder in words(folders)], plan))
