"""What a surface is: one table for the lidar, the semantic map and the contact sensor."""

from enum import IntEnum

import numpy as np


class Surface(IntEnum):
    """What a lidar beam or the hull can meet."""

    NOTHING = 0
    WALL = 1
    DOOR = 2  # the jambs; the opening itself is free
    FURNITURE = 3
    PERSON = 4
    BOX = 5  # pushable boxes, pop-up boxes and the forklift-sized mover
    ROBOT = 6
    PHANTOM = 7  # a reflection in low light: a beam sees it, a hull does not


# Reflectivity of each surface before incidence and range are counted, in [0, 1].
REFLECTIVITY = np.array([0.0, 0.70, 0.55, 0.45, 0.35, 0.60, 0.50, 0.18])

# What the front end that labels lidar hits (the stand-in for a segmentation network) calls each surface.
# It knows people and robots; a phantom or a box looks like furniture to it.
LABEL = np.array(
    [
        Surface.NOTHING,
        Surface.WALL,
        Surface.DOOR,
        Surface.FURNITURE,
        Surface.PERSON,
        Surface.FURNITURE,
        Surface.PERSON,
        Surface.FURNITURE,
    ],
    dtype=np.uint8,
)


class Cell(IntEnum):
    """What a cell of the semantic map holds."""

    FREE = 0
    UNKNOWN = 1
    DOOR = 2
    FURNITURE = 3
    WALL = 4


# Channel 0 of the observation shows a cell as this value.
CELL_VALUE = np.array([0.0, 1 / 6, 1 / 3, 2 / 3, 1.0], dtype=np.float32)

# Outcome column of `episodes.csv` after a contact with each surface.
CONTACT_OUTCOME = {
    Surface.WALL: "hit_wall",
    Surface.DOOR: "hit_wall",
    Surface.FURNITURE: "hit_furniture",
    Surface.PERSON: "hit_person",
    Surface.BOX: "hit_box",
    Surface.ROBOT: "hit_robot",
}
