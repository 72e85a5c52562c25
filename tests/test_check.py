"""Checks: usual mistakes get the hint that fits, other right solutions pass, and every id is one word everywhere."""

import ast
import re
import time
from pathlib import Path

import nbformat
import numpy as np
import pytest

from dualnav_lite.check import LESSONS, NotYet, check, judge, reference, set_language
from dualnav_lite.check import _module as module_of
from dualnav_lite.check.verdict import Text, Wrong, against, call, expect, hold, is_close, language_of, shown
from dualnav_lite.config import ROOT, UnusableInput

MUTANTS = Path(__file__).parent / "mutants"
IDS = [exercise for ids in LESSONS.values() for exercise in ids]
FURTHER = {"learning"}  # graded on the cell of another exercise: no check stands before it
FILES = sorted(path for path in MUTANTS.glob("*/*.py") if path.parent.name not in FURTHER)


def first_line(path):
    return path.read_text(encoding="utf-8").split("\n", 1)[0]


def function_in(path):
    names = {}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    return names[path.parent.name]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_usual_mistake_gets_its_hint_and_another_right_solution_passes(path):
    wrong = judge(path.parent.name, function_in(path))
    line = first_line(path)
    if line == "# right":
        assert wrong is None, wrong and wrong.lines("en")
        return
    hint = re.fullmatch(r"# hint: (.+)", line)[1]
    assert wrong is not None, "a wrong solution passed"
    assert hint in "\n".join(wrong.lines("en")), wrong.lines("en")


def test_a_loop_that_drives_on_is_told_so_in_both_languages():
    def endless(env, choose, seed):
        observation, info = env.reset(seed=seed)
        while True:
            observation, _, _, _, info = env.step(choose(observation, info))

    wrong = judge("closed_loop", endless)
    assert "  got: a step after the end of the episode" in wrong.lines("en")
    assert any(line.endswith("回合结束后又走了一步") for line in wrong.lines("zh"))


def test_an_image_of_float64_is_told_to_become_float32():
    def wide(*given):
        return reference("encode_state")(*given).astype(np.float64)

    wrong = judge("encode_state", wide)
    assert "hint: end with `.astype(np.float32)`" in "\n".join(wrong.lines("en"))
    assert (wrong.parts["expected"], wrong.parts["got"]) == ("float32", "float64")


def test_messages_hold_no_marks_that_a_plain_line_would_show():
    for path in (ROOT / "dualnav_lite" / "check").glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for call_of in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if getattr(call_of.func, "id", "") == "Text":
                said = [n.value for n in ast.walk(call_of) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
                for text in said:
                    assert not re.search(r"\*\*|(?<![\w`])\*\w", re.sub(r"`[^`]*`", "", text)), (path.name, text)


@pytest.mark.parametrize("exercise", IDS)
def test_every_exercise_has_three_mutants_and_another_right_solution(exercise):
    lines = [first_line(path) for path in FILES if path.parent.name == exercise]
    assert sum(line.startswith("# hint: ") for line in lines) >= 3
    assert "# right" in lines


def test_no_mutant_belongs_to_an_exercise_that_is_not_there():
    assert {path.parent.name for path in FILES} <= set(IDS)


@pytest.mark.parametrize("exercise", IDS)
def test_the_librarys_function_passes_within_a_second(exercise):
    judge(exercise, reference(exercise))  # compiles what has to be compiled
    begin = time.process_time()
    wrong = judge(exercise, reference(exercise))
    assert wrong is None, wrong and wrong.lines("en")
    assert time.process_time() - begin < 1.0


@pytest.mark.parametrize("exercise", IDS)
def test_a_function_that_raises_or_returns_nothing_is_told_in_words(exercise):
    def broken(*given):
        raise ZeroDivisionError("oh")

    assert "ZeroDivisionError" in "\n".join(judge(exercise, broken).lines("en"))
    assert "return" in "\n".join(judge(exercise, lambda *given: None).lines("en"))


@pytest.mark.parametrize("lesson", LESSONS)
def test_ids_are_the_same_in_the_lesson_and_in_its_checks(lesson):
    cells = nbformat.read(ROOT / "notebooks" / f"{lesson}.ipynb", as_version=4).cells
    solutions = [cell.id for cell in cells if "solution" in cell.metadata.get("tags", [])]
    checks = [cell for cell in cells if "check" in cell.metadata.get("tags", [])]
    assert tuple(solutions) == LESSONS[lesson]
    assert [cell.id for cell in checks] == [f"{name}_check" for name in solutions]
    assert [cell.source for cell in checks] == [f'check("{name}", {name})' for name in solutions]
    found = module_of(solutions[0])
    assert list(found.CHECKS) == list(found.REFERENCES) == solutions


@pytest.mark.parametrize("lesson", LESSONS)
def test_every_exercise_states_its_difficulty_and_minutes(lesson):
    text = (ROOT / "notebooks" / "src" / f"{lesson}.py").read_text(encoding="utf-8")
    for exercise in LESSONS[lesson]:
        line = rf"\*\*Exercise `{exercise}`\*\* \((easy|medium|hard)(, (very )?important)?, \d+ minutes\)"
        assert re.search(line, text), exercise


def test_messages_are_in_the_language_that_was_asked_for(monkeypatch, capsys):
    with pytest.raises(NotYet, match=r"expected: -0\.4") as english:
        check("safe", lambda clearance: -10.0 * clearance)
    assert "article" in str(english.value)
    monkeypatch.setenv("DUALNAV_LANG", "zh")
    with pytest.raises(NotYet, match=r"期望：-0\.4") as chinese:  # noqa: RUF001
        check("safe", lambda clearance: -10.0 * clearance)
    assert "原文" in str(chinese.value)
    check("safe", reference("safe"), lang="en")
    assert capsys.readouterr().out == "safe: passed, 4 properties hold\n"


def test_a_language_is_kept_for_all_lessons_of_a_folder(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DUALNAV_LANG", raising=False)
    set_language()
    set_language("zh")
    check("safe", reference("safe"))
    check("safe", reference("safe"), lang="en")
    set_language("en")
    first, second, chinese, english, last = capsys.readouterr().out.splitlines()
    assert "speak English" in first
    assert "中文" in second
    assert "通过" in chinese
    assert "passed" in english
    assert last == first
    with pytest.raises(UnusableInput, match="known: en, zh"):
        set_language("de")


def test_commands_speak_the_language_that_was_kept_in_the_folder_they_are_asked_about(monkeypatch, tmp_path):
    monkeypatch.delenv("DUALNAV_LANG", raising=False)
    (tmp_path / "course").mkdir()
    monkeypatch.chdir(tmp_path / "course")
    set_language("zh")
    monkeypatch.chdir(tmp_path)
    assert [language_of(), language_of(None, "course"), language_of("en", "course")] == ["en", "zh", "en"]


def test_a_notebook_shows_the_words_without_a_traceback():
    with pytest.raises(NotYet) as failed:
        check("safe", lambda clearance: 0.0 * clearance)
    assert failed.value._render_traceback_()[0] == "safe: not yet"


def test_a_stub_is_not_done_rather_than_wrong():
    def stub(clearance):
        raise NotImplementedError("exercise safe")

    with pytest.raises(NotYet, match="safe: not done yet"):
        check("safe", stub)


@pytest.mark.parametrize(("arguments", "word"), [(("sofe",), "known: "), (("safe", "de"), "known: en, zh")])
def test_an_unknown_exercise_or_language_is_refused(arguments, word):
    with pytest.raises(UnusableInput, match=word):
        check(arguments[0], len, *arguments[1:])


CLAIM = Text("a claim", "一条性质")


def test_a_function_that_changes_its_input_is_told():
    def changes(a):
        a *= 2
        return a

    with pytest.raises(Wrong) as wrong:
        call(CLAIM, changes, {"a": np.ones(2)})
    assert "copies" in "\n".join(wrong.value.lines("en"))


def test_expect_prefers_the_hint_that_fits_the_answer():
    usual = [(2.0, Text("doubled", "加倍")), (-1.0, Text("sign", "符号"))]
    with pytest.raises(Wrong) as wrong:
        expect(CLAIM, lambda x: -x, {"x": 1.0}, 1.0, usual)
    assert wrong.value.lines("en")[-1] == "  hint: sign"
    with pytest.raises(Wrong) as wrong:
        hold(CLAIM, False, got=1.0)
    assert wrong.value.lines("zh") == ["  应当成立：一条性质", "  得到：1"]  # noqa: RUF001


@pytest.mark.parametrize(
    ("got", "expected", "same"),
    [
        (1.0, 1.0 + 1e-9, True),
        (np.nan, 1.0, False),
        (np.ones(2), np.ones(3), False),
        ("text", 1.0, False),
        ((1.0, 2.0), (1.0, 2.0), True),
        ({"a": 1.0}, {"a": 1.0, "b": 1.0}, False),
        ([[1.0]], 1.0, False),
    ],
)
def test_answers_are_compared_by_kind_shape_and_number(got, expected, same):
    assert is_close(got, expected) is same


def test_an_image_that_is_too_large_to_print_says_where_it_is_wrong():
    def shifted(image, pose_sent, pose_now):
        return np.roll(image, 1, axis=1)

    wrong = judge("cache", shifted)
    en, zh = ("".join(wrong.lines(language)) for language in ("en", "zh"))
    assert re.search(r"; 4096 of 4096 numbers are wrong, first \[0, 0\]: 0\.\d+, not 0\.\d+", en)
    assert re.search(r"4096 个数中有 4096 个不对.+ \[0, 0\].+ 0\.\d+.+ 0\.\d+", zh)
    right = np.zeros((64, 64))
    assert against(right, right) == shown(right)
    assert against([1.0, 2.0], [1.0, 3.0]) == "[1., 2.]"
    assert against("a word", right) == "a word"


def test_values_are_shown_in_few_characters():
    assert shown({"a": np.float64(1 / 3), "b": True}) == "{a: 0.3333, b: True}"
    assert len(shown(np.zeros((100, 100)))) < 120
