"""What an instructor does before a release, and CI always: the grader is tried on what it must get right."""

import importlib
from collections.abc import Callable
from pathlib import Path

from dualnav_lite.check import judge
from dualnav_lite.config import UnusableInput
from grading.feedback import reason_text
from grading.lesson import grade_lesson
from grading.policy import grade_policy
from grading.room import PACKAGE, Room
from grading.self_check import self_check

MUTANTS = PACKAGE.parent / "tests" / "mutants"
HINT = "# hint: "  # first line of a mistake, with words of the hint that students get
RIGHT = "# right"  # first line of a solution that is another one and no mistake
LEAST_MUTANTS = 3


def dry_run(room: Room, say: Callable[[str], None] = print, mutants: Path = MUTANTS) -> list[str]:
    """What does not hold, a line each; empty where the class may be graded.

    The reference gets everything and the untouched notebook nothing; each usual mistake fails, before the scorer and
    before the check that students run, there with the hint that fits; each other right solution passes; the shipped
    policy passes and one that stands still does not; attacks leave the host untouched.
    """
    problems = []
    try:
        self_check(room)
    except UnusableInput as error:
        return [str(error)]
    say("reference: everything; untouched: nothing; the sandbox denies what it must")
    for lesson in room.rubric.lessons:
        for exercise, rule in room.rubric.lessons[lesson].exercises.items():
            found = sorted((mutants / exercise).glob("*.py"))
            texts = {path.stem: path.read_text(encoding="utf-8") for path in found}
            wrong = sum(not text.startswith(RIGHT) for text in texts.values())
            if wrong < LEAST_MUTANTS:
                problems.append(f"{exercise}: has {wrong} mutants, needs {LEAST_MUTANTS}")
            tried = [] if rule.of else _checked(room, lesson, exercise, texts)
            tried += _tried(room, lesson, exercise, texts)
            failed = [f"{exercise}: {problem}" for problem in tried]
            problems += failed
            say(f"{exercise}: {len(texts)} other solutions, {len(failed)} judged wrongly")
    if room.rubric.policy:
        problems += _policies(room, say)
    problems += _attacks(room, say)
    return problems


def _tried(room: Room, lesson: str, exercise: str, texts: dict[str, str]) -> list[str]:
    """Which solutions are judged wrongly, each in a sandbox as if a student had handed it in."""
    problems, setting = [], room.setting(lesson)
    rule = setting.lesson.exercises[exercise]
    needs = {need: setting.master.solutions[need] for need in rule.needs}
    for name, text in texts.items():
        outcome = grade_lesson(setting, needs | {rule.of or exercise: text})[0][exercise]
        is_right = text.startswith(RIGHT)
        if is_right != (outcome.status == "passed"):
            said = f"gets {outcome.reason}" if is_right else "passes"
            problems.append(f"{'right solution' if is_right else 'mutant'} '{name}' {said}")
        elif rule.of and not is_right:  # no check of the lesson stands before it, so feedback has the only hint
            hint = text.partition("\n")[0].removeprefix(HINT)
            if hint not in reason_text(outcome.reason, "en"):
                problems.append(f"feedback gives no fitting hint to mutant '{name}'")
    return problems


def _checked(room: Room, lesson: str, exercise: str, texts: dict[str, str]) -> list[str]:
    """Which solutions the check of the lesson judges wrongly; all of them are the teacher's own, so they run here."""
    names: dict = {}
    for kind, value in room.masters[lesson].order:
        exec(value if kind == "given" else room.masters[lesson].solutions[value], names)
    wrong = judge(exercise, names[exercise])
    problems = [] if wrong is None else [f"the check refuses the reference: {wrong}"]
    for name, text in texts.items():
        found: dict = {}
        exec(text, found)
        wrong, first = judge(exercise, found[exercise]), text.partition("\n")[0]
        if text.startswith(RIGHT):
            problems += [f"the check refuses the right solution '{name}'"] if wrong else []
        elif wrong is None or first.removeprefix(HINT) not in "\n".join(wrong.lines("en")):
            problems.append(f"the check {'gives no fitting hint to' if wrong else 'lets pass'} mutant '{name}'")
    return problems


def _policies(room: Room, say) -> list[str]:
    from grading.example import standing_still

    rule = room.rubric.policy
    shipped = PACKAGE.parent / "models" / f"{rule.weights}.onnx"
    if not shipped.exists():
        return [f"policy: {shipped.name} is not in models/, so nobody knows whether the thresholds can be reached"]
    problems = []
    for name, weights, share in (("shipped", shipped.read_bytes(), 1.0), ("motionless", standing_still(), 0.0)):
        for part, outcome in grade_policy(room.setting(), rule, weights).items():
            if outcome.share != share:
                problems.append(
                    f"{part}: the {name} policy gets {outcome.share:.0%}, not {share:.0%}: {outcome.reason}"
                )
    say(f"policies: the shipped one and a motionless one, {len(problems)} judged wrongly")
    return problems


def _attacks(room: Room, say) -> list[str]:
    """The attack folder, where the kit has it: a function `grading.attacks.run(room)` that gives a line a problem."""
    try:
        run = importlib.import_module("grading.attacks").run
    except (ModuleNotFoundError, AttributeError):
        say("attacks: no folder grading/attacks here, so none was tried")
        return []
    found = list(run(room))
    say(f"attacks: {len(found)} did harm or got points")
    return found
