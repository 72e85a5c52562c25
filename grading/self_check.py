"""Before anybody is graded: the sandbox denies what it must, the reference gets everything, the stubs nothing."""

from dualnav_lite.config import UnusableInput
from grading.job import SandboxError
from grading.lesson import grade_lesson
from grading.probe import leaks, probe
from grading.room import Room


def self_check(room: Room) -> None:
    """Before anybody is graded: the sandbox denies what it must, the reference gets everything, the stubs nothing.

    Raises:
        UnusableInput: one of them does not hold.
    """
    if room.tier != "UNSANDBOXED":
        try:
            open_doors = leaks(probe(room.tier))
        except SandboxError as error:
            raise UnusableInput(f"nothing is graded: {error}") from None
        if open_doors:
            raise UnusableInput(f"nothing is graded: the sandbox lets through {', '.join(open_doors)}")
    for name in room.rubric.lessons:
        setting = room.setting(name)
        for exercise, outcome in grade_lesson(setting, setting.master.solutions)[0].items():
            if outcome.status != "passed":
                raise UnusableInput(f"nothing is graded: the reference of '{exercise}' gets {outcome.reason}")
        for exercise, outcome in grade_lesson(setting, setting.master.stubs)[0].items():
            if outcome.share:
                raise UnusableInput(f"nothing is graded: the untouched stub of '{exercise}' gets points")
