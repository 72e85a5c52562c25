"""`safe`: -10 (0.3 - c)^2 below 0.3 m, a negative clearance counts as 0 (article 4.2)."""

import numpy as np

from grading.tasks import Question


def _right(clearance):
    return np.array([-10.0 * max(0.0, 0.3 - max(0.0, c)) ** 2 for c in clearance])


def questions(rng: np.random.Generator) -> list[Question]:
    """Close, far, overlapping, numbers in place of arrays; some are close in each, so that no constant is right."""

    def ask(hint, low, high, share, name="clearance"):
        clearance = rng.permutation(np.concatenate([rng.uniform(0.02, 0.28, 8), rng.uniform(low, high, 8)]))
        return Question(hint, {name: clearance}, {"values": _right(clearance)}, share)

    return [
        ask("close_costs_the_square", 0.02, 0.28, 0.4),
        ask("far_costs_nothing", 0.31, 9.0, 0.3),
        ask("overlap_is_contact", -0.2, -0.01, 0.2),
        ask("numbers_as_well", -0.1, 1.0, 0.1, "one_by_one"),
    ]
