"""Warm start: a network learns what the ceiling planner would do, in the states it gets itself into (DAgger)."""

import io
import math
import pickle
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import joblib
import numpy as np
import torch
from pydantic import Field

from dualnav_lite import streams
from dualnav_lite.command_reader import CommandReader
from dualnav_lite.config import Config, Frozen, NonNegative, Positive, Share, UnusableInput, write_atomic
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.kernels import sampling as kernels
from dualnav_lite.planners.sampling import Ceiling
from dualnav_lite.policy import Actor, device_of, split_observations

Count = Annotated[int, Field(ge=1)]
PIXEL_STEPS = 127  # images are kept as int8; a pixel is off by at most 1/254
COST_CAP_M = 3.0  # dearer commands are alike: a collision; with caution 1 % of a collision costs 3 cm of way
MIRRORED_BANDS = (1, 4, 6)  # omega, goal_sin, guide_sin change sign when left and right are swapped


class Imitation(Frozen):
    """How the warm start is done."""

    rounds: Count = 8
    first_round_shards: Count = 10  # driven by the teacher
    round_shards: Count = 6  # driven by the student
    worlds: Count = 16  # of a shard
    shard_labels: Count = 8192
    label_share: Share = 0.33  # share of student-driven steps that are labelled: neighbours in time are alike
    noise_share: Share = 0.05  # share of steps with a random command, so that the way back is seen as well
    temperature_m: Positive = 0.08  # of the teacher's soft choice, in metres of way
    caution: Share = 0.0  # `imitation_loss`
    memory: Share = 0.5  # of the `CommandReader` that drives
    updates: Count = 1500  # after each round
    last_updates: Count = 8000  # after the last round, while the learning rate falls
    batch: Count = 128  # small: steps are what a student lacks, not smoothness
    micro_batch: Count = 64
    learning_rate: Positive = 1e-3
    last_learning_rate: Positive = 3e-5
    weight_decay: NonNegative = 1e-4


class Teacher(Ceiling):
    """The ceiling planner with a taste: what preference and charge ask for changes its speed and its margins.

    Thrift t = 2 p (1 + 3 (1 - charge)) is the factor of the energy reward. The speed of least energy a metre is
    0.5 m/s (SPEC 8); a robot without thrift drives at the limit.
    """

    THRIFTY_M_S, FREE_M_S = 0.5, 0.8
    THRIFT_SCALE = 1.2
    SPEEDING_COST = 1.2  # [m of way] for each m/s above the wanted speed; a collision costs more

    def costs_of(self, worlds: Sequence[int], infos: dict[str, Any]) -> np.ndarray:
        """(k, commands) costs [m of way] of the commands, for some worlds of a vector environment's infos."""
        costs = np.empty((len(worlds), len(self._commands)))
        usual = self._parameters
        for row, i in enumerate(worlds):
            truth = {name: values[i] for name, values in infos["truth"].items()}
            preference, charge = float(infos["preference"][i]), float(infos["battery"][i])
            wanted = self.wanted_speed(preference, charge)
            self._parameters = usual.copy()
            # What follows a command is driven at the wanted speed too, else it would always speed up later.
            self._parameters[kernels.MAX_V] = wanted
            self._parameters[[kernels.STATIC_SOFT, kernels.MOVING_SOFT]] *= 1.4 - 0.8 * preference
            self._score(i, {"truth": truth}, costs[row])
            costs[row] += self.SPEEDING_COST * np.maximum(self._commands[:, 0] - wanted, 0.0)
        self._parameters = usual
        return costs

    def wanted_speed(self, preference: float, charge: float) -> float:
        """Cruising speed [m/s]: from the limit without thrift to the one of least energy."""
        thrift = 2.0 * preference * (1.0 + 3.0 * (1.0 - charge))
        span = self.FREE_M_S - self.THRIFTY_M_S
        return self.THRIFTY_M_S + span * float(np.exp(-((thrift / self.THRIFT_SCALE) ** 2)))


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
            buffer = io.BytesIO()
            np.save(buffer, getattr(self, name))
            write_atomic(f"{stem}.{name}.npy", buffer.getvalue())

    @staticmethod
    def exists(stem: Path) -> bool:
        """Whether the shard was saved whole."""
        return Path(f"{stem}.costs.npy").exists()

    def __len__(self) -> int:
        return len(self.costs)


def collect(actor: Actor | None, settings: Imitation, config: Config, scenarios, seed: int, progress=None) -> Labels:
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
    noisy_until, noise, step = np.zeros(n, int), np.zeros((n, 2)), 0
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
        # Bursts of three to eight random steps: single ones vanish in the robot's inertia.
        begin = (rng.random(n) < settings.noise_share / 5.0) & (noisy_until <= step)
        noisy_until[begin] = step + rng.integers(3, 9, size=int(begin.sum()))
        noise[begin] = commands[rng.integers(len(commands), size=int(begin.sum()))]
        actions = np.where((noisy_until > step)[:, None], noise, actions)
        observations, _, terminations, truncations, infos = env.step(actions)
        ended = np.flatnonzero(terminations | truncations)
        if len(ended):
            survived += (infos["episode"]["outcome"][ended] == "goal").tolist()
        teacher.reset(ended)
        reader.reset(ended)
        step += 1
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


def collect_round(
    number: int, folder: Path, actor_path, make_actor, settings: Imitation, config, scenarios, seed, jobs
):
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


def imitation_loss(log_probabilities, costs, temperature_m: float, caution: float = 0.0):
    """How far the student's choice is from the teacher's soft one, softmax(-cost / T), a mean over the batch.

    Two ways to be far, mixed. The student cannot tell apart all that the teacher does; of situations that look alike,
    cross entropy (caution 0) learns the *mean of the choices*, so the most frequent one wins. The free energy
    E[cost] / T - entropy (caution 1; the divergence taken the other way round) learns the *choice of the mean cost*: a
    command that is now and then a collision is left alone. Where the teacher's knowledge is the student's, both agree.

    Args:
        log_probabilities: (n, commands).
        costs: (n, commands) [m], above the best.
        temperature_m: T; the lower, the harder the teacher's choice.
        caution: share of the free energy in [0, 1].

    Source: the second is AggreVaTe's objective (Ross and Bagnell 2014) with an entropy; in a POMDP it leads to QMDP.
    """
    scaled = costs.clamp(max=COST_CAP_M) / temperature_m
    loss = torch.zeros(())
    if caution < 1.0:
        targets = torch.softmax(-costs / temperature_m, dim=1)
        loss = loss - (1.0 - caution) * (targets * log_probabilities).sum(dim=1).mean()
    if caution > 0.0:
        loss = loss + caution * (log_probabilities.exp() * (scaled + log_probabilities)).sum(dim=1).mean()
    return loss


def mirrored(images, bands, costs, grid_shape):
    """The same situations with left and right swapped: three fresh arrays."""
    bands = bands.copy()
    bands[:, MIRRORED_BANDS] *= -1.0
    swapped = costs.reshape(-1, *grid_shape)[:, :, ::-1].reshape(costs.shape)
    return np.ascontiguousarray(images[..., ::-1]), bands, np.ascontiguousarray(swapped)


def fit(actor: Actor, optimizer, shards: Sequence[Labels], settings: Imitation, rng, updates: int, rates=None):
    """Train the student on labels of all rounds.

    Args:
        actor, optimizer: updated in place.
        shards: labels, drawn from uniformly; half of each batch is mirrored.
        settings: loss and batch.
        rng: numpy generator; the same one gives the same weights.
        updates: number of batches.
        rates: learning rate of the first and the last batch; between them it falls by a cosine.

    Returns:
        Mean loss of the last tenth of the batches.

    Raises:
        FloatingPointError: the loss is no longer a number.
    """
    edges = np.cumsum([0, *(len(shard) for shard in shards)])
    losses = []
    with Twin(actor) as twin:
        for update in range(updates):
            if rates is not None:
                share = 0.5 * (1.0 + math.cos(math.pi * update / updates))
                for group in optimizer.param_groups:
                    group["lr"] = rates[1] + (rates[0] - rates[1]) * share
            batch = _draw_batch(shards, edges, settings.batch, actor.head.grid_shape, rng)
            losses.append(_descend(actor, twin, optimizer, batch, settings))
            if not np.isfinite(losses[-1]):
                raise FloatingPointError(f"imitation loss is {losses[-1]} in batch {update} of {updates}")
    return float(np.mean(losses[-max(1, updates // 10) :]))


def _draw_batch(shards: Sequence[Labels], edges, size: int, grid_shape, rng):
    """Images, bands and costs of `size` labels drawn from all shards, the first half mirrored."""
    chosen = np.sort(rng.integers(edges[-1], size=size))
    owner = np.searchsorted(edges, chosen, side="right") - 1
    parts = [(shards[k], chosen[owner == k] - edges[k]) for k in np.unique(owner)]
    order, half = rng.permutation(size), size // 2
    images, bands, costs = (
        np.concatenate([getattr(shard, name)[rows] for shard, rows in parts])[order]
        for name in ("images", "bands", "costs")
    )
    flipped = mirrored(images[:half], bands[:half], costs[:half], grid_shape)
    return [np.concatenate([a, b[half:]]) for a, b in zip(flipped, (images, bands, costs), strict=True)]


class Twin:
    """A second network with the weights of the first and gradients of its own, for a thread on the other core."""

    def __init__(self, actor: Actor):
        self.actor = deepcopy(actor)
        self._pairs = list(zip(actor.parameters(), self.actor.parameters(), strict=True))
        for original, copy in self._pairs:
            copy.data = original.data  # one storage: an optimiser that changes it in place changes both
        self._pool = ThreadPoolExecutor(1)

    def start(self, work, *arguments):
        """Run `work(actor, *arguments)` beside the caller, from empty gradients; a future."""
        self.actor.zero_grad(set_to_none=True)
        return self._pool.submit(work, self.actor, *arguments)

    def hand_over(self) -> None:
        """Add the gradients to those of the first network."""
        for original, copy in self._pairs:
            original.grad.add_(copy.grad)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._pool.shutdown()


def _descend(actor: Actor, twin: Twin, optimizer, batch, settings: Imitation) -> float:
    """One optimiser step on a batch, half of it a core; the loss."""
    optimizer.zero_grad(set_to_none=True)
    half, share = len(batch[0]) // 2, 1.0 / len(batch[0])
    beside = twin.start(_gradient, [part[half:] for part in batch], settings, share)
    loss = _gradient(actor, [part[:half] for part in batch], settings, share)
    loss += beside.result()
    twin.hand_over()
    torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
    optimizer.step()
    return loss


def _gradient(actor: Actor, batch, settings: Imitation, share: float) -> float:
    """Add a part's gradient, each sample weighted by `share`, in micro-batches that stay in the cache; its loss."""
    (images, bands, costs), total, device = batch, 0.0, device_of(actor)
    for start in range(0, len(images), settings.micro_batch):
        part = slice(start, start + settings.micro_batch)
        pictures, numbers = (one.to(device) for one in unpack(images[part], bands[part]))
        log_probabilities = actor.head(actor.trunk.join(pictures, numbers))
        wanted = torch.from_numpy(costs[part]).to(device).float()
        loss = imitation_loss(log_probabilities, wanted, settings.temperature_m, settings.caution)
        loss = loss * (share * len(pictures))
        loss.backward()
        total += loss.item()
    return total


def imitate(
    actor: Actor, make_actor, settings: Imitation, config, scenarios, seed: int, folder: Path, jobs=1, log=print
):
    """Rounds of collecting and fitting; every round is kept in `folder`, and a stopped run goes on from there.

    Args:
        actor: the student, trained in place.
        make_actor: builds an untrained twin, in worker processes too.
        settings, config, scenarios, seed: as in `collect`.
        folder: where shards and students of each round go.
        jobs: worker processes for collecting; the result does not depend on it.
        log: called with a dict of numbers after each round.
    """
    optimizer = torch.optim.AdamW(actor.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    stems: list[Path] = []
    for number in range(settings.rounds):
        previous, state = folder / f"student_{number - 1:02d}.pth", folder / f"student_{number:02d}.state"
        new = collect_round(number, folder, previous, make_actor, settings, config, scenarios, seed, jobs)
        stems += new
        if state.exists():
            kept = load_weights(state)
            actor.load_state_dict(kept["actor"])
            optimizer.load_state_dict(kept["optimizer"])
            continue
        shards = [Labels.load(stem) for stem in stems]
        is_last = number == settings.rounds - 1
        rates = (settings.learning_rate, settings.last_learning_rate) if is_last else None
        updates = settings.last_updates if is_last else settings.updates
        loss = fit(actor, optimizer, shards, settings, streams.stream(seed, f"fit {number}"), updates, rates)
        save_weights(folder / f"student_{number:02d}.pth", actor.state_dict())
        save_weights(state, {"actor": actor.state_dict(), "optimizer": optimizer.state_dict()})
        driven = np.concatenate([Labels.load(stem).survived for stem in new])
        reached = float(driven.mean()) if len(driven) else 0.0
        log({"round": number, "labels": sum(map(len, shards)), "loss": loss, "reached": reached})


def load_weights(path: Path):
    """Tensors of `save_weights`, without running code; through a file handle, since paths may hold any script.

    Raises:
        UnusableInput: the file cannot be read as such.
    """
    try:
        with open(path, "rb") as file:
            return torch.load(file, map_location="cpu", weights_only=True)
    except (OSError, EOFError, RuntimeError, ValueError, pickle.UnpicklingError) as error:
        raise UnusableInput(f"{path}: cannot be read as weights: {str(error).splitlines()[0][:120]}") from None


def save_weights(path: Path, state) -> None:
    """Write tensors whole or not at all."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_atomic(path, buffer.getvalue())
