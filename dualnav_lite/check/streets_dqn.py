"""Checks of lesson 17: two small tables of values, and targets that can be read off them."""

import torch

from dualnav_lite import dqn
from dualnav_lite.check.verdict import Text, call, expect, hold, shown

# td_target(values, slow_values, rewards, terminated, gamma)

ONE_NETWORK = Text(
    "the network that chose also valued: `values` chooses, `slow_values` says what it is worth",
    "选择与估值用了同一个网络：由 `values` 选择，由 `slow_values` 估值",
)
SLOW_CHOSE = Text(
    "the slow network chose as well: `values` chooses, `slow_values` says what it is worth",
    "选择也用了慢网络：由 `values` 选择，由 `slow_values` 估值",
)
TURNED = Text(
    "the other way round: `values` chooses, `slow_values` values", "弄反了：`values` 选择，`slow_values` 估值"
)
NO_END = Text("home is the end: where it terminated the target is the reward alone", "到家即结束：终止处的目标只有奖励")
NO_REWARD = Text("the reward of the step comes first", "先有这一步的奖励")
NO_GAMMA = Text("what comes later is worth gamma of it", "后续价值要乘以 gamma")
INFINITE = Text(
    "-inf marks a street that does not exist; times 0 it is nan: choose with `torch.where`",
    "-inf 表示不存在的街道，乘以 0 得 nan：请用 `torch.where` 选取",
)
VALUES = torch.tensor([[1.0, 5.0], [2.0, 1.0]])
SLOW = torch.tensor([[9.0, 2.0], [3.0, 4.0]])


def _given(values, slow_values, rewards, terminated, gamma: float) -> dict:
    return {
        "values": values,
        "slow_values": slow_values,
        "rewards": torch.tensor(rewards),
        "terminated": torch.tensor(terminated),
        "gamma": gamma,
    }


def one_chooses_the_other_values(mine):
    claim = Text(
        "two states, gamma 1: the first network picks streets 1 and 0, the slow one says 2 and 3",
        "两个状态、gamma 为 1：第一个网络选 1 和 0 号街道，慢网络给出 2 和 3",
    )
    usual = [
        (torch.tensor([4.0, 1.0]), ONE_NETWORK),
        (torch.tensor([8.0, 3.0]), SLOW_CHOSE),
        (torch.tensor([0.0, 0.0]), TURNED),
        (torch.tensor([2.0, 3.0]), NO_REWARD),
    ]
    expect(claim, mine, _given(VALUES, SLOW, [-1.0, -1.0], [False, False], 1.0), torch.tensor([1.0, 2.0]), usual)


def what_comes_later_counts_less(mine):
    claim = Text("the same with gamma 0.5", "同上，gamma 为 0.5")
    usual = [(torch.tensor([1.0, 2.0]), NO_GAMMA), (torch.tensor([0.5, 1.0]), NO_GAMMA)]
    expect(claim, mine, _given(VALUES, SLOW, [-1.0, -1.0], [False, False], 0.5), torch.tensor([0.0, 0.5]), usual)


def home_has_no_future(mine):
    claim = Text("the second walk ended at home", "第二段路已到家")
    usual = [
        (torch.tensor([1.0, 2.0]), NO_END),
        (torch.tensor([1.0, 0.0]), NO_REWARD),
        (torch.tensor([-1.0, 2.0]), NO_END),
    ]
    expect(claim, mine, _given(VALUES, SLOW, [-1.0, -1.0], [False, True], 1.0), torch.tensor([1.0, -1.0]), usual)


def streets_that_do_not_exist_stay_out(mine):
    claim = Text("a street that does not exist, and a state without any", "有一条街道不存在，另一个状态没有街道")
    none = -torch.inf
    values, slow = torch.tensor([[none, 5.0], [none, none]]), torch.tensor([[none, 2.0], [none, none]])
    usual = [(torch.tensor([1.0, none]), NO_END), (torch.tensor([4.0, -1.0]), ONE_NETWORK)]
    given, right = _given(values, slow, [-1.0, -1.0], [False, True], 1.0), torch.tensor([1.0, -1.0])
    got = call(claim, mine, given)
    hold(claim, "nan" not in shown(got), shown(given), shown(right), shown(got), INFINITE)
    expect(claim, mine, given, right, usual)


CHECKS = {
    "td_target": [
        one_chooses_the_other_values,
        what_comes_later_counts_less,
        home_has_no_future,
        streets_that_do_not_exist_stay_out,
    ]
}
REFERENCES = {"td_target": dqn.td_target}
