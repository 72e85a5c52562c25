"""Checks of lesson 05: straight lines and distances worked out by hand."""

from types import SimpleNamespace

import numpy as np

from dualnav_lite import forecast_errors, tracking
from dualnav_lite.check.verdict import Text, call, expect, hold

# constant_velocity(positions, velocities)

FROM_NOW = Text(
    "the first of the 20 is 0.1 s from now, the last 2 s", "20 个位置中第一个是 0.1 s 之后，最后一个是 2 s 之后"
)
TENTHS = Text("a step is 0.1 s: times are 0.1, 0.2, ... 2.0", "一步是 0.1 s：时间为 0.1、0.2……2.0")
BACK = Text("add the way, do not take it away", "位移要加上，而不是减去")
ORDER = Text("the shape is (k, 20, 2): mover, step, x and y", "形状为 (k, 20, 2)：移动物体、步、x 与 y")
STANDS = Text("it moves: add time x velocity", "它在移动：加上 时间 x 速度")
POSITIONS = np.array([[2.0, 1.0], [-1.0, 0.5], [3.0, 0.0]])
VELOCITIES = np.array([[0.5, -1.0], [0.0, 0.0], [-0.8, 0.4]])


def _lines(times, sign=1.0):
    x = POSITIONS[:, :1] + sign * VELOCITIES[:, :1] * times
    y = POSITIONS[:, 1:] + sign * VELOCITIES[:, 1:] * times
    return np.stack([x, y], axis=-1)


def they_go_straight_on(mine):
    claim = Text(
        "three movers, 20 positions each, the last one 2 s ahead", "三个移动物体，各 20 个位置，最后一个在 2 s 之后"
    )
    times = 0.1 * np.arange(1, 21)
    usual = [
        (_lines(times - 0.1), FROM_NOW),
        (_lines(np.linspace(0.0, 2.0, 20)), FROM_NOW),
        (_lines(10.0 * times), TENTHS),
        (_lines(times, -1.0), BACK),
        (_lines(times).swapaxes(0, 1), ORDER),
        (_lines(0.0 * times), STANDS),
    ]
    expect(claim, mine, {"positions": POSITIONS, "velocities": VELOCITIES}, _lines(times), usual)


def nobody_is_forecast_as_nobody(mine):
    claim = Text("without movers the answer is empty: (0, 20, 2)", "没有移动物体时结果为空：(0, 20, 2)")
    expect(claim, mine, {"positions": np.zeros((0, 2)), "velocities": np.zeros((0, 2))}, np.zeros((0, 20, 2)))


# displacement_errors(predicted, happened)

LENGTH = Text("an error is a distance: the root of the sum of squares of x and y", "误差是距离：x 与 y 平方和的平方根")
INDEX = Text("1 s is the tenth position: index 9; 2 s is the last", "1 s 是第十个位置：下标 9；2 s 是最后一个")
ENDS = Text("FDE looks at one moment, ADE at all", "FDE 只看一个时刻，ADE 看全部")
RADIUS = Text("a hit is within 0.3 m at 1 s and within 0.5 m at 2 s", "命中：1 s 时 0.3 m 以内，2 s 时 0.5 m 以内")
SHARE = Text("a hit rate is a share in [0, 1]", "命中率是 [0, 1] 内的比例")
ROOT = Text("mean of the distances, not the root of the mean square", "是距离的平均，不是均方根")


def _errors():
    """Distances of three movers, one off more and more, two always by as much, and what is to come out."""
    distances = np.stack([0.04 * np.arange(1, 21), np.full(20, 0.04), np.full(20, 0.6)])
    right = {"ade_m": 1.06 / 3, "fde_1s_m": 1.04 / 3, "fde_2s_m": 1.44 / 3, "hit_1s": 1 / 3, "hit_2s": 1 / 3}
    return distances, right


def _given():
    distances, _ = _errors()
    happened = np.arange(120, dtype=float).reshape(3, 20, 2) / 10.0
    return {"predicted": happened + distances[..., None] * [0.6, -0.8], "happened": happened}


NAMES = {
    "ade_m": Text("'ade_m': the mean distance over all movers and steps", "'ade_m'：所有移动物体、所有步的平均距离"),
    "fde_1s_m": Text("'fde_1s_m': the mean distance at 1 s", "'fde_1s_m'：1 s 时的平均距离"),
    "fde_2s_m": Text("'fde_2s_m': the mean distance at 2 s", "'fde_2s_m'：2 s 时的平均距离"),
    "hit_1s": Text("'hit_1s': the share within 0.3 m at 1 s", "'hit_1s'：1 s 时 0.3 m 以内的比例"),
    "hit_2s": Text("'hit_2s': the share within 0.5 m at 2 s", "'hit_2s'：2 s 时 0.5 m 以内的比例"),
}


def _one(mine, name):
    def chosen(predicted, happened):
        return mine(predicted, happened)[name]

    return chosen


def the_numbers_have_their_names(mine):
    claim = Text(f"a dictionary with the keys {', '.join(NAMES)}", f"返回字典，键为 {', '.join(NAMES)}")
    got = call(claim, mine, _given())
    hold(claim, isinstance(got, dict) and set(got) == set(NAMES), "", ", ".join(NAMES), got)


def each_number_is_right(mine):
    distances, right = _errors()
    offsets = distances[..., None] * [0.6, -0.8]
    usual = {
        "ade_m": [
            (np.abs(offsets).mean(), LENGTH),
            (np.abs(offsets).sum(axis=-1).mean(), LENGTH),
            (np.square(distances).mean(), LENGTH),
            (np.square(offsets).mean(), LENGTH),
            (np.sqrt(np.square(distances).mean()), ROOT),
            (distances[:, -1].mean(), ENDS),
        ],
        "fde_1s_m": [(distances[:, 10].mean(), INDEX), (distances[:, :10].mean(), ENDS)],
        "fde_2s_m": [(distances[:, 18].mean(), INDEX), (distances.mean(), ENDS)],
        "hit_1s": [(2 / 3, RADIUS), (1.0, SHARE), (100 / 3, SHARE)],
        "hit_2s": [(0.0, RADIUS), (1.0, SHARE), (100 / 3, SHARE)],
    }
    for name, claim in NAMES.items():
        expect(claim, _one(mine, name), _given(), right[name], usual[name])


def the_radii_are_as_stated(mine):
    claim = NAMES["hit_1s"]
    happened = np.zeros((4, 20, 2))
    predicted = happened.copy()
    predicted[:, :, 0] = np.array([0.0, 0.25, 0.45, 0.6])[:, None]
    given = {"predicted": predicted, "happened": happened}
    expect(claim, _one(mine, "hit_1s"), given, 0.5, [(0.75, RADIUS), (2.0, SHARE), (3.0, SHARE), (1.0, RADIUS)])
    expect(NAMES["hit_2s"], _one(mine, "hit_2s"), given, 0.75, [(0.5, RADIUS), (3.0, SHARE), (1.0, RADIUS)])


def _constant_velocity(positions, velocities):
    valid = np.ones(len(positions), bool)
    tracks = SimpleNamespace(positions=positions, velocities=velocities, valid=valid, radii=np.full(len(valid), 0.3))
    return tracking.constant_velocity(tracks).positions


def _displacement_errors(predicted, happened):
    row = forecast_errors.summary("", "", np.linalg.norm(predicted - happened, axis=-1))
    return {name: float(row[name]) for name in NAMES}


CHECKS = {
    "constant_velocity": [they_go_straight_on, nobody_is_forecast_as_nobody],
    "displacement_errors": [the_numbers_have_their_names, each_number_is_right, the_radii_are_as_stated],
}
REFERENCES = {"constant_velocity": _constant_velocity, "displacement_errors": _displacement_errors}
