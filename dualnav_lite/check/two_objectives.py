"""Checks of lesson 12: small tables whose fronts can be read off, and every pair compared elsewhere."""

import numpy as np

from dualnav_lite.check.verdict import SHAPE, Text, call, expect, hold, plain
from dualnav_lite.pareto import on_front

ARTICLE = Text(
    "the article's own mistake: 0.42 m for 18.3 J is better in both than 0.31 m for 22.7 J",
    "这正是原文的错误：0.42 m、18.3 J 在两项上都优于 0.31 m、22.7 J",
)
TURNED = Text("more distance is better, less energy is better", "距离越大越好，能耗越小越好")
BOTH = Text("one that is equal in one number and worse in the other is dominated", "一项相等、另一项更差的点也被支配")
TWINS = Text(
    "of two equal points neither dominates the other: one number must be strictly better",
    "两个相同的点互不支配：至少一项要严格更好",
)
ONLY_EXTREMES = Text("the front is more than the best in each number", "前沿不只是各单项最优的点")


def _given(safe_dist_m, energy_j) -> dict:
    return {"safe_dist_m": np.array(safe_dist_m), "energy_j": np.array(energy_j)}


def the_articles_table(mine):
    claim = Text(
        "the article's table (its 5.1): one point dominates the other three", "原文 5.1 的表：一个点支配其余三个"
    )
    given = _given([0.42, 0.31, 0.25, 0.38], [18.3, 22.7, 35.1, 29.5])
    usual = [
        (np.array([True, True, False, False]), ARTICLE),
        (np.array([False, False, True, False]), TURNED),
        (np.array([True, False, True, True]), TURNED),
        (np.array([False, True, True, True]), Text("True for those that nobody dominates", "未被支配的为 True")),
    ]
    expect(claim, mine, given, np.array([True, False, False, False]), usual)


def a_front_of_three(mine):
    claim = Text("a front of three and one point behind it, in no order", "前沿上三个点，后面一个点，次序任意")
    given = _given([0.2, 0.5, 0.3, 0.35], [10.0, 40.0, 30.0, 20.0])
    usual = [
        (np.array([True, True, False, False]), ONLY_EXTREMES),
        (np.array([False, False, True, False]), TURNED),
        (np.array([True, False, False, False]), TURNED),
    ]
    expect(claim, mine, given, np.array([True, True, False, True]), usual)


def equal_in_one_worse_in_the_other(mine):
    claim = Text("0.4 m for 20 J and 0.4 m for 18 J; 0.3 m for 18 J", "0.4 m 用 20 J，0.4 m 用 18 J，0.3 m 用 18 J")
    usual = [
        (np.array([True, True, True]), BOTH),
        (np.array([True, True, False]), BOTH),
        (np.array([False, True, True]), BOTH),
    ]
    expect(claim, mine, _given([0.4, 0.4, 0.3], [20.0, 18.0, 18.0]), np.array([False, True, False]), usual)


def twins_stay(mine):
    claim = Text("two equal points, both on the front", "两个相同的点都在前沿上")
    usual = [(np.array([False, False]), TWINS), (np.array([True, False]), TWINS), (np.array([False, True]), TWINS)]
    expect(claim, mine, _given([0.4, 0.4], [20.0, 20.0]), np.array([True, True]), usual)


def every_pair_agrees(mine):
    claim = Text("60 points on a coarse grid, every pair compared", "粗网格上的 60 个点，逐对比较")
    rng = np.random.default_rng(12)
    given = _given(rng.integers(0, 8, 60) / 10.0, rng.integers(10, 18, 60) * 1.0)
    right = _each_pair(*given.values())
    got = np.asarray(plain(call(claim, mine, given)))
    hold(claim, got.shape == (60,), "", "(60,)", str(got.shape), SHAPE)
    wrong = np.flatnonzero(got.astype(bool) != right)
    place = ""
    if len(wrong):
        numbers = f"{given['safe_dist_m'][wrong[0]]} m, {given['energy_j'][wrong[0]]} J"
        place = Text(f"point {wrong[0]}: {numbers}", f"点 {wrong[0]}：{numbers}")
    hold(claim, not len(wrong), place, str(right[wrong[:1]]), str(got[wrong[:1]]), BOTH)


def _each_pair(safe_dist_m, energy_j):
    """Every pair, one after another."""
    front = np.ones(len(safe_dist_m), bool)
    for i in range(len(front)):
        for k in range(len(front)):
            no_worse = safe_dist_m[k] >= safe_dist_m[i] and energy_j[k] <= energy_j[i]
            better = safe_dist_m[k] > safe_dist_m[i] or energy_j[k] < energy_j[i]
            if no_worse and better:
                front[i] = False
    return front


CHECKS = {
    "pareto_front": [
        the_articles_table,
        a_front_of_three,
        equal_in_one_worse_in_the_other,
        twins_stay,
        every_pair_agrees,
    ]
}
REFERENCES = {"pareto_front": lambda safe_dist_m, energy_j: on_front(np.stack([safe_dist_m, energy_j], axis=1))}
