"""The trusted scorers: what is asked of an exercise and what a right answer is. One file an exercise id.

A task is a module with `questions(rng)`, a list of `Question`. Inputs come from a secret seed; expected values are
computed here, by the library's slow twins or by formulas of this folder, never by what is asked. Questions go from
plain to special, so that the first that fails names the mistake. A task that is no list of questions has
`play(rng, ask, marks)` in their place.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dualnav_lite.config import UnusableInput


@dataclass(frozen=True)
class Question:
    """One call and its right answer.

    Attributes:
        hint: reason code where it is answered wrongly.
        arrays: what is sent.
        expected: array by name; the answer must hold exactly these names and shapes.
        share: of the exercise's points; the shares of a task add up to 1.
        tolerance: absolute and relative.
        also: names of answers with a reason code of their own.
        other: by name more values that are right, where more than one way is.
    """

    hint: str
    arrays: dict[str, np.ndarray]
    expected: dict[str, np.ndarray]
    share: float
    tolerance: float = 1e-6
    also: dict[str, str] = field(default_factory=dict)
    other: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def judge(self, answer: dict[str, np.ndarray]) -> str:
        """Empty where the answer is right, else a reason code."""
        if set(answer) != set(self.expected):
            return "wrong_type"
        for name, right in self.expected.items():
            given = answer[name]
            if given.dtype.kind not in "fib" or given.shape != right.shape:
                return "wrong_shape"
            given = given.astype(np.float64)
            if not np.isfinite(given).all():
                return "not_finite"
            rights = [right, *self.other.get(name, [])]
            if not any(np.allclose(given, one, rtol=self.tolerance, atol=self.tolerance) for one in rights):
                return self.also.get(name, self.hint)
        return ""


Questions = Callable[[np.random.Generator], list[Question]]
Ask = Callable[[dict[str, np.ndarray]], tuple[str, dict[str, np.ndarray]]]


@dataclass
class Marks:
    """What a task has come to so far.

    Attributes:
        share: of the exercise's points.
        passed: whether all of it is right.
        reason: code of the first mistake.
        detail: numbers for feedback that tell nothing hidden.
    """

    share: float = 0.0
    passed: bool = False
    reason: str = ""
    detail: dict = field(default_factory=dict)


def _module(exercise: str):
    """The module with the task of an exercise.

    Raises:
        UnusableInput: there is none, or it is no identifier.
    """
    if not exercise.isidentifier():
        raise UnusableInput(f"'{exercise}' is no exercise id")
    try:
        return importlib.import_module(f"grading.tasks.{exercise}")
    except ModuleNotFoundError:
        raise UnusableInput(f"exercise '{exercise}' has no scorer: grading/tasks/{exercise}.py is missing") from None


def questions_of(exercise: str) -> Questions:
    """The questions of an exercise that has some; raises as `task_of` does."""
    return _module(exercise).questions


def task_of(exercise: str) -> Callable[[np.random.Generator, Ask, Marks], None]:
    """A function that asks and fills in marks as it goes, so that those stand if an answer never comes.

    Raises:
        UnusableInput: there is none, or it is no identifier.
    """
    module = _module(exercise)
    return module.play if hasattr(module, "play") else partial(put_questions, module.questions)


def put_questions(questions: Questions, rng: np.random.Generator, ask: Ask, marks: Marks) -> None:
    """Put questions one after the other; each that is answered rightly earns its share.

    Args:
        questions: of a task.
        rng: from the secret.
        ask: arrays of a call to (reason code of what was raised, arrays of the answer).
        marks: filled in.
    """
    wrong: list[str] = []
    marks.detail |= {"right": 0, "asked": 0, "wrong": wrong}
    for question in questions(rng):
        marks.detail["asked"] += 1
        raised, answer = ask(question.arrays)
        if found := raised or question.judge(answer):
            wrong += [found] if found not in wrong else []
            marks.reason = marks.reason or found
        else:
            marks.share += question.share
            marks.detail["right"] += 1
    marks.passed = marks.detail["right"] == marks.detail["asked"]
