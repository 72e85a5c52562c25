"""The predictor's training as a product: drives, samples, fit, the same files for any number of processes and stops."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import joblib
import numpy as np
import torch
from pydantic import Field, NonNegativeInt, PositiveInt

from dualnav_lite import __version__, streams
from dualnav_lite.config import Frozen, UnusableInput, dump_config, read_yaml, validated, write_atomic
from dualnav_lite.curriculum import claim_folder, runs_folder
from dualnav_lite.episodes import SEEDS
from dualnav_lite.forecast import LstmPredictor
from dualnav_lite.forecast_errors import errors_of, table_of
from dualnav_lite.predictor import Samples, Settings, fit, save
from dualnav_lite.recording import drive
from dualnav_lite.scenario import load_scenario
from dualnav_lite.tracking import ConstantVelocityPredictor

SHARD_EPISODES = 20
UNSEEN = ("crowd_crossing", "crowd_reactive", "pop_up", "pop_up_cover")  # families that no training may hold
ARMS = ("astar", "cv_sampling")


class PredictorTraining(Frozen):
    """What `training/predictor.yaml` holds."""

    kind: Literal["predictor"]
    title: str
    seed: NonNegativeInt = 0
    arms: Annotated[list[str], Field(min_length=1)] = list(ARMS)  # drivers, shard by shard in turn  # noqa: RUF012
    families: Annotated[dict[str, PositiveInt], Field(min_length=1)]  # scenario id or file: episodes
    every: PositiveInt = 3  # frames between two samples of an episode
    fit: Settings = Settings()


def is_predictor_config(path: str | Path) -> bool:
    """Whether a training file asks for a predictor, not for a policy."""
    values = read_yaml(path)
    return isinstance(values, dict) and values.get("kind") == "predictor"


def load_predictor_training(path: str | Path, seed: int | None = None) -> PredictorTraining:
    """The settings in a file; `UnusableInput` names a wrong key, an unknown scenario, or one kept for the judgement."""
    training = validated(PredictorTraining, read_yaml(path), str(path))
    for family in training.families:
        scenario = load_scenario(_place(family, path), "pymunk")
        if scenario.id in UNSEEN:
            raise UnusableInput(f"{path}: '{scenario.id}' is kept for the judgement; unseen: {', '.join(UNSEEN)}")
    return training if seed is None else training.model_copy(update={"seed": seed})


def _place(family: str, config: str | Path) -> str:
    return str(Path(config).parent / family) if family.endswith(".yaml") else family


def _collect_shard(path: Path, scenario: str, arm: str, seeds, every: int) -> None:
    """Drive some episodes and keep their samples; nothing where they are kept already."""
    if path.exists():
        return
    torch.set_num_threads(1)
    samples = Samples.join(Samples.of(one, every) for one in drive(scenario, arm, seeds))
    write_atomic(path, lambda file: np.savez(file, **vars(samples)))


def _load_shard(path: Path) -> Samples:
    with np.load(path, allow_pickle=False) as found:
        return Samples(**{name: found[name] for name in found.files})


def collect(training: PredictorTraining, config: str | Path, folder: Path, jobs: int, say) -> list[Path]:
    """Samples of all families, in shards; those that exist are not driven again."""
    calls, paths = [], []
    for family, episodes in training.families.items():
        scenario = _place(family, config)
        seeds = streams.stream(training.seed, f"predictor {family}").integers(SEEDS["train"].stop, size=episodes)
        for k, first in enumerate(range(0, episodes, SHARD_EPISODES)):
            arm = training.arms[k % len(training.arms)]
            path = folder / "samples" / f"{Path(family).stem}_{k:03d}.npz"
            part = seeds[first : first + SHARD_EPISODES].tolist()
            calls.append(joblib.delayed(_collect_shard)(path, scenario, arm, part, training.every))
            paths.append(path)
    begin = time.monotonic()
    for done, _ in enumerate(joblib.Parallel(n_jobs=jobs, return_as="generator")(calls), 1):
        left = (time.monotonic() - begin) / done * (len(calls) - done)
        if done % 5 == 0 or done == len(calls):
            say(f"drives: {done} of {len(calls)} shards, {left / 60:.1f} min left")
    return paths


def train_predictor(
    config: str | Path,
    run: str | None = None,
    seed: int | None = None,
    jobs: int = 1,
    out: str | Path | None = None,
    say: Callable[[str], None] = print,
) -> Path:
    """Train what a file like `training/predictor.yaml` says, or go on with its drives; the run's folder.

    Args:
        config: the file.
        run: name of the run's folder; the file's name and the seed if None.
        seed: in place of the file's.
        jobs: processes that drive; the result does not depend on it.
        out: folder for `predictor.pth` and `.npz`; None leaves them in the run's folder.
        say: where lines for people go.

    Raises:
        UnusableInput: a setting, scenario or folder that cannot be used; a folder of another run.
        FloatingPointError: a loss that is no number.
    """
    training = load_predictor_training(config, seed)
    folder = runs_folder() / (run or f"{Path(config).stem}-seed{training.seed}")
    claim_folder(folder, training)
    say(f"{training.title}; run folder {folder}")
    begin = time.monotonic()
    samples = Samples.join(map(_load_shard, collect(training, config, folder, jobs, say)))
    driven = time.monotonic()
    say(f"{len(samples):,} samples of movers; {(driven - begin) / 60:.1f} min")
    torch.set_num_threads(1)
    total = training.fit.updates
    lines = ["update,loss_m"]

    def log(update: int, loss: float) -> None:
        left = (time.monotonic() - driven) / update * (total - update)
        say(f"update {update:,} of {total:,}: loss {loss:.4f} m, {left / 60:.1f} min left")
        lines.append(f"{update},{loss:.5f}")
        write_atomic(folder / "log.csv", "\n".join(lines) + "\n")

    network = fit(samples, training.fit, training.seed, log)
    card: dict[str, Any] = {"kit_version": __version__, "samples": len(samples), "training": dump_config(training)}
    paths = save(network, card, out or folder)
    say(f"predictor: {paths['pth']}, {paths['npz']}; fit in {(time.monotonic() - driven) / 60:.1f} min")
    return folder


def judge_predictor(
    predictor: str | Path | None = None,
    families=UNSEEN,
    episodes: int = 100,
    seed_base: int = SEEDS["test"].start,
    jobs: int = 1,
):
    """`predictor.csv`: constant velocity and the LSTM on the same movers of families it was not trained on.

    Args:
        predictor: a `.npz` file; the shipped one if None.
        families: scenarios.
        episodes: of each, shared out to `ARMS` in turn.
        seed_base: first seed.
        jobs: processes.

    Returns:
        Table with `forecast_errors.COLUMNS`; a last pair of rows, family `all`, pools the families.
    """
    LstmPredictor.load(predictor)  # a wrong file ends here, before the drives
    calls, owners = [], []
    for family in families:
        load_scenario(family, "pymunk")
        for k in range(0, episodes, SHARD_EPISODES):
            seeds = [seed_base + i for i in range(k, min(k + SHARD_EPISODES, episodes))]
            arm = ARMS[(k // SHARD_EPISODES) % len(ARMS)]
            calls.append(joblib.delayed(_judge_shard)(family, arm, seeds, predictor))
            owners.append(family)
    errors: dict[str, dict[str, list[np.ndarray]]] = {}
    for family, found in zip(owners, joblib.Parallel(n_jobs=jobs)(calls), strict=True):
        for name, distances in found.items():
            for row in (family, "all"):
                errors.setdefault(row, {}).setdefault(name, []).append(distances)
    errors["all"] = errors.pop("all")
    return table_of({family: {k: np.concatenate(v) for k, v in found.items()} for family, found in errors.items()})


def _judge_shard(family: str, arm: str, seeds, predictor):
    models: dict[str, Any] = {"constant_velocity": ConstantVelocityPredictor(), "lstm": LstmPredictor.load(predictor)}
    found = [errors_of(models, one) for one in drive(family, arm, seeds)]
    return {name: np.concatenate([one[name] for one in found]) for name in models}
