"""`paint_bands`: ten numbers in ten bands of rows, written out from the lesson's table."""

import math

import numpy as np

from dualnav_lite.encoder import BAND_EDGES
from grading.tasks import Question

SIZE = 64


def bands_of(ego: dict[str, np.ndarray]) -> np.ndarray:
    """(64, 64) image of one robot's numbers; `ego` holds the fields of `encoder.Ego` as arrays."""

    def direction(point):
        far = math.hypot(*point)
        return (point[1] / far, point[0] / far) if far > 1e-9 else (0.0, 1.0)

    far = math.hypot(*ego["goal_robot"])
    numbers = [
        max(-1.0, min(1.0, ego["twist"][0] / 0.8)),
        max(-1.0, min(1.0, ego["twist"][1] / 1.2)),
        float(ego["battery"]),
        far / (far + 2.0),
        *direction(ego["goal_robot"]),
        *direction(ego["guide_robot"]),
        max(0.0, min(1.0, float(ego["map_age_s"]) / 2.0)),
        float(ego["preference"]),
    ]
    return np.repeat(numbers, np.diff(BAND_EDGES))[:, None] * np.ones(SIZE)


def an_ego(rng: np.random.Generator, **fixed) -> dict[str, np.ndarray]:
    """Numbers of a robot, none at the end of its range; `fixed` replaces some."""

    def point():
        angle, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 8.0)
        return far * np.array([np.cos(angle), np.sin(angle)])

    drawn = {
        "twist": rng.uniform([-0.7, -1.1], [0.7, 1.1]),
        "battery": rng.uniform(0.1, 0.9),
        "goal_robot": point(),
        "guide_robot": point(),
        "map_age_s": rng.uniform(0.1, 1.9),
        "preference": rng.uniform(0.1, 0.9),
    }
    return {name: np.asarray(value, np.float64) for name, value in (drawn | fixed).items()}


def questions(rng: np.random.Generator) -> list[Question]:
    """Numbers inside their range, beyond it on each side, points at the robot's own place."""

    def ask(hint, share, **fixed):
        ego = an_ego(rng, **fixed)
        return Question(hint, ego, {"image": bands_of(ego)}, share, 1e-5)

    return [
        ask("ten_numbers_in_ten_bands", 0.3),
        ask("ten_numbers_in_ten_bands", 0.3),
        ask("bands_stay_in_their_range", 0.15, twist=(1.5, -2.0), map_age_s=7.0),
        ask("bands_stay_in_their_range", 0.05, twist=(-1.5, 2.0)),
        ask("own_place_is_straight_ahead", 0.2, goal_robot=(0.0, 0.0), guide_robot=(0.0, 0.0)),
    ]
