"""Motion channel: where things move, or will be, around the robot; one image in [-1, 1] a world."""

from dataclasses import dataclass, fields

import cv2
import numpy as np

from dualnav_lite.config import CONTROL_DT_S
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels import raster

cv2.setNumThreads(1)  # one world's flow is far too small to share, and workers own one core each

STEPS = 20  # of a forecast, at `TIMES_S` from now
STEP_S = CONTROL_DT_S  # of a forecast, and between scans
TIMES_S = STEP_S * np.arange(1, STEPS + 1)
FOOTPRINT_M = 0.30  # radius of a mover whose size nobody knows
# Settings of the flow: a compromise of endpoint error on movers, quiet walls and time, on recorded drives.
NEAR_CELLS = 6  # around a change, where flow is worth having: a person's width and a half
CONTEXT_CELLS = 8  # more around them that Farneback's window looks at
_NEAR = np.ones((2 * NEAR_CELLS + 1, 2 * NEAR_CELLS + 1), np.uint8)
FULL_SPEED_M_S = 1.5  # speed that reads 1 in a flow image: the fastest thing of the stress scenarios


@dataclass
class Prediction:
    """Where the nearest moving things will be, robot frame of now; leading axes are optional.

    Attributes:
        positions: (..., k, STEPS, 2) centres [m] at STEP_S, 2 STEP_S, ...
        velocities: (..., k, 2) over ground now [m/s].
        valid: (..., k) bool; other rows mean nothing.
        radii: (..., k) [m]; a grown person's where nobody said.
    """

    positions: np.ndarray
    velocities: np.ndarray
    valid: np.ndarray
    radii: np.ndarray | None = None

    def __post_init__(self):
        if self.radii is None:
            self.radii = np.full(np.shape(self.valid), FOOTPRINT_M)

    def rows(self, which) -> "Prediction":
        """Those of some worlds: an index, a slice, an array; None adds the axis of worlds."""
        return Prediction(*(np.asarray(getattr(self, one.name))[which] for one in fields(self)))


def rasterise(scans, poses, compensate=True):
    """Images of the last scans in the frame of the newest.

    Args:
        scans: (n, f, beams, 2) ranges [m] and intensities, oldest first.
        poses: (n, f, 3) believed.
        compensate: take the robot's own motion out.

    Returns:
        (n, f, 64, 64) uint8, 255 where a beam ends.
    """
    cosines, sines = beam_directions(scans.shape[-2])
    frames = np.empty((*scans.shape[:2], raster.SIZE, raster.SIZE), np.uint8)
    raster.rasterise_scans(scans, poses, compensate, cosines, sines, frames)
    return frames


def flow_of_frames(frames):
    """Velocity of what the images show, by Farneback's method; zeros where nothing moves.

    A cell is looked at if something appeared or vanished within `NEAR_CELLS` of it between the first and the last
    image; that makes static walls three times quieter and a still picture free, but misses the slowest movers.

    Args:
        frames: (f, 64, 64) uint8, oldest first, `STEP_S` apart.

    Returns:
        (64, 64, 2) float32 velocity [m/s], robot frame: ahead, left.

    Source: Farneback, "Two-frame motion estimation based on polynomial expansion", SCIA 2003; OpenCV's implementation.
    """
    velocity = np.zeros((raster.SIZE, raster.SIZE, 2), np.float32)
    difference = np.empty((raster.SIZE, raster.SIZE), np.float32)
    raster.scan_difference(frames[0], frames[-1], difference)
    rows, columns = np.nonzero(difference)
    if not len(rows):
        return velocity
    window = tuple(
        slice(max(0, cells.min() - NEAR_CELLS - CONTEXT_CELLS), cells.max() + NEAR_CELLS + CONTEXT_CELLS + 1)
        for cells in (rows, columns)
    )
    is_near = cv2.dilate((difference[window] != 0).astype(np.uint8), _NEAR)
    old, new = (np.ascontiguousarray(frame[window]) for frame in (frames[0], frames[-1]))
    flow = cv2.calcOpticalFlowFarneback(
        old, new, None, pyr_scale=0.5, levels=0, winsize=15, iterations=1, poly_n=5, poly_sigma=1.1, flags=0
    )
    scale = -raster.CELL_M / (STEP_S * (len(frames) - 1))  # rows and columns count backwards and to the right
    velocity[window] = flow[..., ::-1] * (np.float32(scale) * is_near[..., None])
    return velocity


def estimate_flow(scans, poses, compensate=True):
    """Velocity field seen by the last three scans of one world.

    Args:
        scans: (3, beams, 2), oldest first.
        poses: (3, 3) believed.
        compensate: False reproduces the article, where the robot's own motion moves the whole image.

    Returns:
        (64, 64, 2) float32 [m/s], robot frame: ahead, left.

    Source: article 2.2 (`_estimate_flow`).
    """
    return flow_of_frames(rasterise(scans[None], poses[None], compensate)[0])


def flow_component(flow, component):
    """One number in [-1, 1] a cell out of a velocity field; 1 stands for `FULL_SPEED_M_S`.

    `x` is the article's: along the image's columns, positive to the right. `radial` is positive towards the robot.
    `speed` has no direction.
    """
    if component == "x":
        image = -flow[..., 1]
    elif component == "speed":
        image = np.hypot(flow[..., 0], flow[..., 1])
    else:
        image = -(flow[..., 0] * _OUTWARD[0] + flow[..., 1] * _OUTWARD[1])
    return np.clip(image / FULL_SPEED_M_S, -1.0, 1.0).astype(np.float32)


def _outward():
    """(2, 64, 64) unit vectors from the robot to each cell, robot frame."""
    middle = (raster.HALF - 0.5 - np.arange(raster.SIZE)) * raster.CELL_M
    ahead, left = np.meshgrid(middle, middle, indexing="ij")
    return np.stack([ahead, left]) / np.hypot(ahead, left)


_OUTWARD = _outward()


def motion_fields(scans, poses, forecast, motion, out=None):
    """Channel 1 of the observation.

    Args:
        scans: (n, 3, beams, 2) ranges [m] and intensities, oldest first.
        poses: (n, 3, 3) believed poses of those scans.
        forecast: batched `Prediction`, read by the methods `forecast` and `truth` (there it comes from the simulator).
        motion: `config.Motion`: method and component.
        out: (n, 64, 64) float32 to write into, or None.

    Returns:
        (n, 64, 64) float32 in [-1, 1].

    Raises:
        ValueError: the method needs a forecast and got none.
    """
    fields = np.empty((len(scans), raster.SIZE, raster.SIZE), np.float32) if out is None else out
    if motion.method in ("forecast", "truth"):
        if forecast is None:
            raise ValueError(f"motion method '{motion.method}' paints a forecast, but none was given")
        raster.paint_forecasts(forecast.positions, forecast.radii, forecast.valid, fields)
    elif motion.method == "none":
        fields[:] = 0.0
    else:
        frames = rasterise(scans, poses)
        for i, frame in enumerate(frames):
            if motion.method == "scan":
                raster.scan_difference(frame[0], frame[-1], fields[i])
            else:
                fields[i] = flow_component(flow_of_frames(frame), motion.component)
    return fields
