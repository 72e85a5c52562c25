"""Checks of lesson 08: a loop is watched by an environment that writes down how it was used."""

import gymnasium
import numpy as np

from dualnav_lite.check.verdict import Text, call, expect, hold


class Diary(gymnasium.Env):
    """An environment of numbered observations that ends when it is told to, and remembers every call.

    Args:
        length: steps until the end.
        how: "terminated" or "truncated".
    """

    observation_space = gymnasium.spaces.Box(-1.0, 1e6, (1,))
    action_space = gymnasium.spaces.Box(-1.0, 1e6, (1,))

    def __init__(self, length: int, how: str):
        self.length, self.how = length, how
        self.seeds: list = []
        self.actions: list[float] = []

    def reset(self, *, seed=None, options=None):
        """Observation 0 and an info."""
        self.seeds.append(seed)
        self.actions = []
        return np.zeros(1), {"number": 0}

    def step(self, action):
        """The next number; reward 1, 2, 3, ...; `RuntimeError` after the end."""
        if len(self.actions) >= self.length:
            raise RuntimeError(AFTER.en)
        self.actions.append(float(np.asarray(action).reshape(-1)[0]))
        count = len(self.actions)
        is_last = count == self.length
        ends = is_last and self.how == "terminated", is_last and self.how == "truncated"
        return np.array([float(count)]), float(count), *ends, {"number": count}


def _follow(observation, info):
    return np.array([observation[0] + 10.0 * info["number"]])


AFTER = Text("a step after the end of the episode", "回合结束后又走了一步")
FIVE = Text(
    "Gymnasium gives five values a step: observation, reward, terminated, truncated, info",
    "Gymnasium 每步返回五个值：observation、reward、terminated、truncated、info",
)
TWO = Text("`reset` gives two values: observation and info", "`reset` 返回两个值：observation 和 info")
STOP = Text("stop at the end of the episode, whichever way it ends", "回合结束就停下，不论是哪种结束")
STALE = Text("look at the newest observation and info at every step", "每一步都要用最新的 observation 和 info")
SEED = Text("hand the seed to `reset`", "把种子传给 `reset`")
LAST = Text("count the last step's reward as well", "最后一步的奖励也要计入")
WHICH = Text("`terminated` is an end for good, `truncated` the clock", "`terminated` 是真正结束，`truncated` 是时间到")


def _looped(mine, claim, length, how):
    """The diary after the student's loop, and what the loop returned."""
    diary = Diary(length, how)
    episode = Text(f"an episode of {length} steps, {how}", f"一个 {length} 步的回合，{how}")

    def looped(seed):
        try:
            return mine(diary, _follow, seed)
        except NotImplementedError:  # a RuntimeError too, but the stub's own: `call` tells what it means
            raise
        except RuntimeError as error:
            hold(claim, False, episode, "", AFTER if str(error) == AFTER.en else str(error), STOP)
        except (ValueError, TypeError, IndexError) as error:
            text = str(error)
            is_pair = any(word in text for word in ("index", "indices", "unpack"))
            hint = FIVE if "unpack" in text and "4" in text else TWO if is_pair else None
            hold(claim, False, episode, "", f"{type(error).__name__}: {text}", hint)

    return diary, call(claim, looped, {"seed": 5})


def a_terminated_episode_ends(mine):
    claim = Text("an episode of 4 steps that terminates: reward 1 + 2 + 3 + 4", "4 步后终止的回合：奖励 1 + 2 + 3 + 4")
    diary, got = _looped(mine, claim, 4, "terminated")
    right = {"reward": 10.0, "steps": 4, "ended": "terminated"}
    is_dict = isinstance(got, dict) and set(got) == set(right)
    hold(claim, is_dict, "", "reward, steps, ended", got)
    usual = [
        ({"reward": 6.0, "steps": 4}, LAST),
        ({"reward": 6.0, "steps": 3}, LAST),
        ({"reward": 10.0, "steps": 3}, LAST),
    ]
    numbers = {"reward": got["reward"], "steps": got["steps"]}
    expect(claim, lambda length: numbers, {"length": 4}, {"reward": 10.0, "steps": 4}, usual)
    hold(claim, got["ended"] == "terminated", "", "terminated", str(got["ended"]), WHICH)
    claim = Text("the seed reaches `reset`", "种子传给了 `reset`")
    hold(claim, diary.seeds == [5], "", "[5]", str(diary.seeds), SEED)


def a_truncated_episode_ends_too(mine):
    claim = Text("an episode of 3 steps that the clock cuts off", "3 步后因时限截断的回合")
    _, got = _looped(mine, claim, 3, "truncated")
    hold(claim, got["steps"] == 3, "", "3", got["steps"], STOP)
    hold(claim, got["ended"] == "truncated", "", "truncated", str(got["ended"]), WHICH)


def every_choice_sees_the_newest_state(mine):
    claim = Text("the driver sees the state that the last step led to", "驾驶者看到的是上一步到达的状态")
    diary, _ = _looped(mine, claim, 4, "terminated")
    hold(claim, diary.actions == [0.0, 11.0, 22.0, 33.0], "", "[0, 11, 22, 33]", str(diary.actions), STALE)


def long_episodes_are_driven_to_their_end(mine):
    claim = Text("an episode of 700 steps is driven to its end", "700 步的回合要开到结束")
    early = Text("do not stop at 500: the environment says when", "不要在 500 步停下：由环境决定何时结束")
    _, got = _looped(mine, claim, 700, "truncated")
    hold(claim, got["steps"] == 700, "", "700", got["steps"], early)


def _reference(env, choose, seed):
    observation, info = env.reset(seed=seed)
    rewards, terminated, truncated = [], False, False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step(choose(observation, info))
        rewards.append(reward)
    return {"reward": sum(rewards), "steps": len(rewards), "ended": "terminated" if terminated else "truncated"}


CHECKS = {
    "closed_loop": [
        a_terminated_episode_ends,
        a_truncated_episode_ends_too,
        every_choice_sees_the_newest_state,
        long_episodes_are_driven_to_their_end,
    ]
}
REFERENCES = {"closed_loop": _reference}
