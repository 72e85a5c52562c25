"""Fields around the robot from what it sees: occupied cells and the distance to them."""

import cv2
import numpy as np

CELLS = 64
RESOLUTION_M = 0.1
ORIGIN_M = -0.5 * CELLS * RESOLUTION_M  # the robot stands in the middle; x ahead along columns, y left along rows
_FAR_M = 10.0


def occupied_cells(crop, threshold: float):
    """(64, 64) bool, solid cells of a map crop (`info["map"]`) in the order [iy, ix] of these fields."""
    turned = crop[::-1, ::-1].T
    return np.ascontiguousarray(turned >= threshold)


def clearance_around(points, cells=None):
    """Distance from the centre of each cell around the robot to the nearest point or occupied cell.

    Args:
        points: (p, 2) hits of the scan [m], robot frame.
        cells: (64, 64) bool, further solid cells, or None.

    Returns:
        (64, 64) f64 [m]. A hit counts where it really lies, at a centimetre; of several in a cell one counts.
    """
    occupied = np.zeros((CELLS, CELLS), bool) if cells is None else cells.copy()
    grid = np.floor((points - ORIGIN_M) / RESOLUTION_M).astype(int)
    inside = ((grid >= 0) & (grid < CELLS)).all(axis=1)
    ix, iy = grid[inside, 0], grid[inside, 1]
    occupied[iy, ix] = True
    if not occupied.any():
        return np.full((CELLS, CELLS), _FAR_M)
    centre = ORIGIN_M + (np.arange(CELLS) + 0.5) * RESOLUTION_M
    where = np.empty((CELLS, CELLS, 2))
    where[..., 0], where[..., 1] = centre, centre[:, None]
    at = where.copy()
    at[iy, ix] = points[inside]
    _, labels = cv2.distanceTransformWithLabels(
        (~occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.zeros((labels.max() + 1, 2))
    nearest[labels[occupied]] = at[occupied]
    gap = nearest[labels] - where
    return np.hypot(gap[..., 0], gap[..., 1])
