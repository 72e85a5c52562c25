"""What a training does, as data: stages with their scenarios and settings, read from `training/*.yaml`."""

import os
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from dualnav_lite.config import (
    Config,
    Frozen,
    NonNegative,
    Share,
    UnusableInput,
    dump_config,
    read_yaml,
    validated,
    with_overrides,
    write_atomic,
)
from dualnav_lite.imitation import Imitation
from dualnav_lite.ppo import PPO
from dualnav_lite.scenario import Scenario, load_scenario


class Stage(Frozen):
    """One part of a training: a kind, the scenarios each episode is drawn from, and its own settings."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9_]+$")]
    kind: Literal["imitate", "ppo"]
    scenarios: Annotated[list[str], Field(min_length=1)]  # a scenario named twice is drawn twice as often
    steps: PositiveInt = 500_000  # of ppo, over all worlds
    rollout_steps: PositiveInt = 64  # of each world between updates
    segment_updates: PositiveInt = 16  # updates between checkpoints; every world begins anew after one
    warm_up_updates: NonNegativeInt = 0  # at first only the values learn
    imitation: Imitation = Imitation()
    ppo: PPO = PPO()


class Training(Frozen):
    """A whole training; `training/*.yaml` hold these keys."""

    title: str
    seed: NonNegativeInt = 0
    worlds: PositiveInt = 32
    memory: Share = 0.5  # of the `CommandReader` that the exported policy drives with
    head: Literal["commands", "gaussian"] = "commands"
    grain: Literal["fine", "coarse", "flat"] = "fine"  # of the image's first convolution (`trunks.GRAINS`)
    config: dict[str, Any] = {}  # changes to `config.Config`, by dotted key  # noqa: RUF012
    max_minutes: NonNegative = 0.0  # end after the checkpoint that follows; 0 for no limit
    stages: Annotated[list[Stage], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits_together(self):
        names = [stage.name for stage in self.stages]
        if len(set(names)) != len(names):
            raise ValueError(f"stage names must differ, got {', '.join(names)}")
        layout = self.config.get("observation.layout", "image")
        if (self.grain == "flat") != (layout == "flat"):
            raise ValueError(f"grain 'flat' and observation.layout 'flat' go together, got '{self.grain}', '{layout}'")
        return self


def load_training(path: str | Path, seed: int | None = None) -> Training:
    """The training in a YAML file, with every scenario and setting checked.

    Raises:
        UnusableInput: a key, scenario or setting that is wrong, named.
    """
    training = validated(Training, read_yaml(path), str(path))
    if seed is not None:
        training = training.model_copy(update={"seed": seed})
    resolved_config(training)
    for stage in training.stages:
        scenarios_of(stage, Path(path).parent)
    return training


def scenarios_of(stage: Stage, home: Path) -> list[Scenario]:
    """The scenarios of a stage, by id or by a path that is seen from `home`, the folder of the training's file."""
    return [load_scenario(str(home / one) if one.endswith(".yaml") else one, "pymunk") for one in stage.scenarios]


def resolved_config(training: Training) -> Config:
    """The environment's configuration of a training; preferences are drawn, so that one policy covers the front."""
    return with_overrides(Config(), {"preference": "drawn"} | training.config)


def claim_folder(folder: Path, settings: Frozen) -> None:
    """Keep a run's settings in its folder; `UnusableInput` where those of another run lie there."""
    kept, text = folder / "training.yaml", dump_config(settings)
    if not kept.exists():
        write_atomic(kept, text)
    elif kept.read_text(encoding="utf-8") != text:
        raise UnusableInput(f"{folder}: holds a run with other settings; name another run or remove it")


def runs_folder() -> Path:
    """Where long runs go: `$DUALNAV_RUNS`, else the user's cache folder; never only the checkout."""
    if os.environ.get("DUALNAV_RUNS"):
        return Path(os.environ["DUALNAV_RUNS"])
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return base / "dualnav-lite" / "runs"
