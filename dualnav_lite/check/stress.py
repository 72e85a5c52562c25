"""Checks of lesson 13: an interval is right where its ends fit the rate just so, and where the usual formula fails."""

import numpy as np

from dualnav_lite import metrics
from dualnav_lite.check.verdict import Text, call, expect, hold, shown

# wilson_interval(successes, trials)

Z = 1.959964  # 95 % of a normal distribution lie within so many standard deviations
PLAIN = Text(
    "the plain formula, with the deviation of the observed rate: Wilson asks which true rates fit",
    "这是简单公式，用的是观测成功率的标准差：Wilson 问的是哪些真实成功率说得通",
)
ONE_DEVIATION = Text("95 % need 1.96 standard deviations, not one", "95 % 需要 1.96 个标准差，而不是一个")
NO_TRIALS = Text("rates in [0, 1], not counts: divide by the trials", "要 [0, 1] 中的比率，不是次数：除以试验次数")
TURNED = Text("the lower end first", "先给下界")
NOT_SQUARED = Text("z squared over n in the denominator: 1 + z^2 / n", "分母中是 z 的平方除以 n：1 + z^2 / n")


def _plain(k: float, n: float) -> tuple[float, float]:
    rate = k / n
    half = Z * np.sqrt(rate * (1.0 - rate) / n)
    return rate - half, rate + half


def ninety_two_of_a_hundred(mine):
    claim = Text("92 of 100: 85.0 % to 95.9 %", "100 次中 92 次：85.0 % 到 95.9 %")
    given, right = {"successes": 92, "trials": 100}, (0.850019, 0.958907)
    usual = [
        (_plain(92, 100), PLAIN),
        (right[::-1], TURNED),
        ((0.888528, 0.943155), ONE_DEVIATION),
        (tuple(100.0 * end for end in right), NO_TRIALS),
        ((0.882672, 0.995743), NOT_SQUARED),
    ]
    expect(claim, mine, given, right, usual, 1e-4)


def no_success_is_not_certainty(mine):
    claim = Text("0 of 20: from 0 up to 16.1 %", "20 次全败：0 到 16.1 %")
    expect(claim, mine, {"successes": 0, "trials": 20}, (0.0, 0.161125), [((0.0, 0.0), PLAIN)], 1e-4)
    claim = Text("20 of 20: from 83.9 % up to 1", "20 次全胜：83.9 % 到 1")
    expect(claim, mine, {"successes": 20, "trials": 20}, (0.838875, 1.0), [((1.0, 1.0), PLAIN)], 1e-4)


def the_ends_are_just_1_96_deviations_away(mine):
    claim = Text(
        "each end p is a rate from which the observed one lies 1.96 of its own deviations sqrt(p (1 - p) / n) away",
        "每个端点 p：观测成功率与它恰好相差 1.96 个 sqrt(p (1 - p) / n)",
    )
    for k, n in ((7, 30), (81, 263), (398, 400)):
        given = {"successes": k, "trials": n}
        ends = np.asarray(call(claim, mine, given), float)
        away = np.abs(k / n - ends) / np.sqrt(ends * (1.0 - ends) / n)
        fits = ends.shape == (2,) and bool(np.allclose(away, Z, atol=2e-3))
        hold(claim, fits, shown(given), Text(f"{Z} twice", f"两个都是 {Z}"), shown(away))


def arrays_are_welcome(mine):
    claim = Text("arrays of counts give arrays of ends", "次数为数组时，端点也是数组")
    counts = np.array([20.0, 1000.0])
    given = {"successes": 0.92 * counts, "trials": counts}
    right = (np.array([0.724115, 0.901534]), np.array([0.980540, 0.935252]))
    expect(claim, mine, given, right, (), 1e-4)


CHECKS = {
    "wilson_interval": [
        ninety_two_of_a_hundred,
        no_success_is_not_certainty,
        the_ends_are_just_1_96_deviations_away,
        arrays_are_welcome,
    ]
}
REFERENCES = {"wilson_interval": metrics.wilson_interval}
