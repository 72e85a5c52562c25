"""The exercise of lesson 08: a loop over an environment that is written down beforehand."""

import numpy as np

from .arrays import numbers, theirs


class _Script:
    """An environment that is written down beforehand; after its end nothing more happens."""

    def __init__(self, given):
        self.given, self.steps, self.actions, self.seed = given, 0, [], -1.0

    def _state(self):
        k = min(self.steps, len(self.given["rewards"]))
        return self.given["observations"][k].copy(), {"number": self.given["numbers"][k].item()}

    def reset(self, *, seed=None, options=None):
        self.seed, self.steps, self.actions = float(-1 if seed is None else seed), 0, []
        return self._state()

    def step(self, action):
        length = len(self.given["rewards"])
        if self.steps < length:
            self.actions.append(float(action))
        reward = self.given["rewards"][self.steps].item() if self.steps < length else 0.0
        self.steps += 1
        observation, info = self._state()
        is_last, is_terminated = self.steps == length, bool(self.given["is_terminated"])
        if self.steps > length:
            return observation, reward, True, True, info  # a loop that went on past the end comes to one
        return observation, reward, is_last and is_terminated, is_last and not is_terminated, info


def closed_loop(names, given, kept):
    env = _Script(given)

    def choose(observation, info):
        return float(observation @ given["gain"]) + info["number"]

    told = theirs(names, "closed_loop")(env, choose, given["seed"].item())
    actions = np.zeros(len(given["rewards"]))
    actions[: len(env.actions)] = env.actions
    ends = {"terminated": 1.0, "truncated": 0.0}
    return {
        "seed": numbers(env.seed),
        "actions": actions,
        "steps": numbers(told["steps"]),
        "reward": numbers(told["reward"]),
        "is_terminated": numbers(ends[told["ended"]]),
    }
