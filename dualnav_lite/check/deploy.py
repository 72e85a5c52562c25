"""Checks of lesson 14: two short drives whose commands part at a step that can be counted on fingers."""

import numpy as np

from dualnav_lite import twin
from dualnav_lite.check.verdict import Text, call, expect, hold

# ticks_to_answer(driven, twin, seen)

FROM_ZERO = Text(
    "the command that follows the first scan of it is tick 1, not 0",
    "看到它的那一帧之后的指令算第 1 个周期，不是第 0 个",
)
FROM_START = Text("count from `seen`, not from the start of the drive", "要从 `seen` 数起，不是从行程开始数起")
TOO_EARLY = Text("what differs before it was seen is no answer to it", "看到之前就有的差别不是对它的响应")
ANY_CHANGE = Text(
    "only more than 0.05 m/s or 0.1 rad/s counts: less is noise", "超过 0.05 m/s 或 0.1 rad/s 才算：更小的是噪声"
)
ONE_OF_BOTH = Text("v or omega: a turn is an answer too", "v 或 omega：转向也是响应")
SIGN = Text("slower and faster both count: the size of the difference", "变慢和变快都算：看差的绝对值")
LAST = Text("the first command that differs", "第一个不同的指令")


def _drives(changes: dict[int, tuple[float, float]]) -> dict:
    """Ten commands, the same in both drives, but for (v, omega) at some steps of the first."""
    twin_commands = np.tile([0.5, 0.0], (10, 1))
    driven = twin_commands.copy()
    for step, command in changes.items():
        driven[step] = command
    return {"driven": driven, "twin": twin_commands, "seen": 4}


def _counted(claim: Text, mine, given, right: float, usual, never: Text) -> None:
    """`expect`, with a hint of its own where the answer is nan, which equals nothing."""
    got = call(claim, mine, given)
    hold(claim, not (np.ndim(got) == 0 and got != got), "", right, "nan", never)
    expect(claim, mine, given, right, usual)


def the_very_next_command_is_tick_one(mine):
    claim = Text("seen at step 4, braked at step 4: 1 tick", "第 4 步看到、第 4 步刹车：1 个周期")
    usual = [(0.0, FROM_ZERO), (5.0, FROM_START), (4.0, FROM_START)]
    _counted(claim, mine, _drives({4: (0.3, 0.0), 5: (0.1, 0.0)}), 1.0, usual, SIGN)


def a_turn_counts_as_well(mine):
    claim = Text("seen at step 4, turned at step 6: 3 ticks", "第 4 步看到、第 6 步转向：3 个周期")
    usual = [(2.0, FROM_ZERO), (7.0, FROM_START), (5.0, LAST), (4.0, ONE_OF_BOTH)]
    _counted(claim, mine, _drives({6: (0.5, -0.3), 7: (0.3, 0.0), 8: (0.5, 0.2)}), 3.0, usual, ONE_OF_BOTH)


def trembling_is_no_answer(mine):
    claim = Text("0.04 m/s at step 5, an answer at step 7: 4 ticks", "第 5 步差 0.04 m/s，第 7 步才响应：4 个周期")
    _counted(claim, mine, _drives({5: (0.54, 0.05), 7: (0.6, 0.0)}), 4.0, [(2.0, ANY_CHANGE)], SIGN)


def what_came_before_does_not_count(mine):
    claim = Text(
        "a difference at step 1, before anything was seen, and one at step 5: 2 ticks",
        "第 1 步（尚未看到）有差别，第 5 步又有：2 个周期",
    )
    _counted(
        claim, mine, _drives({1: (0.2, 0.0), 5: (0.2, 0.0)}), 2.0, [(-2.0, TOO_EARLY), (-3.0, TOO_EARLY)], TOO_EARLY
    )


def no_answer_is_not_a_number(mine):
    claim = Text("never another command: nan", "指令始终相同：nan")
    got = call(claim, mine, _drives({}))
    hold(
        claim,
        isinstance(got, float | np.floating) and bool(np.isnan(got)),
        Text("ten equal commands", "十个相同的指令"),
        "nan",
        str(got),
    )


CHECKS = {
    "ticks_to_answer": [
        the_very_next_command_is_tick_one,
        a_turn_counts_as_well,
        trembling_is_no_answer,
        what_came_before_does_not_count,
        no_answer_is_not_a_number,
    ]
}
REFERENCES = {"ticks_to_answer": twin.ticks_to_answer}
