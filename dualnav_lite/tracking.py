"""Moving things found in the scans alone, and where constant velocity says they will be."""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.kernels import tracking as kernel
from dualnav_lite.motion import STEP_S, TIMES_S, Prediction

MAX_MOVERS = 8
_MAX_TRACKS = 40
_MEMORY = 10  # scans kept to ask what was free before


@dataclass
class Tracks:
    """The nearest things of n worlds that move, or stand but have walked before; nearest first.

    Attributes:
        positions: (n, K, 2) centres [m], robot frame.
        velocities: (n, K, 2) over ground [m/s], along the robot frame's axes; zero for what stands.
        radii: (n, K) [m].
        ages: (n, K) scans since first seen.
        valid: (n, K) bool; other rows are zero.
    """

    positions: np.ndarray
    velocities: np.ndarray
    radii: np.ndarray
    ages: np.ndarray
    valid: np.ndarray


class Tracker:
    """Follows scan clusters of n worlds in their map frames and tells which of them move.

    A scan is cut at range jumps; each small, bright enough cluster is placed as a round thing, matched to the nearest
    track and smoothed by a Kalman filter of constant velocity. A track moves once it is faster than 0.25 m/s *and*
    stands where an earlier scan saw free space, or has left a place that is now seen free. What has moved for a
    second is kept in mind when it stops: a person who stands may walk on at any moment, a wardrobe will not.

    Args:
        num_envs: number of worlds n.
        dt: time between scans [s].
        depth: number of scans whose tracks are kept for `past`; 0 for none.

    Attributes:
        states: (n, T, `kernel.COLUMNS`) every track, moving or not, map frame; an age of 0 marks a free row.
        rows: (n, K) row of `states` behind each mover of the last `Tracks`, -1 for none.
    """

    def __init__(self, num_envs: int, dt: float = STEP_S, depth: int = 0):
        self.dt = dt
        self._past = np.zeros((num_envs, depth, _MAX_TRACKS, kernel.COLUMNS))
        self.states = np.zeros((num_envs, _MAX_TRACKS, kernel.COLUMNS))
        self._places = np.zeros((num_envs, _MAX_TRACKS, _MEMORY, 3))
        self._ranges = np.zeros((num_envs, _MEMORY, 0), np.float32)
        self._poses = np.zeros((num_envs, _MEMORY, 3))
        self._counts = np.zeros(num_envs, np.int64)
        self.rows = np.full((num_envs, MAX_MOVERS), -1)

    def reset(self, indices) -> None:
        """Forget everything about these worlds."""
        self.states[indices] = 0.0
        self._counts[indices] = 0
        self._past[indices] = 0.0

    def update(self, poses, scans, active=None) -> Tracks:
        """Take in one scan a world.

        Args:
            poses: (n, 3) believed poses, map frame.
            scans: (n, beams, 2) f32 ranges [m] and intensities; intensity 0 marks a lost beam.
            active: (n,) bool or None for all; other worlds keep their tracks as they are.

        Returns:
            `Tracks` of all worlds, fresh arrays.
        """
        n, beams = scans.shape[:2]
        if self._ranges.shape[2] != beams:
            self._ranges = np.zeros((n, _MEMORY, beams), np.float32)
        active = np.ones(n, bool) if active is None else active
        kernel.step_tracks(
            scans, poses, active, self.dt, self.states, self._places, self._ranges, self._poses, self._counts
        )
        tracks = Tracks(
            np.empty((n, MAX_MOVERS, 2)),
            np.empty((n, MAX_MOVERS, 2)),
            np.empty((n, MAX_MOVERS)),
            np.empty((n, MAX_MOVERS), np.int64),
            np.empty((n, MAX_MOVERS), bool),
        )
        kernel.nearest_movers(
            self.states,
            poses,
            tracks.positions,
            tracks.velocities,
            tracks.radii,
            tracks.ages,
            tracks.valid,
            self.rows,
        )
        if self._past.shape[1]:
            self._past[active, :-1] = self._past[active, 1:]
            self._past[active, -1] = self.states[active]
        return tracks

    def past(self, tracks: Tracks) -> np.ndarray:
        """(n, K, depth, `kernel.COLUMNS`) what the last update's `tracks` were after each of the last scans.

        Map frame; an age of 0 before a thing was first seen, and everywhere for a row that is not valid.
        """
        states = self._past[np.arange(len(self.rows))[:, None], :, self.rows]
        was_it = states.shape[2] - tracks.ages[..., None] <= np.arange(states.shape[2])  # earlier its row was another's
        return states * (was_it & tracks.valid[..., None])[..., None]


def constant_velocity(tracks) -> Prediction:
    """Straight lines at the present velocity.

    Args:
        tracks: `Tracks`, or anything with its positions, velocities, radii and valid.

    Returns:
        `Prediction` for the next 2 s, robot frame of now.
    """
    positions = tracks.positions[..., None, :] + TIMES_S[:, None] * tracks.velocities[..., None, :]
    return Prediction(positions, tracks.velocities, tracks.valid, tracks.radii)


def follow(scans, poses) -> tuple[Tracks, np.ndarray]:
    """Movers found in a few scans alone, and their `Tracker.past`.

    Scans at the beginning that repeat the next one bit by bit are the filling of a memory that is not full yet
    (noise never repeats itself), and are left out: a walker would seem to have stood there.

    Args:
        scans: (n, f, beams, 2), oldest first.
        poses: (n, f, 3) believed.
    """
    scans, poses = np.asarray(scans, np.float32), np.asarray(poses, float)
    n, depth = scans.shape[:2]
    is_filling = np.zeros((n, depth), bool)
    repeats = (scans[:, :-1] == scans[:, 1:]).all(axis=(2, 3))
    is_filling[:, :-1] = np.logical_and.accumulate(repeats, axis=1)
    tracker = Tracker(n, depth=depth)
    for step in range(depth):
        tracks = tracker.update(poses[:, step], scans[:, step], ~is_filling[:, step])
    return tracks, tracker.past(tracks)


class ConstantVelocityPredictor:
    """The tracker as a predictor: it reads the last ten scans afresh at every call, as the LSTM does."""

    def __call__(self, scans, poses):
        """Where movers will be.

        Args:
            scans: (n, 10, beams, 2), oldest first.
            poses: (n, 10, 3) believed.

        Returns:
            positions (n, K, STEPS, 2) [m], velocities (n, K, 2) [m/s], valid (n, K), in the newest robot frame.
        """
        prediction = constant_velocity(follow(scans, poses)[0])
        return prediction.positions, prediction.velocities, prediction.valid
