"""Checks of lesson 04: points moved by right angles and whole metres, flows whose components are known."""

import numpy as np

from dualnav_lite import motion
from dualnav_lite.check.verdict import Text, expect
from dualnav_lite.geometry import to_robot, to_world

# compensate(points, pose_then, pose_now)

STILL_THERE = Text("who drives 1 m ahead has everything 1 m nearer", "前进 1 m 后，一切都近 1 m")
WRONG_TURN = Text("turning left moves the world to the right", "向左转时，世界向右移")
TURN_FIRST = Text("turn by the old heading before you add the old place", "先按旧朝向旋转，再加旧位置")
WORLD = Text(
    "the result is in the robot's frame of now, not in the world", "结果应在机器人当前的坐标系中，而不是世界坐标系"
)
NO_SHIFT = Text("the robot has moved, not only turned", "机器人不只转了，还移动了")
NO_TURN = Text("the robot has turned, not only moved", "机器人不只移动了，还转了")
POINTS = np.array([[3.0, 0.0], [2.0, 1.0], [0.0, -1.5]])


def _moved(then, now):
    """The same by matrices of homogeneous coordinates."""

    def frame(pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])

    points = np.column_stack([POINTS, np.ones(3)]).T
    return (np.linalg.inv(frame(now)) @ frame(then) @ points)[:2].T


def driving_ahead_brings_it_nearer(mine):
    claim = Text("after 1 m straight on a point at (3, 0) is at (2, 0)", "直行 1 m 后，(3, 0) 处的点到了 (2, 0)")
    given = {"points": POINTS, "pose_then": np.array([5.0, 1.0, 0.0]), "pose_now": np.array([6.0, 1.0, 0.0])}
    usual = [(np.add(POINTS, [1.0, 0.0]), STILL_THERE), (POINTS, NO_SHIFT), (np.add(POINTS, [5.0, 1.0]), WORLD)]
    expect(claim, mine, given, POINTS - [1.0, 0.0], usual)


def turning_left_brings_it_right(mine):
    claim = Text(
        "after a quarter turn to the left what was ahead is on the right", "左转 90 度后，原来在前方的到了右边"
    )
    then, now = np.array([1.0, -2.0, 0.0]), np.array([1.0, -2.0, np.pi / 2])
    x, y = POINTS.T
    usual = [(np.column_stack([-y, x]), WRONG_TURN), (POINTS, NO_TURN), (POINTS + then[:2], WORLD)]
    expect(claim, mine, {"points": POINTS, "pose_then": then, "pose_now": now}, np.column_stack([y, -x]), usual)


def both_at_once(mine):
    claim = Text("a curve: moved and turned, from a heading that is not 0", "曲线：又移动又转向，起始朝向不为 0")
    then, now = np.array([1.0, 2.0, 0.5]), np.array([1.3, 2.1, 0.9])
    difference = now - then
    c, s = np.cos(difference[2]), np.sin(difference[2])
    shifted = POINTS - difference[:2]
    naive = np.column_stack([c * shifted[:, 0] + s * shifted[:, 1], c * shifted[:, 1] - s * shifted[:, 0]])
    world = POINTS + then[:2] - now[:2]
    c, s = np.cos(now[2]), np.sin(now[2])
    late = np.column_stack([c * world[:, 0] + s * world[:, 1], c * world[:, 1] - s * world[:, 0]])
    given = {"points": POINTS, "pose_then": then, "pose_now": now}
    usual = [(naive, TURN_FIRST), (late, TURN_FIRST), (_moved(now, then), STILL_THERE)]
    expect(claim, mine, given, _moved(then, now), usual)


# flow_component(flow, component)

RIGHT = Text("`x` is positive to the right; flow[..., 1] is to the left", "`x` 向右为正；flow[..., 1] 向左")
OTHER = Text("`x` runs along the columns: it is the sideways part", "`x` 沿列方向：是横向分量")
SCALE = Text("1.5 m/s reads 1", "1.5 m/s 的读数为 1")
CLIP = Text("clip to [-1, 1]", "截断到 [-1, 1]")
LENGTH = Text("speed is the length: the root of the sum of squares", "speed 是长度：平方和的平方根")
TOWARDS = Text("`radial` is positive towards the robot", "`radial` 朝向机器人为正")
MIDDLES = Text(
    "a cell's middle is at 0.1 (31.5 - row) ahead and 0.1 (31.5 - column) to the left",
    "栅格中心在前方 0.1 (31.5 - 行) m、左方 0.1 (31.5 - 列) m",
)
AHEAD = Text(
    "`radial` needs both parts: project on the direction to the cell", "`radial` 两个分量都要：投影到指向栅格的方向"
)


def _constant(ahead, left):
    return np.tile(np.array([ahead, left]), (64, 64, 1))


def _outward(middle=31.5):
    offset = 0.1 * (middle - np.arange(64))
    ahead, left = np.meshgrid(offset, offset, indexing="ij")
    return np.stack([ahead, left], axis=-1) / np.maximum(np.hypot(ahead, left), 1e-9)[..., None]


def _full(value):
    return np.full((64, 64), value)


def x_is_to_the_right(mine):
    claim = Text("`x` of 0.3 m/s ahead, 0.6 m/s to the left", "前向 0.3 m/s、向左 0.6 m/s 的 `x`")
    usual = [(_full(0.4), RIGHT), (_full(0.2), OTHER), (_full(-0.2), OTHER), (_full(-0.6), SCALE)]
    expect(claim, mine, {"flow": _constant(0.3, 0.6), "component": "x"}, _full(-0.4), usual)


def speed_is_the_length(mine):
    claim = Text(
        "`speed` of 0.45 m/s back, 0.6 m/s to the right is 0.5", "后退 0.45 m/s、向右 0.6 m/s 的 `speed` 为 0.5"
    )
    given = {"flow": _constant(-0.45, -0.6), "component": "speed"}
    usual = [(_full(0.7), LENGTH), (_full(-0.7), LENGTH), (_full(0.375), LENGTH), (_full(0.75), SCALE)]
    expect(claim, mine, given, _full(0.5), usual)


def radial_is_positive_towards_the_robot(mine):
    claim = Text(
        "0.75 m/s straight at the robot, everywhere: `radial` 0.5", "到处都以 0.75 m/s 朝向机器人：`radial` 为 0.5"
    )
    outward = _outward()
    flow = -0.75 * outward
    shifted = np.clip(0.5 * (outward * _outward(32.0)).sum(axis=-1), -1, 1)
    usual = [
        (_full(-0.5), TOWARDS),
        (_full(0.75), SCALE),
        (shifted, MIDDLES),
        (0.5 * outward[..., 0], AHEAD),
        (-0.5 * outward[..., 0], AHEAD),
        (0.5 * (outward * outward[:, ::-1]).sum(axis=-1), MIDDLES),
    ]
    expect(claim, mine, {"flow": flow, "component": "radial"}, _full(0.5), usual, 1e-5)


def radial_does_not_see_a_circle(mine):
    claim = Text("who walks round the robot has `radial` 0", "绕着机器人走的人 `radial` 为 0")
    outward = _outward()
    round_ = np.stack([-outward[..., 1], outward[..., 0]], axis=-1)
    expect(claim, mine, {"flow": round_, "component": "radial"}, _full(0.0), [], 1e-5)


def nothing_leaves_the_range(mine):
    claim = Text("6 m/s reads 1, not 4", "6 m/s 的读数为 1，而不是 4")
    for component, right in (("x", -1.0), ("speed", 1.0)):
        given = {"flow": _constant(0.0, 6.0), "component": component}
        expect(claim, mine, given, _full(right), [(_full(4.0 * right), CLIP)])


def _compensate(points, pose_then, pose_now):
    return to_robot(to_world(points, pose_then), pose_now)


CHECKS = {
    "compensate": [driving_ahead_brings_it_nearer, turning_left_brings_it_right, both_at_once],
    "flow_component": [
        x_is_to_the_right,
        speed_is_the_length,
        radial_is_positive_towards_the_robot,
        radial_does_not_see_a_circle,
        nothing_leaves_the_range,
    ],
}
REFERENCES = {"compensate": _compensate, "flow_component": motion.flow_component}
