"""`goal`: gamma Phi(s') - Phi(s), Phi = -10 m of way, 0 at arrival (Ng, Harada, Russell 1999, eq. 2)."""

import numpy as np

from grading.tasks import Question

SINGLE = 5e-5  # tolerance: in single precision 10 m of way are off by 1e-5 points


def _right(before, after, reached, gamma):
    following = [0.0 if r else -10.0 * a for a, r in zip(after, reached, strict=True)]
    return np.array([gamma * f + 10.0 * b for f, b in zip(following, before, strict=True)])


def questions(rng: np.random.Generator) -> list[Question]:
    """Progress without and with discount, arrival, numbers in place of arrays."""

    def ask(hint, reached, gamma, share, **more):
        before = rng.uniform(0.5, 9.0, 12)
        after = before - rng.uniform(-0.08, 0.08, 12)
        flags = rng.random(12) < reached
        if reached:
            flags[:2] = True, False
        arrays = {"before": before, "after": after, "reached": flags, "gamma": np.array(gamma), **more}
        return Question(hint, arrays, {"values": _right(before, after, flags, gamma)}, share, SINGLE)

    return [
        ask("progress_is_paid", 0.0, 1.0, 0.3),
        ask("gamma_before_the_next_potential", 0.0, float(rng.uniform(0.9, 0.98)), 0.3),
        ask("no_potential_at_arrival", 0.5, float(rng.uniform(0.9, 0.98)), 0.3),
        ask("numbers_as_well", 0.3, 0.97, 0.1, one_by_one=np.array(True)),
    ]
