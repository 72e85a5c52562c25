"""The LSTM predictor: its network, its loss, its training; what it has learned leaves as arrays for `forecast`."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import PositiveInt
from torch import nn

from dualnav_lite.config import Frozen, NonNegative, Positive, UnusableInput, write_atomic
from dualnav_lite.forecast import OUTPUTS, Description, describe, turned
from dualnav_lite.forecast_errors import futures, match
from dualnav_lite.geometry import to_robot
from dualnav_lite.kernels.forecast import CONTEXT, SECTORS, SEQUENCE
from dualnav_lite.motion import STEP_S, STEPS, TIMES_S
from dualnav_lite.tracking import Tracker, follow
from dualnav_lite.weights import save_weights

MIRRORED_SEQUENCE = (2, 4, 8)  # y, vy and the robot's y change sign when left and right are swapped
MIRRORED_CONTEXT = (5,)
_SECTORS = 8 + (-np.arange(SECTORS)) % SECTORS  # of the context, left and right swapped


class Settings(Frozen):
    """Size of the network and how it learns."""

    hidden: PositiveInt = 48
    middle: PositiveInt = 64
    updates: PositiveInt = 12_000
    batch: PositiveInt = 256
    learning_rate: Positive = 2e-3
    last_learning_rate: Positive = 2e-5
    weight_decay: NonNegative = 1e-3
    velocity_weight: NonNegative = 0.2  # [s] of the present velocity's error beside the mean distance


class Network(nn.Module):
    """LSTM over what the last scans say of a mover, two dense layers over its state and what surrounds the mover now.

    It starts as constant velocity: the last layer is zero.
    """

    def __init__(self, hidden: int, middle: int):
        super().__init__()
        self.lstm = nn.LSTM(SEQUENCE, hidden, batch_first=True)
        self.first, self.last = nn.Linear(hidden + CONTEXT, middle), nn.Linear(middle, OUTPUTS)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, sequences, contexts):
        """(m, OUTPUTS) of (m, 10, SEQUENCE) and (m, CONTEXT); see `forecast.forecast` for their meaning."""
        state = self.lstm(sequences)[0][:, -1]
        return self.last(torch.relu(self.first(torch.cat([state, contexts], dim=1))))


@dataclass
class Samples:
    """Movers at moments of drives, each in its own frame, and what they did next.

    Attributes:
        sequences: (m, 10, SEQUENCE) f32; contexts: (m, CONTEXT) f32.
        targets: (m, OUTPUTS) f32: what a network should have said.
    """

    sequences: np.ndarray
    contexts: np.ndarray
    targets: np.ndarray

    def __len__(self) -> int:
        return len(self.targets)

    @classmethod
    def join(cls, parts) -> "Samples":
        """All samples of several, in their order."""
        parts = list(parts)
        return cls(*(np.concatenate([getattr(one, name) for one in parts]) for name in cls.__annotations__))

    @classmethod
    def of(cls, recording, every: int = 3) -> "Samples":
        """What a recording says about its movers, at every n-th frame.

        Each is told twice: as a tracker knows it that has run since the start, and as one that read ten scans.
        """
        frames = np.arange(2, max(2, len(recording.scans) - STEPS), every)
        if not len(frames):
            return cls(*(np.zeros(shape, np.float32) for shape in ((0, 10, SEQUENCE), (0, CONTEXT), (0, OUTPUTS))))
        scans, poses = recording.windows(frames)
        afresh = describe(*follow(scans, poses), poses, scans[:, -1])
        return cls.join(
            cls._asked(told, recording, rows) for told, rows in [(afresh, frames), *_told(recording, frames)]
        )

    @classmethod
    def _asked(cls, told: Description, recording, frames) -> "Samples":
        """Those movers of a description that the network is asked about, with what they did."""
        future = futures(recording, frames)
        here, before = (
            to_robot(recording.movers[frames - lag], recording.true_poses[frames][:, None]) for lag in (0, 1)
        )
        owner = match(told.tracks.positions, told.moving, here)
        velocity = (here - before) / STEP_S
        is_whole = np.isfinite(future).all(axis=(2, 3)) & np.isfinite(velocity).all(axis=2)
        rows, movers = np.nonzero((owner >= 0) & is_whole)
        which = rows, owner[rows, movers]
        mean = (future[rows, movers] - told.tracks.positions[which][:, None]) / TIMES_S[:, None]
        wanted = np.concatenate([mean, velocity[rows, movers][:, None]], axis=1)
        corrections = turned(wanted - told.tracks.velocities[which][:, None], -told.headings[which][:, None])
        targets = corrections.reshape(-1, OUTPUTS).astype(np.float32)
        return cls(told.sequences[which], told.contexts[which], targets)


def _told(recording, frames):
    """Descriptions by a tracker that runs from the first frame on, each with its frame."""
    depth = 10
    tracker, wanted = Tracker(1, depth=depth), set(frames.tolist())
    for frame in range(frames[-1] + 1):
        tracks = tracker.update(recording.poses[None, frame], recording.scans[None, frame])
        if frame in wanted:
            scans, poses = recording.windows([frame], depth)
            yield describe(tracks, tracker.past(tracks), poses, scans[:, -1]), np.array([frame])


def mirrored(sequences, contexts, targets):
    """The same movers with left and right swapped."""
    sequences, contexts = sequences.clone(), contexts[:, _mirror_columns()]
    sequences[..., MIRRORED_SEQUENCE] *= -1.0
    contexts[:, MIRRORED_CONTEXT] *= -1.0
    return sequences, contexts, (targets.reshape(-1, STEPS + 1, 2) * torch.tensor([1.0, -1.0])).reshape(targets.shape)


def _mirror_columns():
    return torch.from_numpy(np.concatenate([np.arange(8), _SECTORS]))


def displacement_loss(outputs, targets, velocity_weight: float):
    """Mean distance between forecast and truth over the horizon [m], plus the weighted error of the velocity.

    The mean distance is what ADE measures; unlike its square it is not ruled by the few movers that turn back.
    """
    off = (outputs - targets).reshape(-1, STEPS + 1, 2)
    sizes = torch.sqrt((off * off).sum(dim=2) + 1e-6)
    times = torch.from_numpy(TIMES_S).float()
    return (sizes[:, :STEPS] * times).mean() + velocity_weight * sizes[:, STEPS].mean()


def fit(samples: Samples, settings: Settings, seed: int, log: Callable[[int, float], None] | None = None) -> Network:
    """A network trained on samples; half of each batch is mirrored.

    Args:
        samples: at least one.
        settings, seed: the same ones give the same weights on one type of machine.
        log: called with the update and the mean loss [m] since the last call, 20 times.

    Raises:
        FloatingPointError: the loss is no longer a number.
        UnusableInput: no samples.
    """
    if not len(samples):
        raise UnusableInput("no mover was followed in these drives: there is nothing to learn from")
    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = Network(settings.hidden, settings.middle)
    optimizer = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    tensors = [torch.from_numpy(values) for values in (samples.sequences, samples.contexts, samples.targets)]
    span = settings.learning_rate - settings.last_learning_rate
    total, since, half = 0.0, 0, settings.batch // 2
    for update in range(settings.updates):
        rate = settings.last_learning_rate + span * 0.5 * (1 + math.cos(math.pi * update / settings.updates))
        for group in optimizer.param_groups:
            group["lr"] = rate
        chosen = torch.randint(len(samples), (settings.batch,), generator=generator)
        batch = [values[chosen] for values in tensors]
        flipped = mirrored(*(values[:half] for values in batch))
        batch = [torch.cat([flip, values[half:]]) for flip, values in zip(flipped, batch, strict=True)]
        loss = displacement_loss(network(*batch[:2]), batch[2], settings.velocity_weight)
        if not torch.isfinite(loss):
            raise FloatingPointError(f"the predictor's loss is {loss.item()} in update {update}")
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        total, since = total + loss.item(), since + 1
        if log and (update + 1) % max(1, settings.updates // 20) == 0:
            log(update + 1, total / since)
            total, since = 0.0, 0
    return network.eval()


def exported(network: Network) -> dict[str, np.ndarray]:
    """The weights as `forecast.LstmPredictor` takes them."""
    lstm = network.lstm
    weights = {
        "w_input": lstm.weight_ih_l0.T,
        "w_hidden": lstm.weight_hh_l0.T,
        "bias": lstm.bias_ih_l0 + lstm.bias_hh_l0,
        "w_first": network.first.weight.T,
        "b_first": network.first.bias,
        "w_last": network.last.weight.T,
        "b_last": network.last.bias,
    }
    return {name: np.ascontiguousarray(values.detach().numpy()) for name, values in weights.items()}


def save(network: Network, card: dict[str, Any], folder: str | Path, name: str = "predictor") -> dict[str, Path]:
    """Write `<name>.pth` (weights and card, for torch) and `<name>.npz` (the same weights, for the environment).

    Returns:
        Path of each by its ending.
    """
    size = {"hidden": network.lstm.hidden_size, "middle": network.first.out_features}
    paths = {ending: Path(folder) / f"{name}.{ending}" for ending in ("pth", "npz")}
    save_weights(paths["pth"], {"network": network.state_dict(), "size": size, "card": card})
    write_atomic(paths["npz"], lambda file: np.savez_compressed(file, **exported(network)))
    return paths


def load(path: str | Path) -> tuple[Network, dict[str, Any]]:
    """Network and card in a `.pth` file of `save`, without running code.

    Raises:
        UnusableInput: no such file, or one that holds something else.
    """
    try:
        with open(path, "rb") as file:
            kept = torch.load(file, map_location="cpu", weights_only=True)
        network = Network(**kept["size"])
        network.load_state_dict(kept["network"])
    except FileNotFoundError:
        raise UnusableInput(f"{path}: no such predictor; `train --config training/predictor.yaml` makes one") from None
    except Exception as error:
        first = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise UnusableInput(f"{path}: not a predictor (.pth): {first[:120]}") from None
    return network.eval(), kept["card"]
