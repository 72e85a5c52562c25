"""The commands: `python -m dualnav_lite --help`. Exit codes: 0 done, 1 something stayed undone, 2 unusable input."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite import __version__
from dualnav_lite.config import UnusableInput
from dualnav_lite.episodes import SEEDS

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
TEST_SEED = SEEDS["test"].start
CORES = os.cpu_count() or 1
INTERRUPTED = 130

Seeds = Annotated[int, typer.Option(min=0, help="First seed; 2000000 upward are the published test seeds.")]
Episodes = Annotated[int, typer.Option(min=1, help="Seeds of each scenario.")]
Jobs = Annotated[int, typer.Option(min=1, help="Worker processes.")]


def words(text: str) -> list[str]:
    """The parts of a comma-separated option.

    Raises:
        UnusableInput: there are none.
    """
    found = [part.strip() for part in text.split(",") if part.strip()]
    if not found:
        raise UnusableInput(f"expected names separated by commas, got '{text}'")
    return list(dict.fromkeys(found))


def stress_plan(arms, episodes, long_runs, quick, seed_base, jobs, shard, cluster, preference, out):
    """What the options of `stress` and `merge` ask for, checked before anything runs."""
    from dualnav_lite.stress import FOLDER, POLICY_ARMS, Plan, all_arms, shard_of
    from dualnav_lite.workers import checked_address

    chosen = all_arms() if arms == "all" else words(arms or ",".join(POLICY_ARMS))
    shard_of(shard)
    return Plan(
        arms=chosen,
        episodes=5 if quick else episodes,
        long_arms=chosen if arms == "all" else chosen[:1],
        long_runs=1 if quick else long_runs,
        seed_base=seed_base,
        jobs=jobs,
        out=(out or FOLDER / "results").resolve(),
        command=" ".join(["python -m dualnav_lite", *sys.argv[1:]]),
        shard=shard,
        cluster=checked_address(cluster) if cluster else "",
        preference=preference,
    )


def show_stress(plan, tables, failed) -> int:
    """Print who survived, what failed and where the rest is."""
    from dualnav_lite.report import survival_lines

    if tables:
        print("\n".join(survival_lines(tables["survival"])))
        print(f"\nreport, tables, figures and executed notebooks: {plan.out}")
    else:
        print(f"shard {plan.shard} is done: bring the shards' folders together by `merge`")
    for what, reason in failed:
        print(f"FAILED {what}: {reason}", file=sys.stderr)
    return 1 if failed else 0


Arms = Annotated[str, typer.Option(help="Arms, separated by commas, or all; ppo,ppo_filter if empty.")]
LongRuns = Annotated[int, typer.Option(min=1, help="Seeds of the three-hour scenario, driven by the first arm.")]
Quick = Annotated[bool, typer.Option("--quick", help="5 seeds and one three-hour run.")]
Shard = Annotated[str, typer.Option(help="k/n: run every n-th chunk from the k-th.")]
Cluster = Annotated[str, typer.Option(help="tcp://host:port of a Dask scheduler in place of --jobs.")]
Preference = Annotated[float, typer.Option(min=0, max=1, help="0 all safety, 1 all thrift.")]
Results = Annotated[Path | None, typer.Option(help="Results folder; stress_tests/results if not given.")]


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
        Path | None, typer.Option(help="Folder of `status --export`: your encoder, rewards, policy.")
    ] = None,
    out: Results = None,
) -> int:
    """The stress scenarios through papermill; prints who survived. Stopped, the same command goes on."""
    from dualnav_lite.pace import estimate
    from dualnav_lite.stress import run_stress

    if parts:
        from dualnav_lite.parts import arms_with_parts

        arms = ",".join(arms_with_parts(parts, words(arms) if arms else []))
    plan = stress_plan(arms, episodes, long_runs, quick, seed_base, jobs, shard, cluster, preference, out)
    if arms == "all":
        print(estimate(plan), file=sys.stderr, flush=True)
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


@app.command()
def evaluate(
    arms: Annotated[str, typer.Argument(help="ppo, ppo_filter, planners, .onnx files, by commas.")],
    scenarios: Annotated[str, typer.Option(help="Scenario ids or YAML files, separated by commas.")] = "navigation",
    episodes: Episodes = 100,
    seed_base: Seeds = TEST_SEED,
    jobs: Jobs = CORES,
    shard: Shard = "1/1",
    cluster: Cluster = "",
    config: Annotated[Path | None, typer.Option(help="config.yaml to use; the defaults if not given.")] = None,
    preference: Annotated[float | None, typer.Option(help="0 all safety, 1 all thrift.")] = None,
    out: Annotated[Path, typer.Option(help="Results folder.")] = Path("results"),
) -> int:
    """Policies and planners over scenarios and seeds, to episodes.csv and survival.csv; stopped, it goes on."""
    from dualnav_lite.config import load_config, write_atomic
    from dualnav_lite.evaluate import evaluate as run
    from dualnav_lite.report import survival_lines
    from dualnav_lite.stress import shard_of
    from dualnav_lite.survival import survival

    if config and not config.exists():
        raise UnusableInput(f"{config}: no such file")
    rows = run(
        words(arms),
        words(scenarios),
        range(seed_base, seed_base + episodes),
        out,
        config=load_config(config),
        preference=preference,
        jobs=jobs,
        shard=shard_of(shard),
        cluster=cluster,
    )
    table = survival(rows)
    write_atomic(out / "survival.csv", table.to_csv(index=False, lineterminator="\n"))
    print("\n".join(survival_lines(table)))
    return 0


@app.command()
def measure(
    name: Annotated[str, typer.Argument(help="A name of dualnav_lite/measures.py; a wrong one lists them.")],
    arms: Annotated[str, typer.Option(help="Arms, separated by commas; the measurement's own if empty.")] = "",
    scenarios: Annotated[str, typer.Option(help="Scenario ids, separated by commas; its own if empty.")] = "",
    episodes: Annotated[int, typer.Option(min=0, help="Seeds of each; its own number if 0.")] = 0,
    seed_base: Seeds = TEST_SEED,
    jobs: Jobs = CORES,
    out: Annotated[Path, typer.Option(help="Folder of the CSVs.")] = Path("results"),
) -> int:
    """Fronts of preferences, the battery band, latency, three hours minute by minute, differential evolution."""
    from dualnav_lite.measures import Options
    from dualnav_lite.measures import run as run_measure

    options = Options(
        out, words(arms) if arms else (), words(scenarios) if scenarios else (), episodes, seed_base, jobs
    )
    for table, content in run_measure(name, options).items():
        if len(content) <= 60:
            print(content.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
        print(f"{out / table}.csv: {len(content)} rows\n")
    return 0


@app.command()
def publish(
    work: Annotated[Path, typer.Option(help="Folder for the chunks; the same command goes on from them.")],
    to: Annotated[Path | None, typer.Option(help="Where the rows go; stress_tests/reference if not given.")] = None,
    share: Annotated[float, typer.Option(min=0, max=1, help="Of the numbers of seeds, to try it.")] = 1.0,
    only: Annotated[str, typer.Option(help="Blocks: main, rest, long_ppo, long_filter, long_rest.")] = "",
    jobs: Jobs = CORES,
) -> int:
    """The published rows of every arm on the test seeds, again: hours."""
    from dualnav_lite.publish import publish as run_publish
    from dualnav_lite.reference import REFERENCE

    command = " ".join(["python -m dualnav_lite", *sys.argv[1:]])
    rows = run_publish(work, to or REFERENCE, share, jobs, words(only) if only else (), command)
    print(f"{len(rows)} rows in {to or REFERENCE}")
    return 0


@app.command()
def claims(
    results: Annotated[Path | None, typer.Option(help="Tables that come before the published ones.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of CLAIMS.md; docs if not given.")] = None,
) -> int:
    """The article's claims beside what was measured: claims.csv and CLAIMS.md."""
    from dualnav_lite.claims import all_claims, claims_page, claims_table, reference_tables
    from dualnav_lite.config import write_atomic
    from dualnav_lite.judge import csv_text
    from dualnav_lite.notebooks import ROOT
    from dualnav_lite.reference import REFERENCE

    known = all_claims()
    table = claims_table(known, reference_tables(results))
    write_atomic((out or REFERENCE) / "claims.csv", csv_text(table))
    write_atomic((out or ROOT / "docs") / "CLAIMS.md", claims_page(known, table))
    columns = ["claim", "article_value", "verdict", "our_value", "low", "high", "n"]
    print(table[columns].to_string(index=False, float_format=lambda value: f"{value:.3g}", na_rep=""))
    return 0


@app.command()
def bench(
    seconds: Annotated[float, typer.Option(min=0.05, help="Time for each measurement.")] = 2.0,
    peers: Annotated[bool, typer.Option("--peers/--no-peers", help="Measure other simulators in the same run.")] = True,
    out: Annotated[Path, typer.Option(help="Folder of bench.csv.")] = Path("results"),
) -> int:
    """Speed of everything that is waited for; exit 1 where a first target is missed."""
    from dualnav_lite.bench import run

    rows = run(out, seconds=seconds, with_peers=peers)
    return 1 if any(row.verdict == "below" for row in rows) else 0


@app.command()
def figures(
    names: Annotated[str, typer.Argument(help="Figures, separated by commas; all if not given.")] = "",
    lang: Annotated[str, typer.Option(help="en or zh.")] = "en",
    formats: Annotated[str, typer.Option(help="Of png, svg and pdf, separated by commas.")] = "png",
    results: Annotated[Path | None, typer.Option(help="Draw the figures of this results folder instead.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; docs/figures if not given.")] = None,
) -> int:
    """Draw the figures of the documentation, or those of a results folder, into figures/ there."""
    if results:
        from dualnav_lite.figures.results import make_result_figures

        drawn = make_result_figures(results, lang, tuple(words(formats)), words(names) if names else None)
        print("\n".join(str(path) for path in drawn))
        return 0
    from dualnav_lite.figures import make_figures
    from dualnav_lite.notebooks import ROOT

    folder = out or ROOT / "docs" / "figures"
    made = make_figures(folder, lang, words(names) if names else None, formats=tuple(words(formats)))
    print("\n".join(str(path) for path in made))
    return 0


@app.command()
def train(
    config: Annotated[Path, typer.Option(help="What to do: training/lesson.yaml, training/record.yaml, ...")],
    run: Annotated[str, typer.Option(help="Name of the run's folder; the config's name and the seed if empty.")] = "",
    seed: Annotated[int | None, typer.Option(min=0, help="In place of the config's.")] = None,
    jobs: Jobs = CORES,
    out: Annotated[Path | None, typer.Option(help="Folder for the policy; the run's folder if not given.")] = None,
    device: Annotated[str, typer.Option(help="Where the networks learn: auto, cpu or cuda.")] = "auto",
) -> int:
    """A policy or the predictor from a config: progress, checkpoints, logs; the same command goes on after a stop."""
    from dualnav_lite.train_predictor import is_predictor_config, train_predictor

    if is_predictor_config(config):
        train_predictor(config, run or None, seed, jobs, out)
        return 0
    from dualnav_lite.train import TrainingStopped
    from dualnav_lite.train import train as run_training

    try:
        run_training(config, run or None, seed, jobs, out, device)
    except TrainingStopped as error:
        print(f"stopped: {error}", file=sys.stderr)
        return 1
    return 0


@app.command()
def card(
    log: Annotated[Path, typer.Option(help="log.csv of the training's run folder.")],
    rows: Annotated[Path, typer.Option(help="episodes.csv of the policy on tuning seeds.")],
    commit: Annotated[str, typer.Option(help="Code that trained.")],
    minutes: Annotated[float, typer.Option(min=0, help="Time the training took.")],
    training: Annotated[str, typer.Option(help="The training's config.")] = "training/record.yaml",
) -> int:
    """Write models/README.md from the weights, the training's log and evaluated rows."""
    from dualnav_lite.model_card import write_card

    print(write_card(training, log, rows, commit, minutes))
    return 0


@app.command()
def record(
    arms: Annotated[str, typer.Argument(help="Planners, separated by commas.")] = "cv_sampling",
    scenarios: Annotated[str, typer.Option(help="Scenario ids or YAML files, separated by commas.")] = "navigation",
    episodes: Episodes = 10,
    seed_base: Annotated[int, typer.Option(min=0, help="First seed; below 1000000 they are for training.")] = 0,
    config: Annotated[Path | None, typer.Option(help="config.yaml to use; the defaults if not given.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of scans/, maps/, movers/ and logs/.")] = Path("data"),
) -> int:
    """Drives kept whole: scans, maps, where everything really was, and a log of both objectives."""
    from dualnav_lite.config import load_config
    from dualnav_lite.recording import record as run

    if config and not config.exists():
        raise UnusableInput(f"{config}: no such file")
    seeds = range(seed_base, seed_base + episodes)
    print(run(words(scenarios), words(arms), seeds, out, load_config(config)).to_string(index=False))
    return 0


@app.command()
def predictor(
    weights: Annotated[Path | None, typer.Option(help="A .npz file; models/predictor.npz if not given.")] = None,
    scenarios: Annotated[str, typer.Option(help="Families, separated by commas; the unseen ones if empty.")] = "",
    episodes: Episodes = 100,
    seed_base: Seeds = TEST_SEED,
    jobs: Jobs = CORES,
    out: Annotated[Path, typer.Option(help="Folder of predictor.csv.")] = Path("results"),
) -> int:
    """Where will people be: the LSTM beside constant velocity, on families that it has not seen; predictor.csv."""
    from dualnav_lite.config import write_atomic
    from dualnav_lite.train_predictor import UNSEEN, judge_predictor

    families = words(scenarios) if scenarios else list(UNSEEN)
    table = judge_predictor(weights, families, episodes, seed_base, jobs=jobs).round(4)
    write_atomic(out / "predictor.csv", table.to_csv(index=False, lineterminator="\n"))
    print(table.to_string(index=False))
    return 0


@app.command()
def study(
    name: Annotated[str, typer.Argument(help="One of training/studies, or the path of a YAML file.")],
    jobs: Jobs = CORES,
    out: Annotated[Path, typer.Option(help="Folder of the study's CSV.")] = Path("results"),
) -> int:
    """Train and judge the variants of a study again; the same command goes on where it was stopped."""
    from dualnav_lite.studies import load_study, run_study, summarise

    print(load_study(name).question)
    print(summarise(run_study(name, out, jobs)).to_string(index=False, float_format=lambda value: f"{value:.3f}"))
    return 0


@app.command()
def beyond(
    name: Annotated[str, typer.Argument(help="One of the tables in dualnav_lite/beyond.py, as crowdnav.")],
    quick: Annotated[bool, typer.Option("--quick", help="A few episodes, to see that it works.")] = False,
    out: Annotated[Path, typer.Option(help="Folder of the table's CSV.")] = Path("results"),
) -> int:
    """Measure a table from beyond the kit's own world again: CrowdNav's protocol and others."""
    from dualnav_lite.beyond import run as measure

    print(measure(name, out, quick).to_string(index=False, float_format=lambda value: f"{value:.3f}"))
    return 0


@app.command()
def notebooks(
    check: Annotated[bool, typer.Option("--check", help="Change nothing; exit 1 where something differs.")] = False,
    take_back: Annotated[str, typer.Option(help="Bring an edit made in JupyterLab into the source, as in 00.")] = "",
) -> int:
    """Rebuild every notebook from its source in src/."""
    from dualnav_lite import notebooks as pipeline

    if take_back:
        print(f"taken back into src/{pipeline.take_back(take_back).name}")
        return 0
    changed = pipeline.rebuild(check=check)
    for path in changed:
        print(f"{'differs from its source' if check else 'rebuilt'}: {path.parent.name}/{path.name}")
    if not changed:
        print("every notebook is what its source makes")
    return 1 if check and changed else 0


@app.command()
def release(
    out: Annotated[Path, typer.Argument(help="A folder that is not there yet.")],
    lessons_only: Annotated[
        bool, typer.Option("--lessons-only", help="The notebooks alone; keeps those there.")
    ] = False,
) -> int:
    """The student version: stubs in place of solutions, the library whole."""
    from dualnav_lite import course

    if lessons_only:
        written = course.write_lessons(out)
        print(f"{len(written)} lessons written to {out}" if written else f"every lesson is in {out} already")
        return 0
    print(f"student version: {course.release(out)}")
    return 0


@app.command()
def status(
    folder: Annotated[Path, typer.Argument(help="Folder with the lessons' notebooks.")] = Path("notebooks"),
    export: Annotated[Path | None, typer.Option(help="Write your parts here, for `stress --parts`.")] = None,
    lang: Annotated[str | None, typer.Option(help="en or zh; $DUALNAV_LANG if not given.")] = None,
) -> int:
    """Which exercises pass, and whose part is used for each; with --export, your parts as a folder."""
    from dualnav_lite import parts

    if not folder.is_dir():
        raise UnusableInput(f"{folder}: no such folder")
    parts.status(folder, lang)
    if export:
        found = parts.export_parts(folder, export)
        print(f"{sum(one.is_yours for one in found.values())} of your parts: {export}")
    return 0


@app.command()
def submit(
    student: Annotated[str, typer.Argument(help="Your id, as your teacher knows it.")],
    folder: Annotated[Path, typer.Option(help="Folder with your notebooks.")] = Path("notebooks"),
    out: Annotated[Path | None, typer.Option(help="submission_STUDENT if not given.")] = None,
    episodes: Annotated[int, typer.Option(min=0, help="Runs of each scenario; 0 leaves them out.")] = 50,
) -> int:
    """Check your notebooks, drive your policy a little, and pack the folder that is handed in."""
    from dualnav_lite import submission

    if not folder.is_dir():
        raise UnusableInput(f"{folder}: no such folder")
    target = submission.pack(folder, student, out or Path(f"submission_{student}"))
    if episodes:
        submission.try_out(folder, target, episodes)
    print(f"hand in this folder: {target}")
    return 0


@app.command()
def doctor() -> int:
    """What works on this machine: versions, sandbox, fonts, browser, cores, speed."""
    from dualnav_lite.doctor import findings

    problems = 0
    for finding in findings():
        problems += finding.is_problem
        print(f"{'PROBLEM' if finding.is_problem else 'ok':<8}{finding.subject:<14}{finding.text}", flush=True)
    return 1 if problems else 0


@app.command()
def warm() -> int:
    """Compile every kernel now, so that no later command waits for it."""
    from dualnav_lite.warm import warm_kernels

    warm_kernels()
    return 0


@app.callback(invoke_without_command=True)
def common(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and end.")] = False,
) -> None:
    """dualnav-lite: robot navigation by reinforcement learning, safe and thrifty at once.

    Exit codes: 0 done, 1 a result falls short or something stayed undone, 2 unusable input.
    """
    if version:
        print(__version__)
    elif context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(2)


def main(arguments: list[str] | None = None) -> int:
    """Run a command and give its exit code; what cannot be used ends in one line on stderr and code 2."""
    try:
        code = app(arguments, standalone_mode=False) or 0
    except (UnusableInput, typer.TyperException) as error:
        message = getattr(error, "format_message", error.__str__)()
        print(f"error: {' '.join(message.split())}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    if code == INTERRUPTED:  # typer turns Ctrl-C into this code by itself, without a word
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
