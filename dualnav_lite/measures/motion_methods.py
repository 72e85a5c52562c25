"""What each motion method says of the cells in which a beam ended, and what really moves there."""

from collections import deque

import numpy as np

from dualnav_lite.forecast import shipped
from dualnav_lite.geometry import to_robot, to_world
from dualnav_lite.kernels import raster
from dualnav_lite.motion import estimate_flow, rasterise
from dualnav_lite.perception import FLOW_SCANS, PREDICTOR_SCANS, true_movers
from dualnav_lite.tracking import Tracker

# What `config.Motion` can show, where it is a velocity (`scan` says only what came and went). `_raw` sees the same
# scans without ego compensation, as the article does; `forecast` is the tracker's constant velocity.
METHODS = ("none", "farneback_raw", "farneback", "forecast_raw", "forecast", "forecast_lstm", "truth")
MOVING_M_S = 0.05  # what is slower counts as static
MARGIN_M = 0.12  # a cell this close to a body's outline holds it: half a cell's diagonal and a lidar's noise


def owned_velocities(gaps, velocities):
    """Velocity of the body that holds each cell, zero where none does.

    Args:
        gaps: (c, k) from each cell's centre to each body's outline, below 0 inside [m]; inf for rows without a body.
        velocities: (k, 2) of the bodies [m/s].

    Returns:
        (c, 2) velocities of the nearest body within `MARGIN_M`, frame as given, and (c,) whether there is one.
    """
    is_held = gaps.min(axis=1) <= MARGIN_M
    return np.where(is_held[:, None], velocities[gaps.argmin(axis=1)], 0.0), is_held


def disc_gaps(cells, positions, radii, valid):
    """(c, k) gaps [m] from cells (c, 2) to discs: positions (k, 2), radii (k,), valid (k,) or True; one frame."""
    return np.where(valid, np.linalg.norm(cells[:, None] - positions, axis=-1) - radii, np.inf)


def true_velocities(truth, world: int, cells):
    """What really moves in the cells of a world, from its bodies' exact outlines.

    Args:
        truth: as `truth_of` gives it.
        cells: (c, 2) centres, robot frame [m].

    Returns:
        (c, 2) velocities over ground, robot frame [m/s], and (c,) whether a cell holds something that moves.
    """
    pose, points = truth["pose"][world], to_world(cells, truth["pose"][world])
    circles, boxes = truth["circles"][world], truth["boxes"][world]
    velocities = np.concatenate([truth["circle_velocities"][world], truth["box_velocities"][world]])
    outside = np.abs(to_robot(points[:, None], boxes[:, :3])) - boxes[:, 3:]
    gaps = np.column_stack(
        [disc_gaps(points, circles[:, :2], circles[:, 2], True), np.linalg.norm(np.maximum(outside, 0.0), axis=-1)]
    )
    # Rows that are not in use have no speed either.
    gaps[:, np.linalg.norm(velocities, axis=1) <= MOVING_M_S] = np.inf
    return owned_velocities(gaps, to_robot(velocities, np.array([0.0, 0.0, pose[2]])))


class Methods:
    """What each of `METHODS` says of n worlds, from the same scans and believed poses.

    Args:
        scans: (n, beams, 2) range [m] and intensity at the reset.
        poses: (n, 3) as the robot believes them, world frame.
    """

    def __init__(self, scans, poses):
        n = len(scans)
        self._scans = deque([scans] * FLOW_SCANS, FLOW_SCANS)
        self._poses = deque([poses] * PREDICTOR_SCANS, PREDICTOR_SCANS)
        self._tracker, self._raw_tracker = Tracker(n, depth=PREDICTOR_SCANS), Tracker(n)
        self._movers: dict[str, tuple] = {}
        self._track(np.ones(n, bool))

    def see(self, scans, poses, active, sim) -> None:
        """Take in a scan and a pose, shaped as at the reset, of the (n,) active worlds; `sim` is for `truth` alone."""
        self._scans.append(scans)
        self._poses.append(poses)
        self._track(active)
        positions, velocities, valid = true_movers(sim)
        self._movers["truth"] = positions, velocities, sim.movers.radii, valid

    def _track(self, active) -> None:
        scans, poses = self._scans[-1], self._poses[-1]
        tracks = self._tracker.update(poses, scans, active)
        # Told that it never moves, a tracker takes the robot's motion for the things'.
        raw = self._raw_tracker.update(np.zeros_like(poses), scans, active)
        lstm = shipped().correct(tracks, self._tracker.past(tracks), np.stack(self._poses, axis=1), scans)
        self._movers |= {
            "forecast_raw": (raw.positions, raw.velocities, raw.radii, raw.valid),
            "forecast": (tracks.positions, tracks.velocities, tracks.radii, tracks.valid),
            "forecast_lstm": (tracks.positions, lstm.velocities, tracks.radii, tracks.valid),
        }

    def say(self, world: int):
        """Centres (c, 2) [m] of cells in which a beam ended, by method their velocities (c, 2) [m/s]; robot frame."""
        scans = np.stack([one[world] for one in self._scans])
        poses = np.stack([one[world] for one in self._poses])[-FLOW_SCANS:]
        hit = rasterise(scans[None], poses[None])[0, -1] > 0
        cells = (raster.HALF - 0.5 - np.argwhere(hit)) * raster.CELL_M
        said = {"none": np.zeros_like(cells)}
        for name, compensate in (("farneback_raw", False), ("farneback", True)):
            said[name] = estimate_flow(scans, poses, compensate)[hit]
        for name, movers in self._movers.items():
            positions, velocities, radii, valid = (values[world] for values in movers)
            said[name] = owned_velocities(disc_gaps(cells, positions, radii, valid), velocities)[0]
        return cells, said
