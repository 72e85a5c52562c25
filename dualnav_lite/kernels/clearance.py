"""Distances from points and hulls to solids."""

import numpy as np
from numba import njit


@njit(cache=True)
def _box_distance(x, y, box):
    """Distance from a point to an oriented box (x, y, angle, half length, half width), 0 inside."""
    c, s = np.cos(box[2]), np.sin(box[2])
    dx, dy = x - box[0], y - box[1]
    outside_x = max(abs(c * dx + s * dy) - box[3], 0.0)
    outside_y = max(abs(c * dy - s * dx) - box[4], 0.0)
    return np.sqrt(outside_x * outside_x + outside_y * outside_y)


@njit(cache=True)
def static_clearance(boxes, width, height, resolution):
    """Distance from each cell centre of a room to the nearest box or outer wall.

    Args:
        boxes: (b, 5) x, y, angle, half length, half width [m].
        width, height: room [0, width] x [0, height] [m].
        resolution: cell size [m].

    Returns:
        (H, W) f64 [m]; cell [iy, ix] has its centre at ((ix + 0.5) resolution, (iy + 0.5) resolution).
    """
    rows, columns = int(np.ceil(height / resolution)), int(np.ceil(width / resolution))
    field = np.empty((rows, columns))
    for iy in range(rows):
        y = (iy + 0.5) * resolution
        for ix in range(columns):
            x = (ix + 0.5) * resolution
            field[iy, ix] = max(min(min(x, width - x), min(y, height - y)), 0.0)
    for b in range(boxes.shape[0]):
        box = boxes[b]
        c, s = np.cos(box[2]), np.sin(box[2])
        for iy in range(rows):
            dy = (iy + 0.5) * resolution - box[1]
            for ix in range(columns):
                dx = (ix + 0.5) * resolution - box[0]
                outside_x = max(abs(c * dx + s * dy) - box[3], 0.0)
                outside_y = max(abs(c * dy - s * dx) - box[4], 0.0)
                square = outside_x * outside_x + outside_y * outside_y
                if square < field[iy, ix] * field[iy, ix]:
                    field[iy, ix] = np.sqrt(square)
    return field


@njit(cache=True)
def point_clearance(x, y, boxes, width, height):
    """Distance from one point to the nearest of the boxes and the outer walls [m]."""
    best = max(min(min(x, width - x), min(y, height - y)), 0.0)
    for b in range(boxes.shape[0]):
        best = min(best, _box_distance(x, y, boxes[b]))
    return best


@njit(cache=True)
def line_clearance(x0, y0, x1, y1, boxes, width, height):
    """Least clearance along a straight line, sampled every 5 cm [m]."""
    steps = int(np.ceil(np.hypot(x1 - x0, y1 - y0) / 0.05)) + 1
    best = np.inf
    for k in range(steps + 1):
        share = k / steps
        clear = point_clearance(x0 + share * (x1 - x0), y0 + share * (y1 - y0), boxes, width, height)
        best = min(best, clear)
    return best


@njit(cache=True)
def hull_clearance(poses, radius, segments, num_segments, circles, circle_surface, num_circles, phantom, clearance):
    """Gap between each robot's hull and the nearest line or circle of its world.

    Args:
        poses: (n, 3) true poses.
        radius: of the hull [m].
        segments, num_segments, circles, circle_surface, num_circles: as in `scene.Scene`.
        phantom: surface code of circles that are only seen, not there.
        clearance: (n,) out [m], below 0 where the hull overlaps.
    """
    for i in range(poses.shape[0]):
        px, py = poses[i, 0], poses[i, 1]
        best = np.inf
        for k in range(num_segments[i]):
            x0, y0 = segments[i, k, 0], segments[i, k, 1]
            ex, ey = segments[i, k, 2] - x0, segments[i, k, 3] - y0
            length = ex * ex + ey * ey
            share = ((px - x0) * ex + (py - y0) * ey) / length if length > 0.0 else 0.0
            share = min(max(share, 0.0), 1.0)
            dx, dy = px - x0 - share * ex, py - y0 - share * ey
            best = min(best, dx * dx + dy * dy)
        best = np.sqrt(best)
        for k in range(num_circles[i]):
            if circle_surface[i, k] != phantom:
                gap = np.hypot(px - circles[i, k, 0], py - circles[i, k, 1]) - circles[i, k, 2]
                best = min(best, gap)
        clearance[i] = best - radius
