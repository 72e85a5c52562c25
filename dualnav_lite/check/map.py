"""Checks of lesson 03: evidence counted by hand, an image moved by whole cells and right angles."""

import numpy as np

from dualnav_lite.check.verdict import Text, expect
from dualnav_lite.geometry import to_robot, to_world
from dualnav_lite.kernels.grid import mark_hits
from dualnav_lite.mapping import crop_cell_centres
from dualnav_lite.semantics import CELL_VALUE, Cell, Surface

# log_odds(evidence, hits, passes)

ASYMMETRIC = Text("a hit adds 4, a passing beam takes 2", "命中加 4，穿过减 2")
UPPER = Text(
    "clip at 20, else a cell that was once sure can never be cleared", "在 20 处截断，否则已确信被占的栅格再也清不掉"
)
LOWER = Text("clip at -6, else a free cell needs many hits", "在 -6 处截断，否则空闲栅格要命中很多次才会变")
TURNED = Text("a hit speaks for occupied, a pass for free: the signs", "命中说明被占，穿过说明空闲：符号反了")
FORGETS = Text("add to the old evidence, do not replace it", "要加到原有证据上，而不是替换")
BOTH = Text("a cell that is hit and passed gets both: +4 - 2", "同时被命中和穿过的栅格两者都算：+4 - 2")


def _cells(evidence, hits, passes):
    return {"evidence": np.array([evidence]), "hits": np.array([hits], bool), "passes": np.array([passes], bool)}


def hits_add_and_passes_take(mine):
    claim = Text("unseen stays, a hit adds 4, a pass takes 2, both give 2", "未见不变，命中加 4，穿过减 2，两者得 2")
    given = _cells([1, 2, 3, 4], [0, 1, 0, 1], [0, 0, 1, 1])
    right = np.array([[1, 6, 1, 6]])
    usual = [
        (np.array([[1, -2, 5, 2]]), TURNED),
        (np.array([[1, 3, 2, 4]]), ASYMMETRIC),
        (np.array([[1, 6, -1, 4]]), ASYMMETRIC),
        (np.array([[0, 4, -2, 2]]), FORGETS),
        (np.array([[1, 6, 1, 8]]), BOTH),
        (np.array([[1, 6, 1, 2]]), BOTH),
    ]
    expect(claim, mine, given, right, usual)


def evidence_has_bounds(mine):
    claim = Text("evidence stays in [-6, 20]", "证据保持在 [-6, 20] 内")
    given = _cells([19, 20, -5, -6], [1, 1, 0, 0], [0, 0, 1, 1])
    usual = [
        (np.array([[23, 24, -7, -8]]), UPPER),
        (np.array([[23, 24, -6, -6]]), UPPER),
        (np.array([[20, 20, -7, -8]]), LOWER),
    ]
    expect(claim, mine, given, np.array([[20, 20, -6, -6]]), usual)


# cache(image, pose_sent, pose_now)

BACKWARDS = Text(
    "what lay ahead comes nearer, downwards in the image: from new cells to the world, then to the old robot",
    "前方的东西会变近，在图像中下移：先从新图像的栅格换到世界坐标，再换到旧的机器人坐标",
)
TURN = Text("turning left moves the world to the right", "向左转时，世界向右移")
OUTSIDE = Text("what the old image does not show is unknown: 1/6", "旧图像中没有的地方是未知：1/6")
WRAPPED = Text("an index from the other end: look whether it is inside first", "下标绕到另一端去取了：先判断是否在图内")
FRAME = Text(
    "odometry poses are in the world: turn the way into the robot's frame",
    "里程计位姿在世界坐标系：位移要转到机器人坐标系",
)
MIRRORED = Text("columns count from left to right, y counts to the left", "列从左到右数，而 y 向左为正")
UNKNOWN = 1 / 6


def _image():
    return np.random.default_rng(5).random((64, 64))


def _shifted(image, down, right, fill=UNKNOWN):
    out = np.full_like(image, fill)
    out[max(down, 0) : 64 + min(down, 0), max(right, 0) : 64 + min(right, 0)] = image[
        max(-down, 0) : 64 - max(down, 0), max(-right, 0) : 64 - max(right, 0)
    ]
    return out


def who_stands_sees_the_same(mine):
    claim = Text("a robot that stands sees the same image", "机器人不动则图像不变")
    image, pose = _image(), np.array([1.0, 2.0, 0.7])
    usual = [(image[::-1, ::-1], BACKWARDS), (image[:, ::-1], MIRRORED), (image.T, MIRRORED)]
    expect(claim, mine, {"image": image, "pose_sent": pose, "pose_now": pose.copy()}, image, usual)


def driving_ahead_moves_it_down(mine):
    claim = Text("0.5 m straight on: everything moves five rows down", "直行 0.5 m：一切下移五行")
    image = _image()
    for pose_sent, pose_now in (((0, 0, 0), (0.5, 0, 0)), ((1, 2, np.pi / 2), (1, 2.5, np.pi / 2))):
        given = {"image": image, "pose_sent": np.array(pose_sent, float), "pose_now": np.array(pose_now, float)}
        usual = [
            (_shifted(image, -5, 0), BACKWARDS),
            (_shifted(image, 5, 0, 0.0), OUTSIDE),
            (np.roll(image, 5, axis=0), WRAPPED),
            (_shifted(image, 0, -5), FRAME),
            (_shifted(image, 0, 5), FRAME),
        ]
        clamped = np.concatenate([np.repeat(image[:1], 5, axis=0), image[:-5]])
        expect(claim, mine, given, _shifted(image, 5, 0), [*usual, (clamped, OUTSIDE)])


def turning_left_moves_it_right(mine):
    claim = Text("a quarter turn to the left: what was ahead is on the right", "左转 90 度：原来在前方的到了右边")
    image = _image()
    given = {"image": image, "pose_sent": np.array([2.0, 1.0, 0.5]), "pose_now": np.array([2.0, 1.0, 0.5 + np.pi / 2])}
    usual = [(np.rot90(image), TURN), (image, Text("the heading has changed, too", "朝向也变了"))]
    expect(claim, mine, given, np.rot90(image, -1), usual)


def both_at_once(mine):
    claim = Text("0.3 m ahead, then a quarter turn to the left", "直行 0.3 m，再左转 90 度")
    image = _image()
    given = {"image": image, "pose_sent": np.zeros(3), "pose_now": np.array([0.3, 0.0, np.pi / 2])}
    right = np.rot90(_shifted(image, 3, 0), -1)
    usual = [(_shifted(np.rot90(image, -1), 3, 0), FRAME), (_shifted(np.rot90(image, -1), -3, 0), BACKWARDS)]
    expect(claim, mine, given, right, usual)


def _log_odds(evidence, hits, passes):
    flat, cells, votes = (np.zeros(evidence.size, kind) for kind in (np.int8, np.uint8, np.uint8))
    flat[:] = evidence.ravel()
    for seen, label in ((passes, Surface.PERSON), (hits, Surface.WALL)):  # a person's echo takes as a pass does
        found = np.flatnonzero(seen).astype(np.int32)
        mark_hits(cells, flat, votes, found, np.full(len(found), label, np.uint8))
    return flat.reshape(evidence.shape).astype(int)


def _cache(image, pose_sent, pose_now):
    there = to_robot(to_world(crop_cell_centres() * 0.1, pose_now), pose_sent)
    rows, columns = (np.floor(32.0 - there[..., k] / 0.1).astype(int) for k in (0, 1))
    inside = (rows >= 0) & (rows < 64) & (columns >= 0) & (columns < 64)
    found = np.full((64, 64), float(CELL_VALUE[Cell.UNKNOWN]))
    found[inside] = image[rows[inside], columns[inside]]
    return found


CHECKS = {
    "log_odds": [hits_add_and_passes_take, evidence_has_bounds],
    "cache": [who_stands_sees_the_same, driving_ahead_moves_it_down, turning_left_moves_it_right, both_at_once],
}
REFERENCES = {"log_odds": _log_odds, "cache": _cache}
