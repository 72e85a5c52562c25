"""`closed_loop`: an episode that is written down beforehand; what the loop earned, chose and told is compared.

The environment stands inside, as a student's loop must call it, and holds nothing but the script that was sent.
"""

import numpy as np

from grading.tasks import Question

ALSO = {
    "seed": "seed_goes_to_reset",
    "actions": "newest_state_decides",
    "steps": "loop_ends_with_the_episode",
    "reward": "every_reward_counts",
    "is_terminated": "terminated_or_truncated",
}


def questions(rng: np.random.Generator) -> list[Question]:
    """Ends of both kinds, long and short."""

    def ask(hint, share, length, is_terminated):
        script = {
            "observations": rng.normal(size=(length + 1, 3)),
            "numbers": rng.normal(size=length + 1),
            "rewards": rng.normal(size=length),
            "is_terminated": np.array(is_terminated),
            "seed": np.array(rng.integers(1, 1 << 30)),
            "gain": rng.normal(size=3),
        }
        chosen = script["observations"][:-1] @ script["gain"] + script["numbers"][:-1]
        right = {
            "seed": script["seed"].astype(float),
            "actions": chosen,
            "steps": np.array(float(length)),
            "reward": np.array(script["rewards"].sum()),
            "is_terminated": np.array(float(is_terminated)),
        }
        return Question(hint, script, right, share, 1e-6, ALSO)

    return [
        ask("loop_ends_with_the_episode", 0.4, int(rng.integers(4, 9)), True),
        ask("loop_ends_with_the_episode", 0.4, int(rng.integers(4, 9)), False),
        ask("loop_ends_with_the_episode", 0.2, int(rng.integers(600, 900)), False),
    ]
