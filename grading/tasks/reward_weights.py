"""`reward_weights`: 0.45 * 2 (1 - p), 0.25, 0.20 * 2p (1 + 3 (1 - b)), 0.10, 1."""

import numpy as np

from grading.tasks import Question


def questions(rng: np.random.Generator) -> list[Question]:
    """The middle, which tells a mistake and is worth nothing since a constant answers it; preference, charge."""

    def ask(hint, preference, charge, share):
        right = [
            [0.9 * (1.0 - p), 0.25, 0.4 * p * (1.0 + 3.0 * (1.0 - b)), 0.1, 1.0]
            for p, b in zip(preference, charge, strict=True)
        ]
        return Question(hint, {"preference": preference, "charge": charge}, {"values": np.array(right)}, share)

    return [
        ask("article_weights_in_the_middle", np.full(2, 0.5), np.ones(2), 0.0),
        ask("preference_moves_two_weights", rng.uniform(0.0, 1.0, 8), np.ones(8), 0.5),
        ask("charge_raises_energy", rng.uniform(0.1, 1.0, 8), rng.uniform(0.0, 0.9, 8), 0.5),
    ]
