"""The trusted scorers: what is asked of an exercise and what a right answer is. One file an exercise id.

A task is a module with `questions(rng)`, a list of `Question`. Inputs come from a secret seed; expected values are
computed here, by the library's slow twins or by formulas of this folder, never by what is asked. Questions go from
plain to special, so that the first that fails names the mistake.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field

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
        other: values that are right too, where more than one way is.
    """

    hint: str
    arrays: dict[str, np.ndarray]
    expected: dict[str, np.ndarray]
    share: float
    tolerance: float = 1e-6
    also: dict[str, str] = field(default_factory=dict)
    other: dict[str, np.ndarray] = field(default_factory=dict)

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
            rights = [right, *([self.other[name]] if name in self.other else [])]
            if not any(np.allclose(given, one, rtol=self.tolerance, atol=self.tolerance) for one in rights):
                return self.also.get(name, self.hint)
        return ""


def questions_of(exercise: str) -> Callable[[np.random.Generator], list[Question]]:
    """The task of an exercise.

    Raises:
        UnusableInput: there is none, or it is no identifier.
    """
    if not exercise.isidentifier():
        raise UnusableInput(f"'{exercise}' is no exercise id")
    try:
        return importlib.import_module(f"grading.tasks.{exercise}").questions
    except ModuleNotFoundError:
        raise UnusableInput(f"exercise '{exercise}' has no scorer: grading/tasks/{exercise}.py is missing") from None
