"""What the warm start learns from: the ceiling planner's costs in the states that the student gets itself into."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import torch

from dualnav_lite import streams
from dualnav_lite.command_reader import CommandReader
from dualnav_lite.config import Config, write_atomic
from dualnav_lite.encoder import STATIC
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.kernels import sampling as kernels
from dualnav_lite.planners.sampling import Ceiling
from dualnav_lite.policy import Actor
from dualnav_lite.trunks import split_observations
from dualnav_lite.weights import load_weights

PIXEL_STEPS = 127  # images are kept as int8; a pixel is off by at most 1/254
WALKING_M_S = 0.1
BURST_STEPS, TURN_STEPS = (3, 8), (5, 20)  # of random commands: single ones vanish in the robot's inertia; of turns
MEAN_STEPS = 9.0  # of both
MIRRORED_BANDS = (1, 4, 6)  # omega, goal_sin, guide_sin change sign when left and right are swapped


class Teacher(Ceiling):
    """The ceiling planner with a taste: preference and charge change its speed, its turns and its margins.

    Thrift t = 2 p (1 + 3 (1 - charge)) is the factor of the energy reward. Without it the robot drives at the limit;
    with it at a speed that leaves a three-hour run its charge and still has time for every goal, and it turns less.
    Thrift waits while a crowd walks by: in the crossing a robot held to 0.4 m/s lost 4 of 100 runs, and spent more on
    its detours. Margins shrink as the preference turns from safety to thrift.
    """

    THRIFTY_M_S, FREE_M_S = 0.4, 0.8
    SPEEDING_COST = 2.0  # [m of way] for each m/s above the wanted speed; faster gains 0.6, a collision costs more
    TURNING_COST = 0.1  # [m of way] for each rad/s; dearer turns make the ways longer than they save
    CROWD, CROWD_M = 3, 3.2  # so many people walking so near, as far as the observation shows, are a crowd

    def costs_of(self, worlds: Sequence[int], infos: dict[str, Any]) -> np.ndarray:
        """(k, commands) costs [m of way] of the commands, for some worlds of a vector environment's infos."""
        costs = np.empty((len(worlds), len(self._commands)))
        usual = self._parameters
        for row, i in enumerate(worlds):
            truth = {name: values[i] for name, values in infos["truth"].items()}
            preference, charge = float(infos["preference"][i]), float(infos["battery"][i])
            freedom = 1.0 if self._is_in_crowd(truth) else self.freedom(preference, charge)
            self.margins = 1.6 - 1.2 * preference
            self._parameters = usual.copy()
            self._parameters[[kernels.STATIC_SOFT, kernels.MOVING_SOFT]] *= self.margins
            costs[row] = self.costs(i, {"truth": truth})
            wanted = self.THRIFTY_M_S + (self.FREE_M_S - self.THRIFTY_M_S) * freedom
            costs[row] += self.SPEEDING_COST * np.maximum(np.abs(self._commands[:, 0]) - wanted, 0.0)
            costs[row] += self.TURNING_COST * (1.0 - freedom) * np.abs(self._commands[:, 1])
        self._parameters = usual
        return costs

    def _is_in_crowd(self, truth: dict[str, Any]) -> bool:
        count = int(truth["num_circles"])
        is_near = np.hypot(*(truth["circles"][:count, :2] - truth["pose"][:2]).T) < self.CROWD_M
        walks = np.hypot(*truth["circle_velocities"][:count].T) > WALKING_M_S
        return int((is_near & walks).sum()) >= self.CROWD

    @staticmethod
    def freedom(preference: float, charge: float) -> float:
        """From 1 without thrift towards 0: cruising speed rises with it from the thrifty one to the limit."""
        thrift = 2.0 * preference * (1.0 + 3.0 * (1.0 - charge))
        return float(np.exp(-(thrift**2)))


def pack(observations) -> tuple[np.ndarray, np.ndarray]:
    """Images as int8 (n, C - 1, 64, 64) and bands as float32 (n, 10): 12 KiB an observation instead of 64."""
    images, bands = split_observations(torch.from_numpy(observations))
    return torch.round(images * PIXEL_STEPS).to(torch.int8).numpy(), bands.numpy()


def unpack(images, bands):
    """Float tensors (n, C - 1, 64, 64) and (n, 10) of packed arrays."""
    return torch.from_numpy(images).float().div_(PIXEL_STEPS), torch.from_numpy(bands)


@dataclass
class Labels:
    """Packed observations and the teacher's costs above its best (float16, capped), read from disk where they lie.

    `survived` holds, for every episode that ended while they were collected, whether it reached its goal.
    """

    images: np.ndarray
    bands: np.ndarray
    costs: np.ndarray
    survived: np.ndarray

    CAP_M = 60.0  # beyond it costs are alike
    PARTS = ("images", "bands", "survived", "costs")  # in the order in which they are written

    @classmethod
    def load(cls, stem: Path) -> "Labels":
        """The shard of `save` with this stem."""
        return cls(**{name: np.load(f"{stem}.{name}.npy", mmap_mode="r") for name in cls.PARTS})

    def save(self, stem: Path) -> None:
        """Write the shard; `costs` last, so that a shard which has them is whole."""
        for name in self.PARTS:
            write_atomic(f"{stem}.{name}.npy", partial(np.save, arr=getattr(self, name)))

    @staticmethod
    def exists(stem: Path) -> bool:
        """Whether the shard was saved whole."""
        return Path(f"{stem}.costs.npy").exists()

    def __len__(self) -> int:
        return len(self.costs)


class Noise:
    """Takes the wheel now and then, so that the way back is seen as well.

    Half of the times it holds a random command; half of the times it turns on the spot, or stands: where a robot finds
    itself with its back to the way on, beside something, a driver that was never shown a way out stays.

    Args:
        commands: (k, 2) to choose from, v [m/s], omega [rad/s].
        worlds: number n of worlds.
        share: of the steps.
        rng: numpy generator.
    """

    def __init__(self, commands, worlds: int, share: float, rng):
        self._commands, self._begin, self._rng = commands, share / MEAN_STEPS, rng
        self._left, self._held = np.zeros(worlds, int), np.zeros((worlds, 2))

    def __call__(self, actions):
        """(n, 2) the actions, or what is held instead."""
        rng = self._rng
        for i in np.flatnonzero((rng.random(len(actions)) < self._begin) & (self._left == 0)):
            if rng.random() < 0.5:
                self._held[i] = self._commands[rng.integers(len(self._commands))]
                self._left[i] = rng.integers(*BURST_STEPS, endpoint=True)
            else:
                self._held[i] = 0.0, rng.uniform(-1.0, 1.0) * self._commands[:, 1].max()
                self._left[i] = rng.integers(*TURN_STEPS, endpoint=True)
        actions = np.where(self._left[:, None] > 0, self._held, actions)
        self._left = np.maximum(self._left - 1, 0)
        return actions


def collect(actor: Actor | None, settings, config: Config, scenarios, seed: int, progress=None) -> Labels:
    """One shard of labels, from worlds that the student drives, or the teacher where there is no student yet.

    Args:
        actor: the student or None.
        settings, config: how; `config.preference` should be "drawn".
        scenarios: ids or paths, from which each episode draws one.
        seed: of this shard; worlds, noise and the choice of labelled steps follow from it.
        progress: called with the number of new labels.

    Returns:
        `Labels` with exactly `settings.shard_labels` rows.
    """
    n = settings.worlds
    rng = streams.stream(seed, "imitation")
    env = DynamicNavVectorEnv(n, config, scenarios, truth=True)
    observations, infos = env.reset(seed=rng.integers(1_000_000, size=n).tolist())
    teacher, reader = Teacher(config), CommandReader(Ceiling(config).grid, settings.memory)
    teacher.reset(range(n))
    commands = teacher.grid.reshape(-1, 2)
    noise = Noise(commands, n, settings.noise_share, rng)
    kept: dict[str, list[np.ndarray]] = {"images": [], "bands": [], "costs": []}
    survived: list[bool] = []
    count = 0
    while count < settings.shard_labels:
        labelled = np.arange(n) if actor is None else np.flatnonzero(rng.random(n) < settings.label_share)
        labelled = labelled[~infos["idle"][labelled]]
        if len(labelled):
            costs = teacher.costs_of(labelled.tolist(), infos)
            images, bands = pack(observations[labelled])
            kept["images"].append(images)
            kept["bands"].append(bands)
            above = costs - costs.min(axis=1, keepdims=True)
            kept["costs"].append(np.minimum(above, Labels.CAP_M).astype(np.float16))
            count += len(labelled)
        if actor is None:
            actions = np.zeros((n, 2))
            actions[labelled] = commands[costs.argmin(axis=1)]
        else:
            with torch.no_grad():
                probabilities = actor(torch.from_numpy(observations)).exp().numpy()
            actions = reader(probabilities)
        actions = noise(actions)
        observations, _, terminations, truncations, infos = env.step(actions)
        ended = np.flatnonzero(terminations | truncations)
        if len(ended):
            survived += (infos["summary"]["outcome"][ended] == "goal").tolist()
        teacher.reset(ended)
        reader.reset(ended)
        if progress:
            progress(len(labelled))
    env.close()
    joined = {name: np.concatenate(parts)[: settings.shard_labels] for name, parts in kept.items()}
    return Labels(**joined, survived=np.array(survived, bool))


def collect_shard(stem: Path, actor_path: Path | None, make_actor, settings, config, scenarios, seed: int) -> None:
    """Collect one shard and save it; nothing where it exists. What a worker process runs."""
    if Labels.exists(stem):
        return
    torch.set_num_threads(1)
    actor = None
    if actor_path is not None:
        actor = make_actor()
        actor.load_state_dict(load_weights(actor_path))
    collect(actor, settings, config, scenarios, seed).save(stem)


def collect_round(number: int, folder: Path, actor_path, make_actor, settings, config, scenarios, seed, jobs):
    """All shards of a round, on `jobs` processes; what exists is not collected again.

    Returns:
        Stems of the shards, the same for any number of processes.
    """
    shards = settings.first_round_shards if number == 0 else settings.round_shards
    stems = [Path(folder) / f"round_{number:02d}_{k:02d}" for k in range(shards)]
    calls = []
    for k, stem in enumerate(stems):
        shard_seed = int(streams.stream(seed, f"round {number} shard {k}").integers(2**31))
        student = None if number == 0 else actor_path
        calls.append(joblib.delayed(collect_shard)(stem, student, make_actor, settings, config, scenarios, shard_seed))
    joblib.Parallel(n_jobs=jobs)(calls)
    return stems


def mirrored(images, bands, costs, grid_shape, flat_beams: int = 0):
    """The same situations with left and right swapped: three fresh arrays.

    Args:
        images, bands, costs: (n, C - 1, 64, 64), (n, 10), (n, commands).
        grid_shape: of the commands, v first.
        flat_beams: of a scan where channel 0 holds three of them in a row (`observation.layout: flat`); 0 for images.
    """
    bands = bands.copy()
    bands[:, MIRRORED_BANDS] *= -1.0
    swapped = costs.reshape(-1, *grid_shape)[:, :, ::-1].reshape(costs.shape)
    flipped = np.ascontiguousarray(images[..., ::-1])
    if flat_beams:  # beam k points at -pi + 2 pi k / beams, so the first one is its own mirror image
        readings, used = images[:, STATIC].reshape(len(images), -1), 3 * flat_beams
        scans = readings[:, :used].reshape(-1, 3, flat_beams)
        flipped[:, STATIC] = images[:, STATIC]
        flipped[:, STATIC].reshape(len(images), -1)[:, :used] = np.roll(scans[..., ::-1], 1, axis=-1).reshape(-1, used)
    return flipped, bands, np.ascontiguousarray(swapped)
