"""`gae`: the library's slow twin sums what the paper defines (Schulman et al. 2016, eq. 16)."""

import numpy as np

from dualnav_lite.rollout import gae_reference
from grading.tasks import Question


def questions(rng: np.random.Generator) -> list[Question]:
    """One step, the recursion, a terminated step, a truncated one, many worlds with both."""

    def ask(hint, share, gae_lambda, ends=(), worlds=3, steps=12):
        shape = (steps, worlds)
        rewards, values, next_values = (rng.normal(size=shape) for _ in range(3))
        flags = {name: np.zeros(shape, bool) for name in ("terminated", "truncated")}
        for name in ends:  # in the middle of each world, so that what leaks over an end is seen
            for world in range(worlds):
                flags[name][rng.integers(2, steps - 3) + 2 * (name == "truncated"), world] = True
        gamma = float(rng.uniform(0.9, 0.99))
        arrays = {"rewards": rewards, "values": values, "next_values": next_values, **flags}
        advantages, returns = gae_reference(*arrays.values(), gamma, gae_lambda)
        arrays |= {"gamma": np.array(gamma), "gae_lambda": np.array(gae_lambda)}
        also = {"returns": "returns_are_advantages_plus_values"}
        return Question(hint, arrays, {"advantages": advantages, "returns": returns}, share, 1e-5, also)

    some = float(rng.uniform(0.8, 0.97))
    return [
        ask("one_step_is_the_td_error", 0.2, 0.0),
        ask("later_errors_count_less", 0.2, some),
        ask("terminated_has_no_future", 0.2, some, ["terminated"]),
        ask("truncated_keeps_its_value_and_ends", 0.2, some, ["truncated"]),
        ask("each_world_for_itself", 0.2, some, ["terminated", "truncated"], worlds=7, steps=30),
    ]
