"""Checks of lesson 01: the truths are worked out by hand from the formulas of the lesson."""

import numpy as np

from dualnav_lite.check.verdict import Text, call, expect, hold
from dualnav_lite.config import Config
from dualnav_lite.kernels import drive as kernel
from dualnav_lite.robot import drive_parameters

# step_pose(pose, v_left, v_right, track, dt)

SWAPPED = Text(
    "omega = (right - left) / track: a faster right wheel turns left", "omega =（右 - 左）/ 轮距：右轮快则左转"
)
TRACK = Text("divide the difference of the wheels by the whole track", "两轮速度之差要除以整个轮距")
EULER = Text(
    "go along the heading in the middle of the step: theta + omega dt / 2", "沿本步中间的朝向前进：theta + omega dt / 2"
)
NO_DT = Text("a speed times dt is a way", "速度乘 dt 才是路程")
SUM = Text("v is the mean of both wheels, not their sum", "v 是两轮速度的平均，不是和")
AXES = Text("x goes with the cosine of the heading, y with the sine", "x 用朝向的余弦，y 用正弦")


def a_straight_step_is_the_mean_speed(mine):
    claim = Text("both wheels at 0.5 m/s for 0.1 s: 5 cm straight on", "两轮均为 0.5 m/s，0.1 s：直行 5 cm")
    given = {"pose": np.array([1.0, 2.0, np.pi / 2]), "v_left": 0.5, "v_right": 0.5, "track": 0.3, "dt": 0.1}
    usual = [
        (np.array([1.0, 2.1, np.pi / 2]), SUM),
        (np.array([1.0, 2.5, np.pi / 2]), NO_DT),
        (np.array([1.05, 2.0, np.pi / 2]), AXES),
    ]
    expect(claim, mine, given, np.array([1.0, 2.05, np.pi / 2]), usual, 1e-4)


def a_faster_right_wheel_turns_left(mine):
    claim = Text(
        "0.65 and 0.95 m/s, track 0.3 m: v 0.8 m/s, omega 1 rad/s",
        "0.65 与 0.95 m/s，轮距 0.3 m：v 0.8 m/s，omega 1 rad/s",
    )
    given = {"pose": np.zeros(3), "v_left": 0.65, "v_right": 0.95, "track": 0.3, "dt": 0.1}

    def moved(turn, along):
        return np.array([0.08 * np.cos(along), 0.08 * np.sin(along), turn])

    usual = [
        (moved(-0.1, -0.05), SWAPPED),
        (moved(0.2, 0.1), TRACK),
        (moved(0.03, 0.015), TRACK),
        (moved(0.1, 0.0), EULER),
        (moved(0.1, 0.1), EULER),
    ]
    expect(claim, mine, given, moved(0.1, 0.05), usual, 1e-4)


def it_turns_in_place(mine):
    claim = Text("opposite wheels turn in place", "两轮反向则原地转")
    given = {"pose": np.array([0.3, -0.2, 0.4]), "v_left": -0.15, "v_right": 0.15, "track": 0.3, "dt": 0.2}
    expect(claim, mine, given, np.array([0.3, -0.2, 0.6]), [(np.array([0.3, -0.2, 0.2]), SWAPPED)], 1e-4)


# pid(target, measured, integral, last_error, dt)

FORWARD = Text("the target itself comes first (feed-forward)", "先有目标值本身（前馈）")
ERROR_SIGN = Text("error = target - measured", "误差 = 目标值 - 测量值")
UNSUMMED = Text("add error x dt to the integral before you use it", "先把 误差 x dt 加进积分，再使用")
WINDUP = Text("clip the integral to +-0.2, else it winds up", "把积分限制在 +-0.2 内，否则会积分饱和")
SLOPE = Text("the slope is (error - last_error) / dt", "斜率是（误差 - 上次误差）/ dt")
KEEP = Text("give the new integral and this error back, for the next call", "返回新的积分和这次的误差，供下次使用")


def each_gain_does_its_part(mine):
    claim = Text(
        "(asked, integral, error) from target 0.5, measured 0.4", "目标 0.5、测量 0.4 时的（输出、积分、误差）"
    )
    given = {"target": 0.5, "measured": 0.4, "integral": 0.05, "last_error": 0.08, "dt": 0.02}
    right = (0.5 + 1.2 * 0.1 + 4.0 * 0.052 + 0.01 * 1.0, 0.052, 0.1)
    usual = [
        ((right[0] - 0.5, 0.052, 0.1), FORWARD),
        ((0.5 - 1.2 * 0.1 + 4.0 * 0.048 + 0.01 * -9.0, 0.048, -0.1), ERROR_SIGN),
        ((0.5 + 1.2 * 0.1 + 4.0 * 0.05 + 0.01, 0.052, 0.1), UNSUMMED),
        ((0.5 + 1.2 * 0.1 + 4.0 * 0.15 + 0.01, 0.15, 0.1), NO_DT),
        ((0.5 + 1.2 * 0.1 + 4.0 * 0.052 + 0.01 * 0.02, 0.052, 0.1), SLOPE),
        ((0.5 + 1.2 * 0.1 + 4.0 * 0.052 - 0.01, 0.052, 0.1), SLOPE),
        ((right[0], 0.05, 0.08), KEEP),
    ]
    expect(claim, mine, given, right, usual)


def the_integral_is_bounded(mine):
    claim = Text("the integral stays within +-0.2 m", "积分保持在 +-0.2 m 内")
    given = {"target": 0.8, "measured": 0.0, "integral": 0.199, "last_error": 0.8, "dt": 0.02}
    loose = (0.8 + 0.96 + 4.0 * 0.215, 0.215, 0.8)
    used_before = (0.8 + 0.96 + 4.0 * 0.215, 0.2, 0.8)
    expect(claim, mine, given, (0.8 + 0.96 + 0.8, 0.2, 0.8), [(loose, WINDUP), (used_before, WINDUP)])
    given = {"target": -0.8, "measured": 0.0, "integral": -0.199, "last_error": -0.8, "dt": 0.02}
    expect(claim, mine, given, (-0.8 - 0.96 - 0.8, -0.2, -0.8), [((-0.8 - 0.96 - 4 * 0.215, -0.215, -0.8), WINDUP)])


# power(v, omega, acceleration)

IDLE = Text("5 W are drawn even when it stands", "静止时也消耗 5 W")
BACKWARDS = Text("|v| and |omega|: driving backwards costs as much", "用 |v| 和 |omega|：倒车同样耗电")
BRAKING = Text("braking gives nothing back: max(0, v a)", "刹车不回收能量：max(0, v a)")
MASS = Text("accelerating costs 15 kg x v x a", "加速所需功率为 15 kg x v x a")
SQUARE = Text("20 times v squared", "是 20 乘 v 的平方")


def standing_costs_too(mine):
    claim = Text("standing still draws 5 W", "静止消耗 5 W")
    expect(claim, mine, {"v": 0.0, "omega": 0.0, "acceleration": 0.0}, 5.0, [(0.0, IDLE)])


def full_speed_draws_24_watts(mine):
    claim = Text("0.8 m/s straight on: 5 + 6.4 + 12.8 W", "直行 0.8 m/s：5 + 6.4 + 12.8 W")
    usual = [(19.2, IDLE), (27.4, SQUARE), (11.4, SQUARE)]
    expect(claim, mine, {"v": 0.8, "omega": 0.0, "acceleration": 0.0}, 24.2, usual)


def turning_and_backing_cost(mine):
    claim = Text("backwards and to the right cost as much as forwards and left", "倒车、右转与前进、左转耗电相同")
    given = {"v": -0.5, "omega": -1.0, "acceleration": 0.0}
    usual = [(5 - 4 + 5 - 6 + 4, BACKWARDS), (5 + 4 + 5 - 6 + 4, BACKWARDS), (5 - 4 + 5 + 6 + 4, BACKWARDS)]
    expect(claim, mine, given, 24.0, usual)


def braking_is_free_and_speeding_up_is_not(mine):
    claim = Text("speeding up at 1 m/s2 at 0.5 m/s: 7.5 W more", "0.5 m/s 时以 1 m/s2 加速：多 7.5 W")
    usual = [(14.0, MASS), (29.0, MASS), (14.5, MASS)]
    expect(claim, mine, {"v": 0.5, "omega": 0.0, "acceleration": 1.0}, 21.5, usual)
    claim = Text("braking gives nothing back", "刹车不回收能量")
    usual = [(6.5, BRAKING), (21.5, BRAKING)]
    expect(claim, mine, {"v": 0.5, "omega": 0.0, "acceleration": -1.0}, 14.0, usual)


def many_speeds_at_once(mine):
    claim = Text("an array of speeds gives an array of watts", "传入速度数组，返回功率数组")
    given = {"v": np.array([0.0, 0.5]), "omega": 0.0, "acceleration": np.array([0.0, 1.0])}
    got = np.asarray(call(claim, mine, given))
    hold(claim, got.shape == (2,) and bool(np.allclose(got, [5.0, 21.5])), given, np.array([5.0, 21.5]), got)


def _free_wheels(v_left, v_right, track):
    """Wheel state and parameters of `kernels.drive` without limits and lag, so that one part of it is seen alone."""
    p = drive_parameters(Config())
    p[[kernel.MAX_V, kernel.MAX_OMEGA, kernel.MAX_ACC, kernel.MAX_ANG_ACC]] = 1e9
    p[kernel.TRACK], p[kernel.LAG] = track, 0.0
    wheels = np.zeros((1, kernel.WHEEL_STATE))
    wheels[0, [kernel.LEFT, kernel.RIGHT]] = v_left, v_right
    return wheels, p


def _step_pose(pose, v_left, v_right, track, dt):
    wheels, p = _free_wheels(v_left, v_right, track)
    p[[kernel.KP, kernel.KI, kernel.KD]] = 0.0
    command = np.array([[0.5 * (v_left + v_right), (v_right - v_left) / track]])
    moved, joules, square = np.zeros((1, 3)), np.zeros(1), np.zeros(1)
    kernel.drive(wheels, np.array([pose[2]], float), command, p, dt, 1, moved, joules, square)
    return pose + moved[0]


def _pid(target, measured, integral, last_error, dt):
    wheels, p = _free_wheels(measured, measured, 0.3)
    wheels[0, [kernel.INTEGRAL_LEFT, kernel.INTEGRAL_RIGHT]] = integral
    wheels[0, [kernel.ERROR_LEFT, kernel.ERROR_RIGHT]] = last_error
    moved, joules, square = np.zeros((1, 3)), np.zeros(1), np.zeros(1)
    kernel.drive(wheels, np.zeros(1), np.array([[target, 0.0]], float), p, dt, 1, moved, joules, square)
    return tuple(float(wheels[0, k]) for k in (kernel.LEFT, kernel.INTEGRAL_LEFT, kernel.ERROR_LEFT))


def _power(v, omega, acceleration):
    return np.vectorize(lambda *one: kernel.power(*one, drive_parameters(Config())), otypes=[float])(
        v, omega, acceleration
    )


CHECKS = {
    "step_pose": [a_straight_step_is_the_mean_speed, a_faster_right_wheel_turns_left, it_turns_in_place],
    "pid": [each_gain_does_its_part, the_integral_is_bounded],
    "power": [
        standing_costs_too,
        full_speed_draws_24_watts,
        turning_and_backing_cost,
        braking_is_free_and_speeding_up_is_not,
        many_speeds_at_once,
    ],
}
REFERENCES = {"step_pose": _step_pose, "pid": _pid, "power": _power}
