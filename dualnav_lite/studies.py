"""Studies as data (`training/studies/`): variants of one training, several seeds each, judged on the same seeds."""

from pathlib import Path
from typing import Annotated, Any, Literal

import joblib
import pandas as pd
from pydantic import Field, PositiveInt
from tqdm import tqdm

from dualnav_lite.config import Frozen, UnusableInput, read_yaml, validated, write_atomic
from dualnav_lite.curriculum import Training, resolved_config, runs_folder, scenarios_of
from dualnav_lite.drivers import ABLATION_FOLDER, EmbeddedPolicy
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import evaluate
from dualnav_lite.judge import csv_text
from dualnav_lite.study_tables import COLUMNS, FOLDER, in_order, read_studies
from dualnav_lite.survival import survival
from dualnav_lite.train import Trainer


class Variant(Frozen):
    """What a variant changes in the study's training; what it does not name stays."""

    config: dict[str, Any] = {}  # dotted keys of `config.Config`  # noqa: RUF012
    ppo: dict[str, Any] = {}  # settings of every PPO stage  # noqa: RUF012
    head: str | None = None
    grain: str | None = None
    learner: Literal["ours", "stable_baselines3"] = "ours"


class Judge(Frozen):
    """Where the trained policies are compared."""

    scenarios: Annotated[list[str], Field(min_length=1)]
    episodes: PositiveInt = 200
    seed_base: Annotated[int, Field(ge=SEEDS["tuning"].start, lt=SEEDS["tuning"].stop)] = 1_050_000


class Study(Frozen):
    """A question, the training that answers it, and its variants; the first is what the others are held against."""

    title: str
    question: str
    training: Training
    variants: Annotated[dict[str, Variant], Field(min_length=1)]
    seeds: Annotated[list[int], Field(min_length=1)]
    judge: Judge
    arms: bool = False  # policies of the first seed become arms: `models/ablations/<study>_<variant>.onnx`

    def training_of(self, variant: str, seed: int) -> Training:
        """The training of one run, checked again as a whole."""
        changes, values = self.variants[variant], self.training.model_dump()
        values["title"], values["seed"] = f"{self.title}: {variant}", seed
        values["config"] |= changes.config
        values |= {name: value for name in ("head", "grain") if (value := getattr(changes, name))}
        for stage in values["stages"]:
            stage["ppo"] |= changes.ppo
        return validated(Training, values, f"variant {variant}")


def path_of(name: str) -> Path:
    """File of a study: its name in `training/studies`, or a path that ends in .yaml."""
    return Path(name) if name.endswith(".yaml") else FOLDER / f"{name}.yaml"


def load_study(name: str) -> Study:
    """The study of `path_of(name)`, every variant checked.

    Raises:
        UnusableInput: an unknown name, or a key that is wrong, named.
    """
    path = path_of(name)
    if not path.exists():
        known = ", ".join(sorted(one.stem for one in FOLDER.glob("*.yaml")))
        raise UnusableInput(f"unknown study '{name}'; known: {known}")
    study = validated(Study, read_yaml(path), str(path))
    for variant in study.variants:
        training = study.training_of(variant, 0)
        resolved_config(training)
        for stage in training.stages:
            scenarios_of(stage, path.parent)
    return study


def train_one(study: Study, variant: str, seed: int, folder: Path, home: Path):
    """Train one run, or go on with it; the policy's file and what `evaluate` makes its driver with."""
    training = study.training_of(variant, seed)
    if study.variants[variant].learner == "ours":
        trainer = Trainer(training, folder, home, workers=1, device="cpu", say=lambda text: None)
        trainer.run()
        return trainer.export(folder)["onnx"], lambda path, config: EmbeddedPolicy(path)
    from dualnav_lite.peer_ppo import StableDriver, train_stable

    path = folder / "policy.zip"
    if not path.exists():
        train_stable(training, path, home)
    return path, lambda path, config: StableDriver(path, training.config, seed)


def _folder(name: str, variant: str, seed: int) -> Path:
    """Where a run trains."""
    return runs_folder() / f"study_{Path(name).stem}" / f"{variant}-seed{seed}"


def run_one(name: str, variant: str, seed: int) -> list[dict]:
    """Train and judge one variant with one seed; rows, one a scenario. What was done before is not done again."""
    study = load_study(name)
    judge, folder = study.judge, _folder(name, variant, seed)
    policy, make_driver = train_one(study, variant, seed, folder, path_of(name).parent)
    seeds = range(judge.seed_base, judge.seed_base + judge.episodes)
    rows = evaluate([str(policy)], judge.scenarios, seeds, folder / "judged", make_planner=make_driver, progress=False)
    own = {"study": Path(name).stem, "variant": variant, "training_seed": seed}
    own["train_steps"] = sum(stage.steps for stage in study.training.stages if stage.kind == "ppo")
    return [{key: (row | own)[key] for key in COLUMNS} for row in survival(rows).to_dict("records")]


def run_study(name: str, out: str | Path, jobs: int = 1) -> pd.DataFrame:
    """All runs of a study, `jobs` at a time; as they end, their rows go to `studies.csv`, beside those of other
    studies that are there; at the end the arms are written, where the study has some.

    Returns:
        The study's rows, in the order of its variants; one a run and scenario.
    """
    study, title, path = load_study(name), Path(name).stem, Path(out) / "studies.csv"
    runs = [(variant, seed) for seed in study.seeds for variant in study.variants]
    order, rows = list(study.variants), []
    others = read_studies(path).query("study != @title")
    calls = [joblib.delayed(run_one)(name, variant, seed) for variant, seed in runs]
    with tqdm(total=len(runs), unit="run") as bar:
        for found in joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(calls):
            rows += found
            rows.sort(key=lambda row: (order.index(row["variant"]), row["training_seed"], row["scenario"]))
            own = pd.DataFrame(rows, columns=COLUMNS)
            write_atomic(path, csv_text(in_order(pd.concat([others, own]) if len(others) else own)))
            bar.update()
    if study.arms:
        for variant in study.variants:
            policy = _folder(name, variant, study.seeds[0]) / "ppo_actor.onnx"
            write_atomic(ABLATION_FOLDER / f"{title}_{variant}.onnx", policy.read_bytes())
    return own
