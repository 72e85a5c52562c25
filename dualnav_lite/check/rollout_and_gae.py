"""Checks of lesson 09: three steps worked out by hand, and the paper's sum (Schulman et al. 2016, eq. 16) elsewhere."""

import numpy as np

from dualnav_lite import rollout
from dualnav_lite.check.verdict import CLOSE, SHAPE, Text, call, expect, hold, is_close, plain

# gae(rewards, values, next_values, terminated, truncated, gamma, gae_lambda), gamma = lambda = 0.5, values all 1.

BOOTSTRAPPED = Text(
    "a terminated step has no future: leave out gamma V(s') there",
    "终止（terminated）的那一步没有未来：那里不要加 gamma V(s')",
)
LEAKED = Text(
    "the next episode's advantages leak into this one: carry nothing over an end",
    "下一回合的优势漏进了这一回合：回合结束处不要向前传递",
)
CUT = Text(
    "a truncated step was only cut off: V of its last observation still counts",
    "截断（truncated）只是被时间打断：最后观测的价值仍然要算",
)
NEXT_ROW = Text(
    "`values[t + 1]` belongs to the next episode there: use `next_values[t]`",
    "那里的 `values[t + 1]` 属于下一回合：请用 `next_values[t]`",
)
NO_LAMBDA = Text("carry gamma times lambda, not gamma alone", "向前传递时乘 gamma 和 lambda，不能只乘 gamma")
FORWARD = Text("go through the steps from the last to the first", "要从最后一步往前算")
ONE_STEP = Text("these are the deltas; each also carries what follows", "这只是 delta；每一步还要加上后面的部分")
ONLY_RETURNS = Text("first the advantages, then the returns", "先返回优势，再返回回报")
RETURNS = Text("returns are advantages plus values", "回报 = 优势 + 价值")


def _three_steps(terminated=(0, 0, 0), truncated=(0, 0, 0), next_values=(1.0, 1.0, 1.0)) -> dict:
    columns = {"rewards": (1.0, 2.0, 4.0), "values": (1.0, 1.0, 1.0), "next_values": next_values}
    given = {name: np.array(column)[:, None] for name, column in columns.items()}
    flags = {"terminated": terminated, "truncated": truncated}
    given |= {name: np.array(column, bool)[:, None] for name, column in flags.items()}
    return given | {"gamma": 0.5, "gae_lambda": 0.5}


def _pair(advantages):
    advantages = np.array(advantages)[:, None]
    return advantages, advantages + 1.0


def no_end_is_carried_all_the_way(mine):
    claim = Text("three steps of one episode; deltas 0.5, 1.5, 3.5", "同一回合的三步；delta 为 0.5、1.5、3.5")
    right = _pair([1.09375, 2.375, 3.5])
    usual = [
        (_pair([0.5 + 0.5 * (1.5 + 0.5 * 3.5), 1.5 + 0.5 * 3.5, 3.5]), NO_LAMBDA),
        (_pair([0.5, 1.5, 3.5]), ONE_STEP),
        (_pair([0.5, 1.625, 3.90625]), FORWARD),
        ((right[1], right[0]), ONLY_RETURNS),
        ((right[0], right[0]), RETURNS),
        ((right[0], right[0] - 1.0), RETURNS),
    ]
    expect(claim, mine, _three_steps(), right, usual)


def a_terminated_step_has_no_future(mine):
    claim = Text("the second step terminates its episode", "第二步终止了它的回合")
    usual = [
        (_pair([0.5 + 0.25 * 1.5, 1.5, 3.5]), BOOTSTRAPPED),
        (_pair([0.5 + 0.25 * 1.875, 1.875, 3.5]), LEAKED),
        (_pair([1.09375, 2.375, 3.5]), BOOTSTRAPPED),
    ]
    expect(claim, mine, _three_steps(terminated=(0, 1, 0)), _pair([0.75, 1.0, 3.5]), usual)


def a_truncated_step_has_one(mine):
    claim = Text(
        "the second step is cut off by the time limit; V of its last observation is 3",
        "第二步因时限被截断；其最后观测的价值为 3",
    )
    usual = [
        (_pair([0.75, 1.0, 3.5]), CUT),
        (_pair([0.5 + 0.25 * 1.5, 1.5, 3.5]), NEXT_ROW),
        (_pair([0.5 + 0.25 * 3.375, 3.375, 3.5]), LEAKED),
    ]
    given = _three_steps(truncated=(0, 1, 0), next_values=(1.0, 3.0, 1.0))
    expect(claim, mine, given, _pair([1.125, 2.5, 3.5]), usual)


def _papers_sum(rewards, values, next_values, terminated, truncated, gamma, gae_lambda):
    """Equation 16 read from left to right, a world and a start at a time."""
    steps, worlds = rewards.shape
    found = np.zeros((steps, worlds))
    for world in range(worlds):
        for start in range(steps):
            for t in range(start, steps):
                future = 0.0 if terminated[t, world] else next_values[t, world]
                delta = rewards[t, world] + gamma * future - values[t, world]
                found[start, world] += (gamma * gae_lambda) ** (t - start) * delta
                if terminated[t, world] or truncated[t, world]:
                    break
    return found


def worlds_stay_apart(mine):
    claim = Text("20 steps of 3 worlds, each with ends of its own", "3 个世界各 20 步，各有自己的结束时刻")
    rng = np.random.default_rng(9)
    given = {name: rng.normal(size=(20, 3)) for name in ("rewards", "values", "next_values")}
    given |= {name: rng.random((20, 3)) < 0.15 for name in ("terminated", "truncated")}
    given |= {"gamma": 0.9, "gae_lambda": 0.8}
    right = _papers_sum(*given.values())
    got = call(claim, mine, given)
    hold(claim, np.ndim(got) > 0 and len(got) == 2, "", "(advantages, returns)", got, ONLY_RETURNS)
    same_shape = np.shape(plain(got[0])) == right.shape
    per_world = Text(
        "look at each world's own flags: (20, 3), not (20,)", "要看每个世界自己的标志：(20, 3)，不是 (20,)"
    )
    hint = per_world if same_shape else SHAPE
    hold(claim, is_close(got[0], right, CLOSE), given, right, got[0], hint)
    hold(claim, is_close(got[1], right + given["values"], CLOSE), given, right + given["values"], got[1], RETURNS)


CHECKS = {
    "gae": [no_end_is_carried_all_the_way, a_terminated_step_has_no_future, a_truncated_step_has_one, worlds_stay_apart]
}
REFERENCES = {"gae": rollout.gae}
