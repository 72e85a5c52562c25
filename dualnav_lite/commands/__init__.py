"""The command line: one app, what its commands share, and a file for each group of commands."""

import os
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.config import Config, UnusableInput, load_config
from dualnav_lite.episodes import SEEDS
from dualnav_lite.scenario import configured_scenarios

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
TEST_SEED = SEEDS["test"].start
CORES = os.cpu_count() or 1

Seeds = Annotated[int, typer.Option(min=0, max=2**62, help="First seed; 2000000 upward are the published test seeds.")]
Scenarios = Annotated[str, typer.Option(help="Ids or YAML files, by commas; the config's if empty.")]
Episodes = Annotated[int, typer.Option(min=1, help="Seeds of each scenario.")]
Jobs = Annotated[int, typer.Option(min=1, help="Worker processes.")]
Shard = Annotated[str, typer.Option(help="k/n: run every n-th chunk from the k-th.")]
Cluster = Annotated[str, typer.Option(help="tcp://host:port of a Dask scheduler in place of --jobs.")]


def config_of(path: Path | None) -> Config:
    """The settings in a file that is there; the defaults without one."""
    if path and not path.exists():
        raise UnusableInput(f"{path}: no such file")
    return load_config(path)


def scenarios_of(text: str, settings: Config) -> list[str]:
    """The scenarios that an option names; those of the settings where it is empty."""
    return words(text) if text else configured_scenarios(settings)


def words(text: str) -> list[str]:
    """The parts of a comma-separated option.

    Raises:
        UnusableInput: there are none.
    """
    found = [part.strip() for part in text.split(",") if part.strip()]
    if not found:
        raise UnusableInput(f"expected names separated by commas, got '{text}'")
    return list(dict.fromkeys(found))
