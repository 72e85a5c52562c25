"""`policy_loss`: the clipped objective sample by sample in numpy, and its gradient worked out by hand."""

import numpy as np

from grading.tasks import Question


def _right(new, old, advantages, clip_range):
    """-mean min(r A, clip(r) A); its derivative by log pi is -r A / n where the first of the two is the smaller."""
    ratio = np.exp(new - old)
    clipped = np.clip(ratio, 1.0 - clip_range, 1.0 + clip_range)
    free = ratio * advantages <= clipped * advantages
    loss = -np.mean(np.minimum(ratio * advantages, clipped * advantages))
    return {"loss": np.array(loss), "gradient_log_probs": np.where(free, -ratio * advantages / len(new), 0.0)}


def questions(rng: np.random.Generator) -> list[Question]:
    """Inside the clip range, outside on each side with each sign of the advantage."""
    clip_range = float(rng.uniform(0.1, 0.3))

    def ask(hint, low, high, sign, share):
        old = rng.normal(-1.0, 0.5, 32)
        new = old + np.log(rng.uniform(low, high, 32))
        advantages = rng.uniform(0.2, 2.0, 32) * (sign or rng.choice([-1.0, 1.0], 32))
        arrays = {
            "log_probs": new,
            "old_log_probs": old,
            "advantages": advantages,
            "clip_range": np.array(clip_range),
        }
        return Question(hint, arrays, _right(new, old, advantages, clip_range), share)

    near, far = 0.9 * clip_range, 1.2 * clip_range
    return [
        ask("ratio_times_advantage", 1.0 - near, 1.0 + near, 0, 0.3),
        ask("good_and_already_likelier_is_clipped", 1.0 + far, 1.9, 1, 0.2),
        ask("bad_and_already_rarer_is_clipped", 0.4, 1.0 - far, -1, 0.2),
        ask("mistakes_are_never_clipped", 1.0 + far, 1.9, -1, 0.15),
        ask("mistakes_are_never_clipped", 0.4, 1.0 - far, 1, 0.15),
    ]
