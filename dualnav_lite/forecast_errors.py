"""How far forecasts were from what happened: movers matched to forecasts, ADE, FDE and hit rates."""

from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from dualnav_lite.geometry import to_robot
from dualnav_lite.motion import STEPS

MATCH_M = 0.5  # a forecast belongs to the true mover this close to its first position, if each is the other's nearest
HITS = {"hit_1s": (10, 0.3), "hit_2s": (20, 0.5)}  # step and radius [m]
ENDS = {"fde_0_5s_m": 5, "fde_1s_m": 10, "fde_2s_m": 20}  # step
COLUMNS = ["family", "model", "ade_m", *ENDS, *HITS, "n"]


def futures(recording, frames):
    """Where the movers of a recording are after each of the next steps, in the true robot frame of each frame.

    Args:
        recording: `recording.Recording`; frames: (w,), each with `STEPS` more behind it.

    Returns:
        (w, M, STEPS, 2) [m]; nan where a mover is not there.
    """
    rows = np.asarray(frames)[:, None] + np.arange(1, STEPS + 1)
    return to_robot(recording.movers[rows].swapaxes(1, 2), recording.true_poses[frames][:, None, None])


def match(positions, valid, truth, gate: float = MATCH_M):
    """The forecast that belongs to each true mover: the nearest, where each is the other's nearest.

    Args:
        positions: (w, K, 2) and valid (w, K); truth: (w, M, 2), nan where there is none; same frame [m].
        gate: farther ones do not belong together [m].

    Returns:
        (w, M) index of the forecast, -1 for none.
    """
    gaps = np.linalg.norm(truth[:, :, None] - positions[:, None], axis=-1)
    gaps = np.where(np.isfinite(gaps) & valid[:, None], gaps, np.inf)
    nearest = gaps.argmin(axis=2)
    is_mutual = np.take_along_axis(gaps.argmin(axis=1), nearest, axis=1) == np.arange(truth.shape[1])
    best = np.take_along_axis(gaps, nearest[..., None], axis=2)[..., 0]
    return np.where(is_mutual & (best <= gate), nearest, -1)


def errors_of(models: Mapping[str, Callable], recording, every: int = 3) -> dict[str, np.ndarray]:
    """Distances between forecast and truth, for every mover that all the models have.

    Args:
        models: predictors by name (SPEC 15).
        recording: `recording.Recording`.
        every: frames between two forecasts.

    Returns:
        (m, STEPS) [m] by model, the same movers at the same moments in each.
    """
    frames = np.arange(2, len(recording.scans) - STEPS, every)
    if not len(frames):
        return {name: np.zeros((0, STEPS)) for name in models}
    truth = futures(recording, frames)
    is_whole = np.isfinite(truth).all(axis=(2, 3))
    found = {}
    for name, model in models.items():
        positions, _, valid = model(*recording.windows(frames))
        owner = match(positions[:, :, 0], valid, truth[:, :, 0])
        found[name] = positions, owner
    common = is_whole & np.logical_and.reduce([owner >= 0 for _, owner in found.values()])
    rows, movers = np.nonzero(common)
    return {
        name: np.linalg.norm(positions[rows, owner[rows, movers]] - truth[rows, movers], axis=-1)
        for name, (positions, owner) in found.items()
    }


def summary(family: str, model: str, distances) -> dict:
    """One row of `predictor.csv` from (m, STEPS) distances."""
    row = {"family": family, "model": model, "ade_m": distances.mean() if len(distances) else np.nan}
    for name, step in ENDS.items():
        row[name] = distances[:, step - 1].mean() if len(distances) else np.nan
    for name, (step, radius) in HITS.items():
        row[name] = (distances[:, step - 1] <= radius).mean() if len(distances) else np.nan
    return row | {"n": len(distances)}


def table_of(errors: Mapping[str, Mapping[str, np.ndarray]]) -> pd.DataFrame:
    """`predictor.csv` from distances by family and model."""
    rows = [summary(family, model, found) for family, by_model in errors.items() for model, found in by_model.items()]
    return pd.DataFrame(rows, columns=COLUMNS)
