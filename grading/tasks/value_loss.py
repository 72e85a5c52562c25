"""`value_loss`: half the squared error, summed over the terms, a mean over the samples."""

import numpy as np

from grading.tasks import Question


def questions(rng: np.random.Generator) -> list[Question]:
    """One value head, then five."""

    def ask(hint, terms, share):
        values, returns = rng.normal(size=(24, terms)), rng.normal(size=(24, terms))
        right = {
            "loss": np.array(0.5 * np.sum((values - returns) ** 2) / 24),
            "gradient_values": (values - returns) / 24,
        }
        return Question(hint, {"values": values, "returns": returns}, right, share)

    return [ask("half_the_squared_error", 1, 0.5), ask("terms_add_up", 5, 0.5)]
