"""The trained LSTM as the environment uses it: weights in, forecasts of the nearest movers out; torch is not needed."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from dualnav_lite.config import ROOT, UnusableInput
from dualnav_lite.kernels import forecast as kernel
from dualnav_lite.kernels.tracking import MOVING
from dualnav_lite.motion import STEPS, TIMES_S, Prediction
from dualnav_lite.tracking import Tracks, follow

SHIPPED = ROOT / "models" / "predictor.npz"
OUTPUTS = 2 * STEPS + 2  # mean velocity until each step, and velocity now, all less the tracker's [m/s]
WEIGHTS = ("w_input", "w_hidden", "bias", "w_first", "b_first", "w_last", "b_last")  # of `kernel.run_network`


@dataclass
class Description:
    """What a network is told about the movers of n worlds, each in its own frame.

    Attributes:
        tracks: where they are, robot frame.
        moving: (n, K) those the network is asked about; what stands is left to the tracker.
        sequences: (n, K, 10, `kernel.SEQUENCE`) f32; contexts: (n, K, `kernel.CONTEXT`) f32.
        headings: (n, K) of their velocity, robot frame [rad]; the x axis of a mover's own frame.
    """

    tracks: Tracks
    moving: np.ndarray
    sequences: np.ndarray
    contexts: np.ndarray
    headings: np.ndarray


def describe(tracks: Tracks, past, poses, newest) -> Description:
    """What is to be said about each mover; nothing but scans and believed poses is behind it.

    Args:
        tracks, past: (n, K, 10, `COLUMNS`), as `tracking.follow` or a `Tracker` of depth 10 gives them.
        poses: (n, 10, 3) believed; newest: (n, beams, 2) the last scan.
    """
    n, most, depth = past.shape[:3]
    poses, newest = np.asarray(poses, float), np.asarray(newest, np.float32)
    moving = tracks.valid & (past[:, :, -1, MOVING] > 0)
    sequences = np.empty((n, most, depth, kernel.SEQUENCE), np.float32)
    contexts, frames = np.empty((n, most, kernel.CONTEXT), np.float32), np.empty((n, most, 4))
    kernel.describe_movers(past, poses, newest, moving, sequences, contexts, frames)
    headings = np.arctan2(frames[..., 3], frames[..., 2]) - poses[:, -1:, 2]
    return Description(tracks, moving, sequences, contexts, headings)


def turned(vectors, angles):
    """Vectors (..., 2) turned counter-clockwise by angles (...) [rad]."""
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([c * vectors[..., 0] - s * vectors[..., 1], s * vectors[..., 0] + c * vectors[..., 1]], axis=-1)


class LstmPredictor:
    """Where movers will be: the tracker's straight lines, corrected by an LSTM.

    Its forward pass is a numba kernel that takes one mover after the other, so a forecast has the same bits for any
    number of worlds, and no environment imports torch.

    Args:
        weights: arrays by `WEIGHTS`, as `predictor.exported` makes them.

    Raises:
        UnusableInput: weights that are missing or of another shape.
    """

    def __init__(self, weights: Mapping[str, np.ndarray], source: str | Path = "predictor"):
        missing = [name for name in WEIGHTS if name not in weights]
        if missing:
            raise UnusableInput(f"{source}: not a predictor: '{missing[0]}' is missing")
        self.weights = {name: np.ascontiguousarray(weights[name], np.float32) for name in WEIGHTS}
        size, middle = self.weights["w_hidden"].shape[:1], self.weights["b_first"].shape[:1]
        wanted = {
            "w_input": (kernel.SEQUENCE, 4 * size[0]),
            "w_hidden": (*size, 4 * size[0]),
            "bias": (4 * size[0],),
            "w_first": (size[0] + kernel.CONTEXT, *middle),
            "b_first": middle,
            "w_last": (*middle, OUTPUTS),
            "b_last": (OUTPUTS,),
        }
        for name, shape in wanted.items():
            if self.weights[name].shape != shape:
                raise UnusableInput(f"{source}: '{name}' has shape {self.weights[name].shape}, expected {shape}")

    @classmethod
    def load(cls, path: str | Path | None = None) -> "LstmPredictor":
        """The predictor in a `.npz` file, the shipped one if None; `UnusableInput` where there is none."""
        path = Path(path) if path else SHIPPED
        try:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as found:
                weights = {name: found[name] for name in found.files}
        except FileNotFoundError:
            raise UnusableInput(
                f"{path}: no such predictor; `train --config training/predictor.yaml --out models` makes it, or set "
                "predictor: constant_velocity"
            ) from None
        except Exception as error:
            raise UnusableInput(f"{path}: not a predictor (.npz): {str(error).splitlines()[0][:120]}") from None
        return cls(weights, path)

    def correct(self, tracks: Tracks, past, poses, newest) -> Prediction:
        """Where movers that a tracker has followed will be; arguments as in `describe`."""
        told = describe(tracks, past, poses, newest)
        outputs = np.empty((*tracks.valid.shape, OUTPUTS), np.float32)
        weights = [self.weights[name] for name in WEIGHTS]
        kernel.run_network_on_movers(told.sequences, told.contexts, told.moving, *weights, outputs)
        return forecast(told, outputs)

    def __call__(self, scans, poses):
        """Where movers will be, from ten scans afresh; takes and gives what `ConstantVelocityPredictor` does."""
        prediction = self.correct(*follow(scans, poses), poses, scans[:, -1])
        return prediction.positions, prediction.velocities, prediction.valid


def forecast(told: Description, outputs) -> Prediction:
    """What a network's outputs (n, K, OUTPUTS) mean, robot frame of now."""
    tracks = told.tracks
    corrections = turned(outputs.reshape(*tracks.valid.shape, STEPS + 1, 2).astype(float), told.headings[..., None])
    mean_velocities = tracks.velocities[..., None, :] + corrections[..., :STEPS, :]
    positions = tracks.positions[..., None, :] + TIMES_S[:, None] * mean_velocities
    return Prediction(positions, tracks.velocities + corrections[..., STEPS, :], tracks.valid, tracks.radii)


@cache
def shipped() -> LstmPredictor:
    """The predictor in `models/`, read once."""
    return LstmPredictor.load()
