"""Plane geometry: frames, angles, oriented boxes. Poses are (x [m], y [m], heading [rad]), counter-clockwise."""

from functools import lru_cache

import numpy as np


def wrap_angle(angle):
    """The same angle in [-pi, pi).

    >>> float(wrap_angle(3 * np.pi / 2)) == -np.pi / 2
    True
    """
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def to_robot(points, poses):
    """World points seen from the robot.

    Args:
        points: (..., 2) [m], world frame.
        poses: (..., 3) robot poses, world frame; leading axes broadcast against those of `points`.

    Returns:
        (..., 2) [m], robot frame: x ahead, y left.
    """
    points, poses = np.asarray(points, float), np.asarray(poses, float)
    dx, dy = points[..., 0] - poses[..., 0], points[..., 1] - poses[..., 1]
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    return _points(c * dx + s * dy, c * dy - s * dx)


def to_world(points, poses):
    """Robot-frame points in the world; the inverse of `to_robot`, same shapes."""
    points, poses = np.asarray(points, float), np.asarray(poses, float)
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y = points[..., 0], points[..., 1]
    return _points(poses[..., 0] + c * x - s * y, poses[..., 1] + s * x + c * y)


def _points(x, y):
    points = np.empty((*x.shape, 2))  # `np.stack` costs three times as much, more than the turn itself
    points[..., 0], points[..., 1] = x, y
    return points


def box_corners(boxes):
    """Corners of oriented boxes, counter-clockwise.

    Args:
        boxes: (..., 5) centre x, y [m], angle [rad], half length, half width [m].

    Returns:
        (..., 4, 2) corners [m], same frame.
    """
    boxes = np.asarray(boxes, float)
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    local = signs * boxes[..., None, 3:5]
    return to_world(local, boxes[..., None, :3])


def box_segments(boxes):
    """Sides of oriented boxes as (..., 4, 4) segments x0, y0, x1, y1 [m] with the solid on their left."""
    corners = box_corners(boxes)
    return np.concatenate([corners, np.roll(corners, -1, axis=-2)], axis=-1)


@lru_cache(maxsize=8)
def beam_directions(beams: int):
    """Cosine and sine of every beam's bearing -pi + 2 pi k / beams, robot frame.

    Returns:
        (beams,), (beams,) float64, read-only: they are shared by everybody who scans.
    """
    bearings = -np.pi + 2 * np.pi * np.arange(beams) / beams
    cosines, sines = np.cos(bearings), np.sin(bearings)
    cosines.setflags(write=False)
    sines.setflags(write=False)
    return cosines, sines
