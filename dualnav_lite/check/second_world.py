"""Checks of lesson 16: gaps and seconds for which the penalty can be worked out in one's head."""

from dualnav_lite.check.verdict import Text, expect
from dualnav_lite.highway import cars

# car_safe(clearance, time_gap, safe_m)

SIGN = Text("a penalty is negative", "惩罚应为负值")
LINEAR = Text("the hinge is squared", "缺口要取平方")
SUMMED = Text("whichever is worse, not both added up", "取两者中较差的一个，不是相加")
LESSER = Text("whichever is worse: the larger shortfall", "取两者中较差的：较大的缺口")
BONUS = Text(
    "more room than asked for is worth nothing extra: no shortfall is below 0", "多余的空间不加分：缺口不小于 0"
)
METRES = Text(
    "the shortfall is a share: the gap over `safe_m`, the seconds over 1.5",
    "缺口是比例：间隙除以 `safe_m`，秒数除以 1.5",
)
FORGOTTEN = Text("the time gap counts as well", "时距也要算")
ROBOTS = Text("at contact it is -0.9, as for the robot", "接触时为 -0.9，与机器人相同")


def _given(clearance: float, time_gap: float, safe_m: float) -> dict:
    return {"clearance": clearance, "time_gap": time_gap, "safe_m": safe_m}


def contact_costs_what_it_costs_the_robot(mine):
    claim = Text("a contact, nobody ahead: -0.9", "发生接触、前方无车：-0.9")
    usual = [(0.9, SIGN), (-1.0, ROBOTS), (-10.0, ROBOTS), (-0.225, METRES), (0.0, LESSER)]
    expect(claim, mine, _given(0.0, float("inf"), 0.5), -0.9, usual)


def half_the_gap_costs_a_quarter(mine):
    claim = Text("half of the gap that is asked for: a quarter of -0.9", "间隙只有要求的一半：-0.9 的四分之一")
    usual = [(0.225, SIGN), (-0.45, LINEAR), (-0.25, ROBOTS), (-0.9, METRES), (-0.05625, METRES)]
    expect(claim, mine, _given(0.5, float("inf"), 1.0), -0.225, usual)
    expect(claim, mine, _given(0.25, 9.0, 0.5), -0.225, usual)


def following_too_closely_costs_too(mine):
    claim = Text(
        "half a second behind another car, wide of everything: 1 - 0.5 / 1.5 is missing",
        "跟车时距 0.5 s、间隙充足：缺口为 1 - 0.5 / 1.5",
    )
    usual = [(0.0, FORGOTTEN), (0.4, SIGN), (-0.6, LINEAR), (-0.9, METRES), (-0.225, METRES)]
    expect(claim, mine, _given(8.0, 0.5, 1.0), -0.4, usual)


def the_worse_of_the_two_counts(mine):
    claim = Text(
        "half of the gap and a third of the time are missing: the gap counts", "间隙缺一半、时距缺三分之一：按间隙算"
    )
    both = -0.9 * (0.5**2 + (1.0 / 3.0) ** 2)
    usual = [(both, SUMMED), (-0.9 * (0.5 + 1.0 / 3.0) ** 2, SUMMED), (-0.1, LESSER), (-0.45, LINEAR)]
    expect(claim, mine, _given(0.5, 1.0, 1.0), -0.225, usual)


def enough_room_is_free(mine):
    claim = Text("3 m of room and 4 s: nothing to pay", "间隙 3 m、时距 4 s：没有惩罚")
    usual = [(-0.9 * (1.0 - 4.0 / 1.5) ** 2, BONUS), (-0.9 * 4.0, BONUS), (-0.9, BONUS)]
    expect(claim, mine, _given(3.0, 4.0, 1.0), 0.0, usual)


CHECKS = {
    "car_safe": [
        contact_costs_what_it_costs_the_robot,
        half_the_gap_costs_a_quarter,
        following_too_closely_costs_too,
        the_worse_of_the_two_counts,
        enough_room_is_free,
    ]
}
REFERENCES = {"car_safe": cars.car_safe}
