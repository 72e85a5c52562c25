"""What a check says: one property, the input, what was expected, what came, a hint for a usual mistake.

Nothing here is graded: it runs in the student's own interpreter. Grading asks the student's functions from outside.
"""

import copy
import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dualnav_lite.config import UnusableInput, write_atomic

LANGUAGES = ("en", "zh")
KEPT = ".language"  # file of the folder with the lessons
CLOSE = 1e-6
PRINTED = 24  # numbers, at most, of an array that is printed whole


class Text(NamedTuple):
    """A sentence in both languages."""

    en: str
    zh: str


def language_of(asked: str | None = None, folder: str | Path = ".") -> str:
    """ "en" or "zh": what is asked for, else what `set_language` kept in `folder`, else `$DUALNAV_LANG`, else "en"."""
    path = Path(folder) / KEPT
    kept = path.read_text(encoding="utf-8").strip() if path.is_file() else ""
    found = asked or kept or os.environ.get("DUALNAV_LANG") or "en"
    if found not in LANGUAGES:
        raise UnusableInput(f"unknown language '{found}'; known: {', '.join(LANGUAGES)}")
    return found


def set_language(language: str | None = None) -> None:
    """Say in which language checks and `status` speak; "en" or "zh" is kept for every lesson of this folder."""
    if language is not None:
        write_atomic(Path(KEPT), language_of(language) + "\n")
    print(SPEAKS[LANGUAGES.index(language_of())])


SPEAKS = Text('checks speak English; 中文提示：set_language("zh")', '检查的提示用中文；English: set_language("en")')

HEADINGS = {
    "claim": Text("should hold", "应当成立"),
    "given": Text("input", "输入"),
    "expected": Text("expected", "期望"),
    "got": Text("got", "得到"),
    "hint": Text("hint", "提示"),
}
COLON = Text(": ", "：")
NOTHING = Text(
    "it returned nothing: does every branch end in `return`?", "没有返回值：每个分支都以 `return` 结束了吗？"
)
NOT_DONE = Text("not done yet", "尚未完成")
CHANGED = Text(
    "it changed what it was given: work on copies (`a = a * 2`, not `a *= 2`)",
    "它改动了传入的数据：请在副本上计算（写 `a = a * 2`，不要写 `a *= 2`）",
)
RAISED = Text("an answer, not an exception", "一个结果，而不是异常")
# What Python says, and what it means here.
MEANINGS = {
    "truth value of an array": Text(
        "an `if` asks one number, an array holds many: use `np.where` or `np.clip`",
        "`if` 只能判断一个数，数组里有很多个：请用 `np.where` 或 `np.clip`",
    ),
    "positional argument": Text("keep the arguments as the exercise gave them", "请保持练习给出的参数不变"),
    "out of bounds": Text("leave out what lies beyond the array", "超出数组范围的要去掉"),
    "is not defined": Text("run the cells above first", "请先运行上面的单元格"),
}
SHAPE = Text("the shape or the kind of the answer is another one", "结果的形状或类型不对")


class Wrong(Exception):
    """A property that does not hold, in words."""

    def __init__(self, claim: Text, given="", expected="", got="", hint: Text | None = None):
        super().__init__(claim.en)
        self.parts = {"claim": claim, "given": given, "expected": expected, "got": got, "hint": hint or ""}

    def lines(self, language: str) -> list[str]:
        """The words in one language, a line each part that is there."""
        k = LANGUAGES.index(language)
        shown = {name: part[k] if isinstance(part, Text) else part for name, part in self.parts.items()}
        return [f"  {HEADINGS[name][k]}{COLON[k]}{text}" for name, text in shown.items() if text]


class NotDone(Wrong):
    """The solution is still the stub."""

    def __init__(self):
        super().__init__(NOT_DONE)


def plain(value):
    """Tensors as arrays, everything else as it is."""
    return value.detach().cpu().numpy() if hasattr(value, "detach") else value


def shown(value: Any) -> str:
    """A value in few characters."""
    value = plain(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {shown(one)}" for key, one in value.items()) + "}"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return ", ".join(f"{field.name}={shown(getattr(value, field.name))}" for field in dataclasses.fields(value))
    if isinstance(value, bool | np.bool_ | str) or value is None or callable(value):
        return str(value)
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, tuple):
        return "(" + ", ".join(map(shown, value)) + ")"
    try:
        array = np.asarray(value)
        if array.size > PRINTED:
            return f"array {array.shape}, {float(array.min()):.4g} to {float(array.max()):.4g}"
        return " ".join(np.array2string(array, precision=4, suppress_small=True, separator=", ").split())
    except (TypeError, ValueError):
        return type(value).__name__


def is_close(got: Any, expected: Any, close: float = CLOSE) -> bool:
    """Whether an answer is the expected one: the same keys, lengths and shapes, and numbers within `close`."""
    got, expected = plain(got), plain(expected)
    if isinstance(expected, Mapping):
        same = isinstance(got, Mapping) and set(got) == set(expected)
        return same and all(is_close(got[key], expected[key], close) for key in expected)
    if isinstance(expected, tuple):
        is_row = isinstance(got, tuple | list) or np.ndim(got) > 0  # `np.stack([low, high])` unpacks as well
        same = is_row and len(got) == len(expected)
        return same and all(is_close(one, other, close) for one, other in zip(got, expected, strict=True))
    try:
        got, expected = np.asarray(got, float), np.asarray(expected, float)
    except (TypeError, ValueError):
        return False
    return got.shape == expected.shape and np.allclose(got, expected, rtol=close, atol=close, equal_nan=False)


def against(got: Any, expected: Any, close: float = CLOSE) -> str | Text:
    """An answer in few characters; of one too large to print, also how many numbers are wrong and the first of them."""
    text = shown(got)
    try:
        got, expected = np.asarray(plain(got), float), np.asarray(plain(expected), float)
    except (TypeError, ValueError):
        return text
    if got.size <= PRINTED or got.shape != expected.shape:
        return text
    wrong = np.argwhere(~np.isclose(got, expected, rtol=close, atol=close))
    if not len(wrong):
        return text
    place = tuple(int(k) for k in wrong[0])
    mine, right = shown(got[place]), shown(expected[place])
    return Text(
        f"{text}; {len(wrong)} of {got.size} numbers are wrong, first {list(place)}: {mine}, not {right}",
        f"{text}；{got.size} 个数中有 {len(wrong)} 个不对，第一个在 {list(place)}：得到 {mine}，应为 {right}",
    )


def verdict_on(error: Exception, claim: Text, given: str, expected: Any, hint: Text | None = None) -> Exception:
    """What to raise for an error inside the student's function: `NotDone` for a stub alone, else `Wrong`."""
    if isinstance(error, NotImplementedError) and str(error).startswith("exercise "):
        return NotDone()
    return Wrong(claim, given, expected, f"{type(error).__name__}: {error}", hint)


def call(claim: Text, mine: Callable, given: Mapping[str, Any]) -> Any:
    """What the student's function answers; whatever goes wrong in it becomes a `Wrong` with the input beside it."""
    handed = copy.deepcopy(dict(given))
    before = copy.deepcopy(handed)
    try:
        got = mine(*handed.values())
    except Wrong:
        raise
    except Exception as error:
        hint = next((text for words, text in MEANINGS.items() if words in str(error)), None)
        raise verdict_on(error, claim, shown(given), RAISED, hint) from None
    if got is None:
        raise Wrong(claim, shown(given), "", "None", NOTHING)
    for name, value in before.items():
        if isinstance(value, np.ndarray) and not np.array_equal(value, handed[name], equal_nan=True):
            raise Wrong(claim, f"{name} = {shown(value)}", "", f"{name} = {shown(handed[name])}", CHANGED)
    return got


def expect(
    claim: Text,
    mine: Callable,
    given: Mapping[str, Any],
    expected: Any,
    usual: Sequence[tuple[Any, Text]] = (),
    close: float = CLOSE,
) -> Any:
    """The answer, if it is the expected one.

    Args:
        claim: the property that this input shows.
        mine: the student's function.
        given: its arguments in order, by the names that the message uses.
        expected: the answer, worked out without the library's function.
        usual: answers that usual mistakes give, each with the hint that names the mistake.
        close: relative and absolute tolerance.

    Raises:
        Wrong: another answer.
    """
    got = call(claim, mine, given)
    if is_close(got, expected, close):
        return got
    hint = next((text for value, text in usual if is_close(got, value, close)), None)
    if hint is None and np.shape(plain(got)) != np.shape(plain(expected)):
        hint = SHAPE
    raise Wrong(claim, shown(given), shown(expected), against(got, expected, close), hint)


def hold(claim: Text, is_so: bool, given="", expected="", got="", hint: Text | None = None) -> None:
    """Raise `Wrong` unless the property holds; for properties that are no single value."""
    if not is_so:
        answer = got if isinstance(got, Text | str) else against(got, expected)
        given, expected = (one if isinstance(one, Text | str) else shown(one) for one in (given, expected))
        raise Wrong(claim, given, expected, answer, hint)
