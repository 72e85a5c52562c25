"""What learns: policies, the predictor, the studies of their variants, and the drives that they learn from."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.commands import (
    CORES,
    TEST_SEED,
    Episodes,
    Jobs,
    Scenarios,
    Seeds,
    app,
    config_of,
    scenarios_of,
    words,
)
from dualnav_lite.config import UnusableInput


@app.command()
def train(
    config: Annotated[Path, typer.Option(help="What to do: training/lesson.yaml, training/record.yaml, ...")],
    run: Annotated[str, typer.Option(help="Name of the run's folder; the config's name and the seed if empty.")] = "",
    seed: Annotated[int | None, typer.Option(min=0, help="In place of the config's.")] = None,
    jobs: Jobs = CORES,
    out: Annotated[Path | None, typer.Option(help="Folder for the policy; the run's folder if not given.")] = None,
    device: Annotated[str, typer.Option(help="Where the networks learn: auto, cpu or cuda.")] = "auto",
    until: Annotated[str, typer.Option(help="Stop and export after this stage; all of them if empty.")] = "",
) -> int:
    """A policy or the predictor from a config: progress, checkpoints, logs; the same command goes on after a stop."""
    from dualnav_lite.train_predictor import is_predictor_config, train_predictor

    if is_predictor_config(config):
        if until:
            raise UnusableInput(f"{config}: the predictor's training has no stages, so --until does not fit")
        train_predictor(config, run or None, seed, jobs, out)
        return 0
    from dualnav_lite.train import TrainingStopped
    from dualnav_lite.train import train as run_training

    try:
        run_training(config, run or None, seed, jobs, out, device, until)
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
    scenarios: Scenarios = "",
    episodes: Episodes = 10,
    seed_base: Annotated[int, typer.Option(min=0, help="First seed; below 1000000 they are for training.")] = 0,
    config: Annotated[Path | None, typer.Option(help="config.yaml to use; the defaults if not given.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of scans/, maps/, movers/ and logs/.")] = Path("data"),
) -> int:
    """Drives kept whole: scans, maps, where everything really was, and a log of both objectives."""
    from dualnav_lite.recording import record as run

    settings, seeds = config_of(config), range(seed_base, seed_base + episodes)
    print(run(scenarios_of(scenarios, settings), words(arms), seeds, out, settings).to_string(index=False))
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
    out: Annotated[Path, typer.Option(help="Folder of studies.csv.")] = Path("results"),
) -> int:
    """Train and judge the variants of a study again; the same command goes on where it was stopped."""
    from dualnav_lite.studies import load_study, run_study
    from dualnav_lite.study_tables import summarise

    print(load_study(name).question)
    print(summarise(run_study(name, out, jobs)).to_string(index=False, float_format=lambda value: f"{value:.3f}"))
    return 0
