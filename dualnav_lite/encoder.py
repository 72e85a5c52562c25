"""The observation: what the policy sees of one control step, as a (3 or 4, 64, 64) image."""

from dataclasses import dataclass, fields

import numpy as np

from dualnav_lite.config import Observation
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels import encode
from dualnav_lite.kernels.raster import SIZE
from dualnav_lite.motion import Prediction, estimate_flow, motion_fields

__all__ = ["BANDS", "BAND_EDGES", "CHANNELS", "Ego", "encode_state", "encode_states", "estimate_flow", "num_channels",
           "project_intensity", "read_bands"]  # fmt: skip

# The layout. Every channel is ego-centred: robot in the middle, heading up, 0.1 m a cell; cell (row, column) is centred
# at x_ahead = (31.5 - row) * 0.1, y_left = (31.5 - column) * 0.1. The last channel exists if `observation.intensity`.
CHANNELS = ("static", "motion", "ego", "intensity")
STATIC, MOTION, EGO, INTENSITY = range(4)

# Bands of rows of the ego channel from the top, each filled with one number.
BANDS = (
    "v",  # v / SPEED_SCALE, clipped to [-1, 1]
    "omega",  # omega / TURN_SCALE, clipped to [-1, 1]; counter-clockwise is positive
    "battery",  # charge in [0, 1]
    "goal_distance",  # d / (d + GOAL_SCALE) in [0, 1): fine near the goal, never saturated
    "goal_sin",  # of the bearing; left is positive
    "goal_cos",
    "guide_sin",
    "guide_cos",
    "map_age",  # age / AGE_SCALE, clipped to [0, 1]
    "preference",  # 0 all safety, 1 all thrift
)
BAND_EDGES = np.linspace(0, SIZE, len(BANDS) + 1).round().astype(np.int64)  # first row of each band, and the end
BAND_ROWS = BAND_EDGES[:-1].tolist()

# Fixed, not taken from the config: a number in a band means the same speed whatever limits a run has.
SPEED_SCALE, TURN_SCALE = 0.8, 1.2  # [m/s], [rad/s]: the article's hardware limits
GOAL_SCALE = 2.0  # [m]
AGE_SCALE = 2.0  # [s]
FLAT_SCALE = 10.0  # [m] of a reading of 1 in a flat observation, the lidar's usual reach; longer ones read 1 too
_SCALES = np.array([SPEED_SCALE, TURN_SCALE, GOAL_SCALE, AGE_SCALE])
DEFAULT_OBSERVATION = Observation()


@dataclass
class Ego:
    """What the robot knows about itself; for `encode_states` each field has a leading axis of worlds.

    Attributes:
        twist: (2,) v [m/s], omega [rad/s], measured.
        battery: charge in [0, 1].
        goal_robot, guide_robot: (2,) [m], robot frame.
        map_age_s: age of the received map.
        preference: 0 all safety, 1 all thrift.
        forecast: where movers will be, for the motion methods `forecast` and `truth`; else None.
    """

    twist: np.ndarray
    battery: np.ndarray
    goal_robot: np.ndarray
    guide_robot: np.ndarray
    map_age_s: np.ndarray
    preference: np.ndarray
    forecast: Prediction | None = None

    def rows(self, which) -> "Ego":
        """Those of some worlds: an index, a slice, an array; None adds the axis of worlds."""
        own = {one.name: np.asarray(getattr(self, one.name))[which] for one in fields(self) if one.name != "forecast"}
        return Ego(**own, forecast=None if self.forecast is None else self.forecast.rows(which))


def num_channels(observation=DEFAULT_OBSERVATION) -> int:
    """Channels of the observation: 3, or 4 with the intensity."""
    return len(CHANNELS) - (not observation.intensity)


def encode_states(scans, poses, map_crops, ego, observation=DEFAULT_OBSERVATION):
    """Observations of n worlds; each depends on its own world alone.

    Args:
        scans: (n, 3, beams, 2) ranges [m] and intensities, oldest first; intensity 0 marks a beam without a return.
        poses: (n, 3, 3) believed poses of those scans, map frame.
        map_crops: (n, 64, 64) `CELL_VALUE`s, ego-centred as the channels are.
        ego: batched `Ego`.
        observation: which channels, and what the motion channel shows.

    Returns:
        (n, C, 64, 64) float32, a fresh array.

    Raises:
        ValueError: shapes that do not fit each other, or a motion method without its forecast.
    """
    scans, poses = np.asarray(scans, np.float32), np.asarray(poses, np.float64)
    n = len(scans)
    if scans.ndim != 4 or scans.shape[1] != 3 or scans.shape[3] != 2:
        raise ValueError(f"scans must be (n, 3, beams, 2), got {scans.shape}")
    if poses.shape != (n, 3, 3) or np.shape(map_crops) != (n, SIZE, SIZE):
        raise ValueError(f"for {n} worlds got poses {poses.shape} and map crops {np.shape(map_crops)}")
    images = np.empty((n, num_channels(observation), SIZE, SIZE), np.float32)
    if observation.layout == "flat":
        images[:, [STATIC, MOTION]] = 0.0
        readings = np.minimum(scans[..., 0].reshape(n, -1), FLAT_SCALE)
        images[:, STATIC].reshape(n, -1)[:, : 3 * scans.shape[2]] = readings / FLAT_SCALE
    else:
        images[:, STATIC] = map_crops
        motion_fields(scans, poses, ego.forecast, observation.motion, out=images[:, MOTION])
    encode.paint_bands(
        _floats(ego.twist, (n, 2)),
        _floats(ego.battery, (n,)),
        _floats(ego.goal_robot, (n, 2)),
        _floats(ego.guide_robot, (n, 2)),
        _floats(ego.map_age_s, (n,)),
        _floats(ego.preference, (n,)),
        _SCALES,
        BAND_EDGES,
        images[:, EGO],
    )
    if observation.intensity:
        encode.project_intensities(scans[:, -1], *beam_directions(scans.shape[2]), images[:, INTENSITY])
    return images


def encode_state(scans, poses, map_crop, ego, observation=DEFAULT_OBSERVATION):
    """The observation of one world: `encode_states` without the leading axis.

    Args:
        scans: (3, beams, 2), oldest first.
        poses: (3, 3).
        map_crop: (64, 64).
        ego: `Ego` of one world.
        observation: `config.Observation`.

    Returns:
        (C, 64, 64) float32.

    Source: article 2.2 (`encode_state`); 4.4 for the intensity.
    """
    scans, poses, map_crop = (np.asarray(one)[None] for one in (scans, poses, map_crop))
    return encode_states(scans, poses, map_crop, ego.rows(None), observation)[0]


def project_intensity(scan):
    """Strongest intensity of the beams that end in each cell of one world.

    Args:
        scan: (beams, 2) range [m] and intensity.

    Returns:
        (64, 64) float32 in [0, 1].

    Source: article 4.4 (`_project_intensity`).
    """
    image = np.empty((1, SIZE, SIZE), np.float32)
    scan = np.asarray(scan, np.float32)
    encode.project_intensities(scan[None], *beam_directions(len(scan)), image)
    return image[0]


def read_bands(observation):
    """The numbers in the ego channel, in the order of `BANDS`; exact, since each band holds one number.

    Args:
        observation: (..., C, 64, 64), an array or a tensor.

    Returns:
        (..., 10), of the same kind.
    """
    return observation[..., EGO, :, 0][..., BAND_ROWS]


def _floats(values, shape):
    values = np.asarray(values, np.float64)
    if values.shape != shape:
        raise ValueError(f"an ego field must have shape {shape}, got {values.shape}")
    return values
