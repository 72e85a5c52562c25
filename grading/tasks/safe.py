"""`safe`: -10 (0.3 - c)^2 below 0.3 m, a negative clearance counts as 0 (article 4.2)."""

import numpy as np

from grading.tasks import Question


def _right(clearance):
    return np.array([-10.0 * max(0.0, 0.3 - max(0.0, c)) ** 2 for c in clearance])


def questions(rng: np.random.Generator) -> list[Question]:
    """Close, far, overlapping, and numbers in place of arrays."""

    def ask(hint, clearance, share, name="clearance"):
        return Question(hint, {name: clearance}, {"values": _right(clearance)}, share)

    return [
        ask("close_costs_the_square", rng.uniform(0.02, 0.28, 16), 0.4),
        ask("far_costs_nothing", rng.uniform(0.31, 9.0, 16), 0.3),
        ask("overlap_is_contact", rng.uniform(-0.2, -0.01, 8), 0.2),
        ask("numbers_as_well", rng.uniform(-0.1, 1.0, 8), 0.1, "one_by_one"),
    ]
