"""`check("id", mine)`: at once, whether a student's function does what it should, else in words what is wrong."""

import importlib
from collections.abc import Callable

from dualnav_lite.check.verdict import NotDone, Text, Wrong, language_of, set_language
from dualnav_lite.config import UnusableInput

__all__ = ["LESSONS", "NotYet", "check", "judge", "lesson_of", "reference", "set_language"]

# Exercises by lesson. `check/<name>.py`, without the lesson's number, holds `CHECKS` and `REFERENCES` for its ids.
LESSONS: dict[str, tuple[str, ...]] = {
    "01_world": ("step_pose", "pid", "power"),
    "02_lidar": ("cast_scan", "scan_noise"),
    "03_map": ("log_odds", "cache"),
    "04_motion_field": ("compensate", "flow_component"),
    "05_predictor": ("constant_velocity", "displacement_errors"),
    "06_encoder": ("paint_bands", "project_intensity", "encode_state"),
    "07_rewards": ("safe", "goal", "reward_terms", "reward_weights"),
    "08_environment": ("closed_loop",),
    "09_rollout_and_gae": ("gae",),
    "10_ppo": ("policy_loss", "value_loss", "update"),
    "12_two_objectives": ("pareto_front",),
    "13_stress": ("wilson_interval",),
    "14_deploy": ("ticks_to_answer",),
    "16_second_world": ("car_safe",),
    "17_streets_dqn": ("td_target",),
}
PASSED = Text("{id}: passed, {n} properties hold", "{id}：通过，{n} 条性质成立")
FAILED = Text("{id}: not yet", "{id}：还不对")
STUB = Text("{id}: not done yet", "{id}：尚未完成")


class NotYet(AssertionError):
    """A check that did not pass; a notebook shows its words without a traceback."""

    def _render_traceback_(self) -> list[str]:
        return str(self).splitlines()


def lesson_of(exercise: str) -> str:
    """Name of the lesson that an exercise stands in."""
    for lesson, ids in LESSONS.items():
        if exercise in ids:
            return lesson
    known = ", ".join(one for ids in LESSONS.values() for one in ids)
    raise UnusableInput(f"unknown exercise '{exercise}'; known: {known}")


def _module(exercise: str):
    return importlib.import_module(f"dualnav_lite.check.{lesson_of(exercise).split('_', 1)[1]}")


def reference(exercise: str) -> Callable:
    """The library's function for an exercise, with the exercise's arguments; no check looks at it."""
    return _module(exercise).REFERENCES[exercise]


def judge(exercise: str, mine: Callable) -> Wrong | None:
    """The first property that does not hold, or None."""
    try:
        for holds in _module(exercise).CHECKS[exercise]:
            holds(mine)
    except Wrong as wrong:
        return wrong
    return None


def check(exercise: str, mine: Callable, lang: str | None = None) -> None:
    """Print that a function passes, or raise `NotYet` with what is wrong.

    Args:
        exercise: its id, the same word everywhere.
        mine: the function to look at.
        lang: "en" or "zh"; what `set_language` kept, else `$DUALNAV_LANG`, else English, if None.

    Raises:
        NotYet: a property does not hold; property, input, expected, got and, for usual mistakes, a hint.
        UnusableInput: an unknown exercise or language.
    """
    language = language_of(lang)
    wrong = judge(exercise, mine)

    def said(text: Text) -> str:
        words = text.zh if language == "zh" else text.en
        return words.format(id=exercise, n=len(_module(exercise).CHECKS[exercise]))

    if isinstance(wrong, NotDone):
        raise NotYet(said(STUB)) from None
    if wrong:
        raise NotYet("\n".join([said(FAILED), *wrong.lines(language)])) from None
    print(said(PASSED))
