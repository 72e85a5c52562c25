"""Training as a product: stages in order, checkpoints, exact resume, a stop that says why."""

import time
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch

from dualnav_lite import deploy, streams
from dualnav_lite.config import UnusableInput
from dualnav_lite.curriculum import (
    Stage,
    Training,
    claim_folder,
    load_training,
    resolved_config,
    runs_folder,
    scenarios_of,
)
from dualnav_lite.encoder import num_channels
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.imitation import imitate
from dualnav_lite.parallel_env import ParallelVectorEnv
from dualnav_lite.policy import Actor, Critic, make_actor
from dualnav_lite.ppo import Batch, make_optimizers, set_rates, update
from dualnav_lite.ppo_loop import collect
from dualnav_lite.progress import Log, Reporter
from dualnav_lite.rewards import TERMS
from dualnav_lite.rollout import RunningDeviation
from dualnav_lite.trunks import trunk_for
from dualnav_lite.weights import load_weights, save_weights


class TrainingStopped(RuntimeError):
    """The training ended before its time; the text says where and why, and what was kept."""


class Trainer:
    """Runs the stages of a training in a folder, and goes on where it was stopped.

    Everything drawn comes from the training's seed and the stage's and segment's names; at each checkpoint all worlds
    begin anew. So a run that was killed any number of times ends with the weights of one that was not, on one type of
    machine and with the same versions.

    Args:
        training: what to do.
        folder: of this run.
        home: where the scenario files of the training are looked up.
        workers: processes that simulate; the result does not depend on it.
        device: where the networks learn: "cpu", "cuda", or "auto" for cuda where there is one. Worlds stay on the CPU.
        say: where lines for people go.
    """

    def __init__(
        self,
        training: Training,
        folder: str | Path,
        home: str | Path = ".",
        workers: int = 1,
        device: str = "auto",
        say: Callable[[str], None] = print,
    ):
        torch.set_num_threads(1)  # minibatches are small; the second core has work of its own
        self.training, self.folder, self.home, self.workers = training, Path(folder), Path(home), workers
        self.config = resolved_config(training)
        claim_folder(self.folder, training)
        self.log = Log(self.folder / "log.csv", say)
        self._shape = (num_channels(self.config.observation), 64, 64)
        with torch.random.fork_rng():
            torch.manual_seed(training.seed)
            self.actor = self.make_actor()
            self.critic = Critic(trunk_for(self._shape, training.grain), len(TERMS))
        self.device = chosen_device(device)
        self.actor.to(self.device)
        self.critic.to(self.device)
        self._deadline = time.monotonic() + 60.0 * training.max_minutes if training.max_minutes else np.inf

    def make_actor(self) -> Actor:
        """An untrained policy of this training's shape."""
        return make_actor(self._shape, self.training.head, self.config.hardware.limits.tolist(), self.training.grain)

    def run(self, until: str = "") -> Actor:
        """All stages, or those up to the one named; the trained policy, at the end also in `actor.pth` of the folder.

        Raises:
            TrainingStopped: a loss that is no number.
            UnusableInput: no stage of that name; the folder refuses, as when the disk is full.
        """
        names = [stage.name for stage in self.training.stages]
        last = until or names[-1]
        if last not in names:
            raise UnusableInput(f"no stage '{until}'; the training has {', '.join(names)}")
        for stage in self.training.stages[: names.index(last) + 1]:
            done = self.folder / f"{stage.name}.done.pth"
            if done.exists():
                kept = load_weights(done)
                self.actor.load_state_dict(kept["actor"])
                self.critic.load_state_dict(kept["critic"])
                continue
            self.log.say(f"stage '{stage.name}' ({stage.kind})")
            begin = time.monotonic()
            {"imitate": self._imitate, "ppo": self._ppo}[stage.kind](stage)
            save_weights(done, {"actor": self.actor.state_dict(), "critic": self.critic.state_dict()})
            self.log.say(f"stage '{stage.name}' done in {(time.monotonic() - begin) / 60:.1f} min")
        if last == names[-1]:
            save_weights(self.folder / "actor.pth", self.actor.state_dict())
            save_weights(self.folder / "critic.pth", self.critic.state_dict())
        return self.actor

    def _imitate(self, stage: Stage) -> None:
        def log(numbers):
            self.log.rewind(stage.name, numbers["labels"] - 1)
            self.log.add(stage.name, numbers["labels"], {k: v for k, v in numbers.items() if k != "labels"})
            self.log.say(
                f"round {numbers['round']}: {numbers['labels']:,} labels, loss {numbers['loss']:.3f}; "
                f"whoever drove reached {numbers['reached']:.0%} of its goals"
            )

        rounds, seed = self.folder / stage.name, self._seed(stage.name)
        try:
            imitate(
                self.actor,
                self.make_actor,
                stage.imitation,
                self.config,
                scenarios_of(stage, self.home),
                seed,
                rounds,
                jobs=self.workers,
                log=log,
            )
        except FloatingPointError as error:
            raise TrainingStopped(f"stage '{stage.name}': {error}; the rounds before it are kept in {rounds}") from None

    def _seed(self, *names) -> int:
        return int(streams.stream(self.training.seed, " ".join(map(str, names))).integers(2**31))

    def _ppo(self, stage: Stage) -> None:
        settings, n = stage.ppo, self.training.worlds
        per_update = n * stage.rollout_steps
        updates = max(1, round(stage.steps / per_update))
        optimizers = make_optimizers(self.actor, self.critic, settings)
        deviation = RunningDeviation(n, len(TERMS), settings.gamma)
        reference = deepcopy(self.actor).eval() if settings.reference_coef > 0 else None
        done, episodes = self._resume(stage, optimizers, deviation, reference)
        self.log.rewind(stage.name, done * per_update)
        reporter = Reporter(self.log.say, updates * per_update, done * per_update)
        reporter.episodes = episodes
        env = self._make_env(scenarios_of(stage, self.home))
        try:
            while done < updates and time.monotonic() < self._deadline:
                until = min(done + stage.segment_updates, updates)
                self._segment(stage, env, optimizers, deviation, reference, reporter, done, until, updates)
                done = until
                self._save(stage, optimizers, deviation, reference, done, reporter.episodes)
        finally:
            env.close()

    def _segment(self, stage, env, optimizers, deviation, reference, reporter, done, until, updates) -> None:
        """Updates `done` to `until`, from a fresh start of every world."""
        settings, n = stage.ppo, self.training.worlds
        per_update = n * stage.rollout_steps
        rng = streams.stream(self.training.seed, f"{stage.name} from {done}")
        generator = torch.Generator(self.device).manual_seed(int(rng.integers(2**31)))
        observations, _ = env.reset(seed=rng.integers(1_000_000, size=n).tolist())
        deviation.restart()
        for number in range(done, until):
            begin = time.perf_counter()
            rollout, observations = collect(
                env,
                self.actor,
                self.critic,
                observations,
                stage.rollout_steps,
                generator,
                deviation,
                lambda infos, step=(number + 1) * per_update: reporter.take(infos, step),
            )
            collected = time.perf_counter()
            batch = Batch.of(rollout, settings, self.actor, deviation.deviations, reference)
            set_rates(optimizers, settings, 1.0 - number / updates)
            try:
                only_values = number < stage.warm_up_updates
                numbers = update(self.actor, self.critic, optimizers, batch, settings, rng, only_values)
            except FloatingPointError as error:
                raise TrainingStopped(
                    f"stage '{stage.name}', step {(number + 1) * per_update:,}: {error}; the checkpoint of step "
                    f"{done * per_update:,} is kept"
                ) from None
            spent = time.perf_counter() - begin
            speed = {"steps_per_s": per_update / spent, "collect_share": (collected - begin) / spent}
            scale = {
                f"deviation_{name}": value for name, value in zip(TERMS, deviation.deviations.tolist(), strict=True)
            }
            self.log.add(stage.name, (number + 1) * per_update, {**numbers, **reporter.numbers(), **speed, **scale})

    def _make_env(self, scenarios):
        n = self.training.worlds
        if self.workers > 1:
            return ParallelVectorEnv(n, self.workers, self.config, scenarios)
        return DynamicNavVectorEnv(n, self.config, scenarios)

    def _save(self, stage, optimizers, deviation, reference, done: int, episodes: int) -> None:
        state = {
            "done": done,
            "episodes": episodes,
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "optimizers": [one.state_dict() for one in optimizers],
            "deviation": deviation.state_dict(),
            "reference": reference.state_dict() if reference is not None else None,
        }
        save_weights(self.folder / f"{stage.name}.checkpoint.pth", state)

    def _resume(self, stage, optimizers, deviation, reference) -> tuple[int, int]:
        """Updates and episodes already done, with everything else set to the checkpoint; zeros without one."""
        path = self.folder / f"{stage.name}.checkpoint.pth"
        if not path.exists():
            return 0, 0
        state = load_weights(path)
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        for optimizer, kept in zip(optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(kept)
        deviation.load_state_dict(state["deviation"])
        if reference is not None:
            reference.load_state_dict(state["reference"])
        self.log.say(f"going on from update {state['done']}")
        return state["done"], state["episodes"]

    def export(self, folder: str | Path, name: str = "ppo_actor") -> dict[str, Path]:
        """Write the policy as .pth, .pt and .onnx (`deploy.export`), and the critic beside it."""
        training = self.training
        more = {"overrides": training.config, "training": training.title}
        actor = deepcopy(self.actor).cpu()
        card = deploy.card_of(actor, self.config, training.memory, training.seed, **more)
        paths = deploy.export(actor, card, folder, name)
        save_weights(Path(folder) / f"{name.replace('actor', 'critic')}.pth", self.critic.state_dict())
        return paths


def chosen_device(name: str) -> torch.device:
    """The device of this name; `UnusableInput` where it is unknown or not there."""
    if name not in ("auto", "cpu", "cuda"):
        raise UnusableInput(f"unknown device '{name}'; known: auto, cpu, cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise UnusableInput("device 'cuda': this machine or this build of PyTorch has none")
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")


def train(
    config: str | Path,
    run: str | None = None,
    seed: int | None = None,
    workers: int = 2,
    out: str | Path | None = None,
    device: str = "auto",
    until: str = "",
    say: Callable[[str], None] = print,
) -> Path:
    """Train what a config file says, or go on with it; the run's folder.

    Args:
        config: a file like `training/lesson.yaml`.
        run: name of the run's folder; the config's name and the seed if None.
        seed: in place of the config's.
        workers: processes that simulate.
        out: folder for the exported policy; None exports into the run's folder.
        device: "auto", "cpu" or "cuda".
        until: name of the stage after which to stop and export; all of them if empty.
    """
    training = load_training(config, seed)
    folder = runs_folder() / (run or f"{Path(config).stem}-seed{training.seed}")
    trainer = Trainer(training, folder, Path(config).parent, workers, device, say)
    say(f"{training.title}; run folder {folder}")
    trainer.run(until)
    paths = trainer.export(out or folder)
    say(f"policy: {paths['onnx']}")
    return folder
