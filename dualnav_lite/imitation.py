"""Warm start: a network learns what the ceiling planner would do, in the states it gets itself into (DAgger)."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from pydantic import PositiveInt

from dualnav_lite import streams
from dualnav_lite.config import Frozen, NonNegative, Positive, Share
from dualnav_lite.labels import Labels, collect_round, mirrored, unpack
from dualnav_lite.policy import Actor
from dualnav_lite.trunks import Seen, device_of
from dualnav_lite.weights import load_weights, save_weights

COST_CAP_M = 3.0  # dearer commands are alike: a collision; with caution 1 % of a collision costs 3 cm of way


class Imitation(Frozen):
    """How the warm start is done."""

    rounds: PositiveInt = 8
    first_round_shards: PositiveInt = 10  # driven by the teacher
    round_shards: PositiveInt = 6  # driven by the student
    worlds: PositiveInt = 16  # of a shard
    shard_labels: PositiveInt = 8192
    label_share: Share = 0.33  # share of student-driven steps that are labelled: neighbours in time are alike
    noise_share: Share = 0.1  # share of steps at which `labels.Noise` has the wheel
    temperature_m: Positive = 0.08  # of the teacher's soft choice, in metres of way
    caution: Share = 0.0  # `imitation_loss`
    memory: Share = 0.5  # of the `CommandReader` that drives
    updates: PositiveInt = 1500  # after each round
    last_updates: PositiveInt = 8000  # after the last round, while the learning rate falls
    batch: PositiveInt = 128  # small: steps are what a student lacks, not smoothness
    micro_batch: PositiveInt = 64
    learning_rate: Positive = 1e-3
    last_learning_rate: Positive = 3e-5
    weight_decay: NonNegative = 1e-4


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


def fit(
    actor: Actor, optimizer, shards: Sequence[Labels], settings: Imitation, rng, updates: int, rates=None, flat_beams=0
):
    """Train the student on labels of all rounds.

    Args:
        actor, optimizer: updated in place.
        shards: labels, drawn from uniformly; half of each batch is mirrored.
        settings: loss and batch.
        rng: numpy generator; the same one gives the same weights.
        updates: number of batches.
        rates: learning rate of the first and the last batch; between them it falls by a cosine.
        flat_beams: as in `labels.mirrored`.

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
            batch = _draw_batch(shards, edges, settings.batch, rng, actor.head.grid_shape, flat_beams)
            losses.append(_descend(actor, twin, optimizer, batch, settings))
            if not np.isfinite(losses[-1]):
                raise FloatingPointError(f"imitation loss is {losses[-1]} in batch {update} of {updates}")
    return float(np.mean(losses[-max(1, updates // 10) :]))


def _draw_batch(shards: Sequence[Labels], edges, size: int, rng, *mirror):
    """Images, bands and costs of `size` labels drawn from all shards, the first half mirrored (`labels.mirrored`)."""
    chosen = np.sort(rng.integers(edges[-1], size=size))
    owner = np.searchsorted(edges, chosen, side="right") - 1
    parts = [(shards[k], chosen[owner == k] - edges[k]) for k in np.unique(owner)]
    order, half = rng.permutation(size), size // 2
    images, bands, costs = (
        np.concatenate([getattr(shard, name)[rows] for shard, rows in parts])[order]
        for name in ("images", "bands", "costs")
    )
    flipped = mirrored(images[:half], bands[:half], costs[:half], *mirror)
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
        pictures, numbers = unpack(images[part], bands[part])
        seen = Seen.of(pictures, numbers, actor.trunk.halve).to(device)  # type: ignore[arg-type]
        log_probabilities = actor(seen)
        wanted = torch.from_numpy(costs[part]).to(device).float()
        loss = imitation_loss(log_probabilities, wanted, settings.temperature_m, settings.caution)
        loss = loss * (share * len(seen))
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
        settings, config, scenarios, seed: as in `labels.collect`.
        folder: where shards and students of each round go.
        jobs: worker processes for collecting; the result does not depend on it.
        log: called with a dict of numbers after each round.
    """
    optimizer = torch.optim.AdamW(actor.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    flat_beams = config.lidar.beams if config.observation.layout == "flat" else 0
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
        rng = streams.stream(seed, f"fit {number}")
        loss = fit(actor, optimizer, shards, settings, rng, updates, rates, flat_beams)
        save_weights(folder / f"student_{number:02d}.pth", actor.state_dict())
        save_weights(state, {"actor": actor.state_dict(), "optimizer": optimizer.state_dict()})
        driven = np.concatenate([Labels.load(stem).survived for stem in new])
        reached = float(driven.mean()) if len(driven) else 0.0
        log({"round": number, "labels": sum(map(len, shards)), "loss": loss, "reached": reached})
