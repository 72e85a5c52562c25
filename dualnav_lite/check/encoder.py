"""Checks of lesson 06: single numbers and single beams, whose rows and columns are worked out by hand."""

import numpy as np

from dualnav_lite import encoder
from dualnav_lite.check.verdict import SHAPE, Text, call, expect, hold, is_close, plain
from dualnav_lite.encoder import BAND_EDGES, BANDS, Ego
from dualnav_lite.motion import STEPS, Prediction

MIDDLES = (BAND_EDGES[1:] + BAND_EDGES[:-1]) // 2
BEAMS = 1080


def an_ego(**changes) -> Ego:
    """A robot that turns right at half speed; the goal is 5 m away, ahead and to the left."""
    values = {
        "twist": np.array([0.4, -0.6]),
        "battery": 0.7,
        "goal_robot": np.array([3.0, 4.0]),
        "guide_robot": np.array([0.0, -2.0]),
        "map_age_s": 1.0,
        "preference": 0.25,
    }
    return Ego(**(values | changes))


WANTED = dict(zip(BANDS, (0.5, -0.5, 0.7, 5.0 / 7.0, 0.8, 0.6, -1.0, 0.0, 0.5, 0.25), strict=True))

# paint_bands(ego)

RAW = Text("divide by the scale: 0.8 m/s and 1.2 rad/s read 1", "要除以尺度：0.8 m/s 和 1.2 rad/s 读作 1")
SATURATES = Text("d / (d + 2): fine near the goal and never 1", "d / (d + 2)：近处精细，永远不到 1")
SWAPPED = Text(
    "the sine belongs to the left, y over d; the cosine to ahead, x over d", "正弦对应左方 y / d，余弦对应前方 x / d"
)
AGE = Text("an age of 2 s reads 1", "地图已过时间 2 s 读作 1")
ONE_NUMBER = Text("ten numbers in ten bands, not one number everywhere", "十个数放进十个条带，不是到处同一个数")
USUAL_BANDS = {
    "v": [(0.4, RAW), (0.7, ONE_NUMBER)],
    "omega": [(-0.6, RAW), (0.7, ONE_NUMBER)],
    "goal_distance": [(5.0, SATURATES), (0.5, SATURATES), (1.0, SATURATES), (2.0 / 7.0, SATURATES)],
    "goal_sin": [(0.6, SWAPPED)],
    "goal_cos": [(0.8, SWAPPED)],
    "guide_sin": [(0.0, SWAPPED)],
    "guide_cos": [(-1.0, SWAPPED)],
    "map_age": [(1.0, AGE)],
}


def _band(mine, row):
    """The student's image, reduced to the first number of a row."""

    def chosen(ego):
        image = mine(ego)
        return image[row, 0] if np.shape(image) == (64, 64) else image

    return chosen


def each_band_holds_its_number(mine):
    for name, row in zip(BANDS, MIDDLES, strict=True):
        claim = Text(f"band '{name}', row {row}", f"条带 '{name}'，第 {row} 行")
        expect(claim, _band(mine, row), {"ego": an_ego()}, WANTED[name], USUAL_BANDS.get(name, ()), 1e-5)


def bands_fill_their_rows(mine):
    claim = Text(
        "the image is (64, 64), and each band one number from edge to edge", "图像为 (64, 64)，每个条带整条是同一个数"
    )
    image = np.asarray(call(claim, mine, {"ego": an_ego()}))
    hold(claim, image.shape == (64, 64), "", "(64, 64)", str(image.shape), SHAPE)
    right = np.repeat(list(WANTED.values()), np.diff(BAND_EDGES))[:, None] * np.ones(64)
    wrong = np.argwhere(~np.isclose(image, right, atol=1e-5))
    place = Text("rows BAND_EDGES[k] to BAND_EDGES[k + 1]", "从第 BAND_EDGES[k] 行到第 BAND_EDGES[k + 1] 行")
    where = str(tuple(wrong[0].tolist())) if len(wrong) else ""
    hold(claim, not len(wrong), Text(f"cell {where}", f"格 {where}"), right[tuple(wrong[0])] if len(wrong) else "",
         image[tuple(wrong[0])] if len(wrong) else "", place)  # fmt: skip


def bands_stay_in_their_range(mine):
    clip = Text("clip to [-1, 1]: a band never leaves its range", "截断到 [-1, 1]：条带不能超出范围")
    claim = Text("1.6 m/s reads 1, no more", "1.6 m/s 也只读作 1")
    given = {"ego": an_ego(twist=np.array([1.6, -2.4]))}
    expect(claim, _band(mine, MIDDLES[0]), given, 1.0, [(2.0, clip)], 1e-5)
    claim = Text("-2.4 rad/s reads -1, no less", "-2.4 rad/s 也只读作 -1")
    expect(claim, _band(mine, MIDDLES[1]), given, -1.0, [(-2.0, clip)], 1e-5)
    claim = Text("a map 9 s old reads 1, no more", "地图已过时间 9 s 也只读作 1")
    expect(claim, _band(mine, MIDDLES[8]), {"ego": an_ego(map_age_s=9.0)}, 1.0, [(4.5, clip)], 1e-5)
    claim = Text(
        "a goal and a guide point at the robot's own place are straight ahead: sine 0, cosine 1",
        "目标和引导点就在机器人处时视为正前方：正弦为 0，余弦为 1",
    )
    zero = Text("0 / 0: look at the distance first", "0 / 0：先判断距离")
    with np.errstate(all="ignore"):
        here = an_ego(goal_robot=np.zeros(2), guide_robot=np.zeros(2))
        image = np.asarray(plain(call(claim, mine, {"ego": here})), float)
    got = image[MIDDLES[3:8], 0]
    right = np.array([0.0, 0.0, 1.0, 0.0, 1.0])
    hold(claim, is_close(got, right, 1e-5), "goal_robot = guide_robot = [0, 0]", right, got, zero)


# project_intensity(scan)


def a_scan(*beams) -> np.ndarray:
    """(1080, 2) scan without a return, but for (bearing [degrees], range [m], intensity)."""
    scan = np.zeros((BEAMS, 2), np.float32)
    scan[:, 0] = 10.0
    for bearing, distance, intensity in beams:
        scan[round((bearing + 180.0) * BEAMS / 360.0)] = distance, intensity
    return scan


def an_image(*cells) -> np.ndarray:
    """(64, 64) of zeros, but for (row, column, value)."""
    image = np.zeros((64, 64))
    for row, column, value in cells:
        image[row, column] = value
    return image


TURNED = Text("heading up: ahead is a small row, left a small column", "朝向向上：前方行号小，左方列号小")
ANGLES = Text("beam 0 points backwards: bearing -pi + 2 pi k / beams", "第 0 束指向后方：方位角 -pi + 2 pi k / beams")
STRONGEST = Text("keep the strongest beam of a cell (`np.maximum.at`)", "每格保留最强的一束（`np.maximum.at`）")
WRAPPED = Text(
    "a negative index wraps round: leave out what lies beyond the image", "负下标会绕到另一侧：图像以外的要去掉"
)
TRUNCATED = Text("round down with `np.floor`: `int` makes 0 of -0.5", "用 `np.floor` 向下取整：`int` 会把 -0.5 变成 0")


def _image_of(claim, mine, scan, right, usual=()):
    expect(claim, mine, {"scan": scan}, right, usual, 1e-5)


def a_beam_ahead_ends_above_the_middle(mine):
    claim = Text(
        "one beam, 1 degree to the left, 1.05 m: row 21, column 31", "一束光，偏左 1 度，1.05 m：第 21 行第 31 列"
    )
    usual = [
        (an_image((42, 32, 0.5)), ANGLES),
        (an_image((42, 31, 0.5)), TURNED),
        (an_image((21, 32, 0.5)), TURNED),
        (an_image((31, 21, 0.5)), TURNED),
        (an_image((31, 42, 0.5)), TURNED),
        (an_image((32, 42, 0.5)), TURNED),
    ]
    _image_of(claim, mine, a_scan((1.0, 1.05, 0.5)), an_image((21, 31, 0.5)), usual)
    claim = Text(
        "one beam, 91 degrees to the left, 2.05 m: row 32, column 11", "一束光，偏左 91 度，2.05 m：第 32 行第 11 列"
    )
    _image_of(claim, mine, a_scan((91.0, 2.05, 0.5)), an_image((32, 11, 0.5)), [(an_image((32, 52, 0.5)), TURNED)])


def the_strongest_beam_of_a_cell_counts(mine):
    claim = Text("three beams in one cell: 0.2, 0.9, 0.4", "同一格内三束：0.2、0.9、0.4")
    scan = a_scan((1.0, 1.05, 0.2), (2.0, 1.05, 0.9), (3.0, 1.05, 0.4))
    usual = [(an_image((21, 31, value)), STRONGEST) for value in (0.4, 0.2, 0.5, 1.5)]
    _image_of(claim, mine, scan, an_image((21, 31, 0.9)), usual)


def what_lies_beyond_leaves_no_trace(mine):
    claim = Text("beams of 5 m to all sides end outside the image", "四周 5 m 的光束都落在图像之外")
    scan = a_scan(*((bearing, 5.0, 0.8) for bearing in (1.0, 91.0, -89.0, -179.0)))
    got = np.asarray(call(claim, mine, {"scan": scan}), float)
    hold(claim, got.shape == (64, 64), "", "(64, 64)", str(got.shape), SHAPE)
    hold(claim, not got.any(), "5 m", "0", got, WRAPPED)
    claim = Text("beams that end 5 cm beyond the image leave no trace either", "落在图像之外 5 cm 处的光束也不留痕迹")
    got = np.asarray(call(claim, mine, {"scan": a_scan((1.0, 3.25, 0.8), (91.0, 3.25, 0.8))}), float)
    hold(claim, not got.any(), "3.25 m", "0", got, TRUNCATED)


# encode_state(scans, poses, map_crop, ego)


def a_state() -> dict:
    """Three scans that differ, three poses, a map and an ego with a forecast of one mover that stands 1 m ahead."""
    scans = np.stack([a_scan((1.0, 1.05 + 0.5 * k, 0.3 + 0.2 * k)) for k in range(3)])
    rng = np.random.default_rng(6)
    forecast = Prediction(np.tile([1.0, 0.0], (1, STEPS, 1)), np.zeros((1, 2)), np.ones(1, bool), np.full(1, 0.3))
    crop = rng.choice([0.0, 1 / 6, 2 / 3, 1.0], size=(64, 64)).astype(np.float32)
    return {"scans": scans, "poses": np.zeros((3, 3)), "map_crop": crop, "ego": an_ego(forecast=forecast)}


ORDER = Text("the order is static, motion, ego, intensity", "顺序是 static、motion、ego、intensity")
NEWEST = Text("the newest scan is the last one, `scans[-1]`", "最新的扫描是最后一个，`scans[-1]`")
BATCH = Text("no batch axis: the caller adds it", "不要加批维度：由调用者添加")


def the_image_has_four_channels(mine):
    claim = Text("(4, 64, 64), finite, inside [-1, 1]", "(4, 64, 64)，有限，且在 [-1, 1] 内")
    got = np.asarray(plain(call(claim, mine, a_state())), float)
    hint = BATCH if got.ndim == 4 else SHAPE
    hold(claim, got.shape == (4, 64, 64), "", "(4, 64, 64)", str(got.shape), hint)
    hold(claim, bool(np.isfinite(got).all() and np.abs(got).max() <= 1.0), "", "", got)


def channels_stand_in_their_order(mine):
    state = a_state()
    claim = Text("channel 0 is the map crop", "通道 0 是局部地图")
    got = np.asarray(plain(call(claim, mine, state)), float)
    others = [k for k in range(1, 4) if is_close(got[k], state["map_crop"])]
    hold(claim, is_close(got[0], state["map_crop"]), "", state["map_crop"], got[0], ORDER if others else None)
    claim = Text("channel 2 holds the bands", "通道 2 是十个条带")
    bands = np.array(list(WANTED.values()))
    hold(claim, is_close(got[2][MIDDLES, 0], bands, 1e-5), "", bands, got[2][MIDDLES, 0], ORDER)
    claim = Text("channel 3 shows the newest scan's intensity", "通道 3 是最新扫描的反射强度")
    right = an_image((11, 31, 0.7))
    oldest = is_close(got[3], an_image((21, 31, 0.3)), 1e-5)
    wanted = Text("row 11, column 31: 0.7", "第 11 行第 31 列：0.7")
    hold(claim, is_close(got[3], right, 1e-5), "", wanted, got[3], NEWEST if oldest else ORDER)
    claim = Text("channel 1 shows the mover 1 m ahead", "通道 1 显示前方 1 m 的移动物体")
    near = got[1][18:26, 28:36]
    rows = Text("rows 18 to 25", "第 18 至 25 行")
    hint = Text("use `motion_channel`", "请使用 `motion_channel`")
    hold(claim, bool(near.any()) and not got[1][44:].any(), "", rows, near, hint)


def numbers_are_float32(mine):
    claim = Text("the image is float32, as the networks are", "图像为 float32，与网络一致")
    kind = np.asarray(plain(call(claim, mine, a_state()))).dtype
    hint = Text(
        "end with `.astype(np.float32)`: what NumPy computes is float64",
        "最后加上 `.astype(np.float32)`：NumPy 的计算结果是 float64",
    )
    hold(claim, kind == np.float32, "", "float32", str(kind), hint)


CHECKS = {
    "paint_bands": [each_band_holds_its_number, bands_fill_their_rows, bands_stay_in_their_range],
    "project_intensity": [
        a_beam_ahead_ends_above_the_middle,
        the_strongest_beam_of_a_cell_counts,
        what_lies_beyond_leaves_no_trace,
    ],
    "encode_state": [the_image_has_four_channels, channels_stand_in_their_order, numbers_are_float32],
}


def _bands_of(ego):
    state = a_state() | {"ego": ego}
    ego.forecast = a_state()["ego"].forecast
    return encoder.encode_state(*state.values())[encoder.EGO]


REFERENCES = {
    "paint_bands": _bands_of,
    "project_intensity": encoder.project_intensity,
    "encode_state": encoder.encode_state,
}
