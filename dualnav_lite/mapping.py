"""Semantic map built online off-board, the link it comes over, and the cache on the robot, for n worlds at once."""

import numpy as np

from dualnav_lite import config
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels.crop import crop_maps, plan_grids
from dualnav_lite.kernels.grid import update_maps
from dualnav_lite.kernels.link import deliver_maps
from dualnav_lite.semantics import CELL_VALUE, Cell

CROP_CELLS = 64


def crop_cell_centres() -> np.ndarray:
    """Middles of the image cells, (64, 64, 2) [cells], robot frame: ahead, left. Every image channel uses them.

    >>> crop_cell_centres()[0, 0]
    array([31.5, 31.5])
    """
    offsets = 0.5 * (CROP_CELLS - 1) - np.arange(CROP_CELLS)
    return np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1)


class Mapper:
    """Rolling semantic maps of n worlds.

    Scans go up to the mapper without loss; maps come back over a link that may lose or delay them. The robot keeps the
    last one that came. With the cache (`settings.cache`) it turns that map to the believed pose and lays
    the present scan over it; without, it sees the map as it was around the pose where it was sent.

    Args:
        settings: size of the map, and whether there is a cache.
        lidar: beams and longest range of the scans.
        num_envs: number of worlds n.
        control_dt_s: time between scans [s].

    Attributes:
        received: (n, G, G) u8 `Cell` codes of the map that the robot holds, toroidal: (x, y) of the map frame is at
            [floor(y / res) mod G, floor(x / res) mod G].
        received_corners: (n, 2) i64 floor(x / res), floor(y / res) of the lowest cell of its window.
    """

    def __init__(self, settings: config.Map, lidar: config.Lidar, num_envs: int, control_dt_s: float):
        self.settings, self.num_envs, self.control_dt_s = settings, num_envs, control_dt_s
        self._range_max = lidar.range_max_m
        self._directions = beam_directions(lidar.beams)
        centres = crop_cell_centres()
        turn = np.arctan2(centres[..., 1], centres[..., 0]) / (2 * np.pi) + 0.5
        self._cell_beam = np.rint(turn * lidar.beams).astype(np.int64) % lidar.beams
        self._cell_distance = np.hypot(centres[..., 0], centres[..., 1]).astype(np.float32)
        n, grid = num_envs, (num_envs, settings.cells, settings.cells)
        self._cells = np.full(grid, Cell.UNKNOWN, np.uint8)
        self._evidence, self._votes = np.zeros(grid, np.int8), np.zeros(grid, np.uint8)
        self._corners = np.zeros((n, 2), np.int64)
        self._delay, self._loss, self._burst = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
        self._keys, self._is_lost = np.zeros(n, np.uint64), np.zeros(n, bool)
        self._make_ring(1)
        self.received, self.received_corners = self._cells.copy(), self._corners.copy()
        self._received_poses, self._age_steps = np.zeros((n, 3)), np.zeros(n, np.int64)
        self._plan, self.plan_corners = self._cells.copy(), self._corners.copy()

    def _make_ring(self, depth: int) -> None:
        """Room for `depth` maps under way in each world; memory is taken only where one is written."""
        n, size = self.num_envs, self.settings.cells
        self._ring = (
            np.zeros((n, depth), bool),
            np.zeros((n, depth, size, size), np.uint8),
            np.zeros((n, depth, 2), np.int64),
            np.zeros((n, depth, 3)),
        )

    def reset(self, indices, poses, delay_s, loss, burst_mean_s, keys) -> None:
        """Forget everything in some worlds and set up their links.

        Args:
            indices: (k,) worlds.
            poses: (k, 3) where their robots believe to be.
            delay_s: (k,) time a map is under way, rounded to whole control steps.
            loss: (k,) share of maps lost, in [0, 1).
            burst_mean_s: (k,) mean length of a run of losses; 0 loses each map independently.
            keys: (k,) u64 `streams.stream_key` of each link.

        Raises:
            ValueError: a share outside [0, 1), or a burst so short that this share cannot be lost in such bursts.
        """
        delay = np.rint(np.asarray(delay_s, float) / self.control_dt_s).astype(np.int64)
        loss, burst = np.asarray(loss, float), np.asarray(burst_mean_s, float) / self.control_dt_s
        if np.any((loss < 0) | (loss >= 1)) or np.any(delay < 0) or np.any(burst < 0):
            raise ValueError(f"link: delay and burst must not be negative, loss must lie in [0, 1), got {loss}")
        if np.any((burst > 0) & (burst < np.maximum(1.0, loss / (1 - loss)))):
            raise ValueError(f"link: bursts of {burst} packets are too short to lose {loss} of the packets")
        depth = self._ring[0].shape[1]
        longest = int(np.max(delay, initial=0)) + 1
        if longest > depth:
            old = self._ring
            self._make_ring(longest)
            for new, kept in zip(self._ring, old, strict=True):
                new[:, :depth] = kept
        corners = np.floor(np.asarray(poses, float)[:, :2] / self.settings.resolution_m).astype(np.int64)
        corners -= self.settings.cells // 2
        for grid in (self._cells, self.received, self._plan):
            grid[indices] = Cell.UNKNOWN
        for corner in (self._corners, self.received_corners, self.plan_corners):
            corner[indices] = corners
        self._evidence[indices], self._votes[indices], self._ring[0][indices] = 0, 0, False
        self._delay[indices], self._loss[indices], self._burst[indices] = delay, loss, burst
        self._keys[indices], self._is_lost[indices], self._age_steps[indices] = keys, False, 0
        self._received_poses[indices] = poses

    def update(self, poses, scans, labels, step, active) -> None:
        """Put the present scans into the maps, then let the link deliver.

        Args:
            poses: (n, 3) believed poses.
            scans: (n, beams, 2) f32 and labels: (n, beams) u8, from `Lidar.scan`.
            step: (n,) i64 from 0 at reset, one more at every call.
            active: (n,) bool, the other worlds stay as they are.
        """
        world = (self._cells, self._evidence, self._votes, self._corners)
        resolution = self.settings.resolution_m
        update_maps(*world, poses, scans, labels, step, active, *self._directions, resolution, self._range_max)
        deliver_maps(
            self._cells,
            self._corners,
            poses,
            step,
            active,
            self._delay,
            self._loss,
            self._burst,
            self._keys,
            self._is_lost,
            *self._ring,
            self.received,
            self.received_corners,
            self._received_poses,
            self._age_steps,
        )

    @property
    def age_s(self) -> np.ndarray:
        """Time since the received maps were sent, (n,) [s]; new every time.

        Where none has come yet, as if an empty one had been sent a step before the first.
        """
        return self._age_steps * self.control_dt_s

    def crops(self, poses, scans, labels) -> np.ndarray:
        """Channel 0 of the observation.

        Args:
            poses, scans, labels: as given to `update`.

        Returns:
            (n, 64, 64) f32 `CELL_VALUE`s, robot in the middle, heading up: row 0 farthest ahead, column 0 farthest
            left (`crop_cell_centres`). New at every call.
        """
        images = np.empty((self.num_envs, CROP_CELLS, CROP_CELLS), np.float32)
        cached = self.settings.cache
        crop_maps(
            self.received,
            self.received_corners,
            poses if cached else self._received_poses,
            cached,
            self._age_steps,
            scans,
            labels,
            self._cell_beam,
            self._cell_distance,
            *self._directions,
            self.settings.resolution_m,
            self._range_max,
            CELL_VALUE,
            images,
        )
        return images

    def plan_grids(self, poses, scans, labels, due) -> np.ndarray:
        """Grids to plan on: the received map, and with the cache the present hits (people as furniture) on top.

        Args:
            poses, scans, labels: as given to `update`.
            due: (n,) bool worlds that will plan; the others keep their last grid.

        Returns:
            (n, G, G) u8 `Cell` codes, toroidal as `received`, in a window with floor(x / res), floor(y / res) of the
            present pose at its middle; `plan_corners` is its lowest cell. Overwritten by the next call.
        """
        plan_grids(
            self.received,
            self.received_corners,
            poses,
            self.settings.cache,
            scans,
            labels,
            due,
            *self._directions,
            self.settings.resolution_m,
            self._range_max,
            self._plan,
            self.plan_corners,
        )
        return self._plan
