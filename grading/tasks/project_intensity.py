"""`project_intensity`: beam by beam, the strongest of a cell counts (article 4.4)."""

import math

import numpy as np

from grading.tasks import Question

BEAMS, SIZE, CELLS_PER_M = 1080, 64, 10.0


def place_of(beam: int, distance: float) -> tuple[float, float]:
    """Row and column where a beam ends, as fractions of cells."""
    angle = -math.pi + 2.0 * math.pi * beam / BEAMS
    return 32.0 - CELLS_PER_M * distance * math.cos(angle), 32.0 - CELLS_PER_M * distance * math.sin(angle)


def image_of(scan: np.ndarray) -> np.ndarray:
    """(64, 64) image of a (1080, 2) scan."""
    image = np.zeros((SIZE, SIZE))
    for beam, (distance, intensity) in enumerate(scan.tolist()):
        row, column = (math.floor(value) for value in place_of(beam, distance))
        if 0 <= row < SIZE and 0 <= column < SIZE:
            image[row, column] = max(image[row, column], min(1.0, intensity))
    return image


def a_scan(rng: np.random.Generator, beams: int, near: float, far: float, most: float = 0.95) -> np.ndarray:
    """(1080, 2) scan in which some beams come back; none ends where two cells meet, which rounding would decide."""
    scan = np.zeros((BEAMS, 2), np.float32)
    scan[:, 0] = 10.0
    for beam in rng.choice(BEAMS, beams, replace=False):
        distance, intensity = np.float32(rng.uniform(near, far)), rng.uniform(0.1, most)
        if all(1e-3 < value % 1.0 < 1.0 - 1e-3 for value in place_of(beam, float(distance))):
            scan[beam] = distance, intensity
    return scan


def questions(rng: np.random.Generator) -> list[Question]:
    """A few beams, many in one cell, some that end outside, some too bright."""

    def ask(hint, share, scan):
        return Question(hint, {"scan": scan}, {"image": image_of(scan)}, share, 1e-5)

    few, outside = a_scan(rng, 12, 0.3, 3.0), a_scan(rng, 900, 0.5, 9.0)
    return [
        ask("heading_up_and_left_is_left", 0.4, few),
        ask("strongest_of_a_cell", 0.3, a_scan(rng, 1000, 0.3, 0.8)),
        ask("beyond_the_image_no_trace", 0.3, outside),
    ]
