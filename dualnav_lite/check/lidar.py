"""Checks of lesson 02: rays worked out by right angles, noise by the formula written out."""

import numpy as np

from dualnav_lite.check.verdict import Text, call, expect, hold
from dualnav_lite.kernels.lidar import cast_scan_reference
from dualnav_lite.kernels.scan_noise import noise_levels

# cast_scan(pose, bearings, segments, range_max)

HEADING = Text("a beam points at heading + bearing in the world", "光束在世界中的方向是 朝向 + 方位角")
ORIGIN = Text("count from where the robot is: a - p", "要从机器人的位置量起：a - p")
BEHIND = Text("t must be positive: a wall behind is not met", "t 必须为正：身后的墙碰不到")
ENDLESS = Text("a wall ends: u must lie in [0, 1]", "墙有两端：u 必须在 [0, 1] 内")
NEAREST = Text("of all walls the nearest counts", "所有墙中取最近的")
CAPPED = Text("nothing within range reads range_max", "量程内没有东西时读数为 range_max")
UNITS = Text("bearings are in radians", "方位角的单位是弧度")
PRODUCT = Text(
    "nothing is met: look at the order of the cross products, t = (a - p) x e over d x e",
    "什么都没碰到：检查叉积的次序，t = (a - p) x e 除以 d x e",
)
WALL = np.array([[3.0, -5.0, 3.0, 5.0]])


def a_wall_ahead_is_met(mine):
    claim = Text(
        "a wall 3 m ahead: 3 m straight on, 3 sqrt(2) m at 45 degrees",
        "前方 3 m 处有墙：正前 3 m，45 度方向 3 sqrt(2) m",
    )
    given = {"pose": np.zeros(3), "bearings": np.array([0.0, np.pi / 4]), "segments": WALL, "range_max": 10.0}
    usual = [(np.array([10.0, 10.0]), PRODUCT)]
    usual += [(3.0 / np.cos([0.0, turned(np.pi / 4)]), UNITS) for turned in (np.radians, np.degrees)]
    expect(claim, mine, given, np.array([3.0, 3.0 * np.sqrt(2)]), usual)


def beams_turn_with_the_robot(mine):
    claim = Text(
        "at (1, 0), heading 0.5, the beam at -0.5 meets the wall at x = 3",
        "在 (1, 0)、朝向 0.5 时，-0.5 的光束碰到 x = 3 的墙",
    )
    given = {"pose": np.array([1.0, 0.0, 0.5]), "bearings": np.array([-0.5]), "segments": WALL, "range_max": 10.0}
    skewed = 2.0 / np.cos(0.5)
    usual = [(np.array([skewed]), HEADING), (np.array([2.0 / np.cos(1.0)]), HEADING), (np.array([3.0]), ORIGIN)]
    expect(claim, mine, given, np.array([2.0]), usual)


def what_is_behind_is_not_met(mine):
    claim = Text("a wall 3 m behind is not met", "身后 3 m 的墙碰不到")
    given = {"pose": np.array([0.0, 0.0, np.pi]), "bearings": np.array([0.0]), "segments": WALL, "range_max": 10.0}
    expect(claim, mine, given, np.array([10.0]), [(np.array([-3.0]), BEHIND), (np.array([3.0]), BEHIND)])


def a_wall_has_two_ends(mine):
    claim = Text("a beam that passes beside a wall goes on", "从墙旁边经过的光束继续前进")
    short = np.array([[3.0, 1.0, 3.0, 2.0]])
    for segments in (short, short[:, [2, 3, 0, 1]]):
        given = {"pose": np.zeros(3), "bearings": np.array([0.0, 0.9]), "segments": segments, "range_max": 10.0}
        usual = [(np.array([3.0, 3.0 / np.cos(0.9)]), ENDLESS), (np.array([3.0, 10.0]), ENDLESS)]
        usual.append((np.array([10.0, 3.0 / np.cos(0.9)]), ENDLESS))
        expect(claim, mine, given, np.array([10.0, 10.0]), usual)


def the_nearest_wall_wins(mine):
    claim = Text("of walls at 4, 2 and 3 m the one at 2 m is met", "4、2、3 m 处的墙，碰到的是 2 m 处的")
    walls = np.array([[4.0, -1.0, 4.0, 1.0], [2.0, 1.0, 2.0, -1.0], [3.0, -1.0, 3.0, 1.0]])
    given = {"pose": np.zeros(3), "bearings": np.array([0.0]), "segments": walls, "range_max": 10.0}
    expect(claim, mine, given, np.array([2.0]), [(np.array([one]), NEAREST) for one in (3.0, 4.0)])


def far_walls_read_range_max(mine):
    claim = Text("a wall at 3 m reads 2.5 m where that is the longest range", "量程 2.5 m 时，3 m 处的墙读数为 2.5 m")
    given = {"pose": np.zeros(3), "bearings": np.array([0.0, 2.0]), "segments": WALL, "range_max": 2.5}
    usual = [(np.array([3.0, 2.5]), CAPPED), (np.array([3.0, np.inf]), CAPPED), (np.array([2.5, np.inf]), CAPPED)]
    expect(claim, mine, given, np.array([2.5, 2.5]), usual)


def beams_along_a_wall_are_numbers(mine):
    claim = Text("a beam parallel to a wall beside it meets nothing", "与旁边的墙平行的光束碰不到东西")
    beside, forward = np.array([[1.0, 0.0, 4.0, 0.0]]), np.zeros(1)
    given = {"pose": np.array([0.0, 1.0, 0.0]), "bearings": forward, "segments": beside, "range_max": 10.0}
    got = np.asarray(call(claim, mine, given))
    divided = Text("the determinant is 0 here: decide before you divide", "这里行列式为 0：先判断再相除")
    hold(claim, got.shape == (1,) and bool(got[0] == 10.0), given, np.array([10.0]), got, divided)


# scan_noise(ranges, intensities, ambient_lux, normal, uniform)

BRIGHT = Text("in bright light q is 0, never less: clip q to [0, 1]", "光线充足时 q 为 0，不会更小：把 q 截断到 [0, 1]")
NATURAL = Text(
    "both logarithms to base 10 and divided: 1 - log10(lux) / log10(300)", "两个对数相除：1 - log10(lux) / log10(300)"
)
LOST_RANGE = Text("a lost beam reads 10 m: nobody knows how far it went", "丢失的光束读数为 10 m：没人知道它走了多远")
LOST_BRIGHT = Text("a lost beam has intensity 0", "丢失的光束反射强度为 0")
LOST_TURNED = Text("a beam is lost where uniform < share", "uniform < 比例 时光束丢失")
DIM = Text("intensities shrink by 1 - 0.557 q", "反射强度要乘 1 - 0.557 q")
SIGMA = Text("sigma = 0.01 + 0.042 q metres, times normal", "sigma = 0.01 + 0.042 q 米，乘以 normal")
LIMITS = Text("a reading stays in [0.05, 10] m", "读数保持在 [0.05, 10] m")


def _noisy(sigma, lost, scale, ranges, intensities, normal, uniform):
    readings = np.clip(ranges + sigma * normal, 0.05, 10.0)
    gone = uniform < lost
    return np.stack([np.where(gone, 10.0, readings), np.where(gone, 0.0, scale * intensities)], axis=1)


def _a_scan(lux):
    return {
        "ranges": np.array([2.0, 4.0, 6.0, 3.0]),
        "intensities": np.array([0.5, 0.4, 0.3, 0.2]),
        "ambient_lux": lux,
        "normal": np.array([1.0, -1.0, 2.0, 0.5]),
        "uniform": np.array([0.5, 0.003, 0.9, 0.1]),
    }


def an_office_is_nearly_clean(mine):
    claim = Text(
        "at 300 lux and above: sigma 1 cm, half a percent lost, full brightness",
        "300 lux 及以上：sigma 1 cm，丢失 0.5 %，反射强度不变",
    )
    for lux in (300.0, 3000.0):
        given = _a_scan(lux)
        rest = {name: given[name] for name in ("ranges", "intensities", "normal", "uniform")}
        right = _noisy(0.01, 0.005, 1.0, **rest)
        kept_range, kept_light = right.copy(), right.copy()
        kept_range[1, 0], kept_light[1, 1] = 3.99, 0.4
        turned = _noisy(0.01, 0.005, 1.0, **(rest | {"uniform": 0.01 - rest["uniform"]}))
        zero = right.copy()
        zero[1, 0] = 0.0
        q = 1.0 - np.log10(lux) / np.log10(300.0)
        below = _noisy(0.01 + 0.042 * q, 0.005 + 0.2 * q, 1.0 - 0.557 * q, **rest)
        usual = [
            (kept_range, LOST_RANGE),
            (zero, LOST_RANGE),
            (kept_light, LOST_BRIGHT),
            (turned, LOST_TURNED),
            (below, BRIGHT),
        ]
        expect(claim, mine, given, right, usual)


def darkness_spoils_three_things(mine):
    claim = Text(
        "sqrt(300) lux is half dark, q = 0.5: sigma 3.1 cm, 10.5 % lost, intensity x 0.7215",
        "sqrt(300) lux 时 q = 0.5：sigma 3.1 cm，丢失 10.5 %，反射强度 x 0.7215",
    )
    given = _a_scan(float(np.sqrt(300.0)))
    rest = {name: given[name] for name in ("ranges", "intensities", "normal", "uniform")}
    linear = 1.0 - np.sqrt(300.0) / 300.0
    usual = [
        (_noisy(0.031, 0.105, 1.0, **rest), DIM),
        (_noisy(0.01, 0.105, 0.7215, **rest), SIGMA),
        (_noisy(3.1, 0.105, 0.7215, **rest), SIGMA),
        (_noisy(0.01 + 0.042 * linear, 0.005 + 0.2 * linear, 1.0 - 0.557 * linear, **rest), NATURAL),
    ]
    expect(claim, mine, given, _noisy(0.031, 0.105, 0.7215, **rest), usual)


def readings_have_limits(mine):
    claim = Text("noise never carries a reading below 0.05 or above 10 m", "噪声不会使读数低于 0.05 m 或高于 10 m")
    given = _a_scan(1.0) | {"ranges": np.array([0.06, 9.99, 5.0, 5.0]), "normal": np.array([-3.0, 3.0, 0.0, 0.0])}
    given["uniform"] = np.full(4, 0.9)
    scale = 1.0 - 0.557
    right = np.stack([[0.05, 10.0, 5.0, 5.0], scale * given["intensities"]], axis=1)
    loose = right.copy()
    loose[:2, 0] = 0.06 - 3 * 0.052, 9.99 + 3 * 0.052
    half = right.copy()
    half[0, 0] = loose[0, 0]
    expect(claim, mine, given, right, [(loose, LIMITS), (half, LIMITS)])


def _cast_scan(pose, bearings, segments, range_max):
    segments = np.asarray(segments, float)
    both = np.concatenate([segments, segments[:, [2, 3, 0, 1]]])  # the kernel meets front faces only
    none = np.zeros((0, 3))
    rays = [(pose[0], pose[1], pose[2] + bearing + np.pi) for bearing in bearings]  # its only beam points backwards
    return np.array([cast_scan_reference(ray, both, np.ones(len(both)), none, [], range_max, 1)[0][0] for ray in rays])


def _scan_noise(ranges, intensities, ambient_lux, normal, uniform):
    sigma, lost, _, scale = noise_levels(ambient_lux)
    return _noisy(sigma, lost, scale, ranges, intensities, normal, uniform)


CHECKS = {
    "cast_scan": [
        a_wall_ahead_is_met,
        beams_turn_with_the_robot,
        what_is_behind_is_not_met,
        a_wall_has_two_ends,
        the_nearest_wall_wins,
        far_walls_read_range_max,
        beams_along_a_wall_are_numbers,
    ],
    "scan_noise": [an_office_is_nearly_clean, darkness_spoils_three_things, readings_have_limits],
}
REFERENCES = {"cast_scan": _cast_scan, "scan_noise": _scan_noise}
