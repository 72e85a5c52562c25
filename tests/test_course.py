"""The student version: stubs where solutions were and nothing else; whose part is used; release and export."""

import json
import re
import subprocess
import sys
from dataclasses import fields

import cloudpickle
import nbformat
import numpy as np
import pytest

from dualnav_lite import course, notebooks, parts, submission
from dualnav_lite.check import LESSONS
from dualnav_lite.commands import teaching
from dualnav_lite.commands.teaching import lessons_in
from dualnav_lite.config import ROOT, Config, UnusableInput, write_atomic
from dualnav_lite.evaluate import evaluate, library_arm
from dualnav_lite.exercises import BEGIN, stub, student_notebook
from dualnav_lite.rewards import TERMS, Transition

LESSON_FILES = [ROOT / "notebooks" / f"{lesson}.ipynb" for lesson in LESSONS]
LESSONS_ORDER = list(LESSONS)
IDS = [exercise for ids in LESSONS.values() for exercise in ids]


@pytest.fixture(scope="module")
def student(tmp_path_factory):
    """Folder with the untouched student version of every lesson."""
    folder = tmp_path_factory.mktemp("学生 课程")
    course.write_lessons(folder)
    return folder


@pytest.mark.parametrize("path", LESSON_FILES, ids=lambda path: path.stem)
def test_stub_and_solution_differ_in_solution_cells_alone(path, student):
    worked, left = (nbformat.read(one, as_version=4).cells for one in (path, student / path.name))
    assert [(cell.id, cell.cell_type, cell.metadata) for cell in worked] == [
        (cell.id, cell.cell_type, cell.metadata) for cell in left
    ]
    changed = [cell.id for cell, other in zip(worked, left, strict=True) if cell.source != other.source]
    assert tuple(changed) == LESSONS[path.stem]
    for cell in left:
        assert BEGIN not in cell.source
        assert ("NotImplementedError" in cell.source) == (cell.id in changed)


def test_the_worked_version_passes_every_check_and_the_untouched_one_none(student):
    worked = parts.parts_in(ROOT / "notebooks")
    assert {name for name, one in worked.items() if one.state != "passed"} == set()
    untouched = parts.parts_in(student)
    assert list(untouched) == IDS
    assert {one.state for one in untouched.values()} == {"not done"}


def test_a_failed_exercise_is_replaced_by_the_librarys_part_and_it_says_so(student, capsys):
    assert parts.part("safe", student)(0.1) == pytest.approx(-0.4)
    assert parts.part("safe", student / "nowhere", lang="zh")(0.1) == pytest.approx(-0.4)
    assert parts.part("safe", ROOT / "notebooks")(0.1) == pytest.approx(-0.4)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "safe: the library's (not done yet)",
        "safe：使用库的实现（此处没有笔记本）",  # noqa: RUF001
        "safe: yours",
    ]


def solve(path, exercise, source):
    """Write a student's own solution into a notebook."""
    notebook = nbformat.read(path, as_version=4)
    next(cell for cell in notebook.cells if cell.id == exercise).source = source
    nbformat.write(notebook, path)


def test_export_holds_what_passes_and_can_be_loaded_again(tmp_path, capsys):
    course.write_lessons(tmp_path)
    lesson = tmp_path / "07_rewards.ipynb"
    solve(lesson, "safe", "def safe(c):\n    return -10.0 * np.clip(0.3 - np.maximum(c, 0.0), 0.0, 0.3) ** 2")
    solve(lesson, "goal", "def goal(before, after, reached, gamma):\n    return before - after")
    parts.status(tmp_path)
    printed = capsys.readouterr().out
    assert "safe: yours" in printed
    assert "goal: the library's (not right yet)" in printed
    assert json.loads((tmp_path / "parts.json").read_text(encoding="utf-8"))["safe"]["is_yours"] is True
    out = tmp_path / "我的 部件"
    found = parts.export_parts(tmp_path, out)
    assert [name for name, one in found.items() if one.is_yours] == ["safe"]
    loaded = parts.load_parts(out)
    assert list(loaded) == ["safe"]
    np.testing.assert_allclose(loaded["safe"](np.array([0.1, 1.0])), [-0.4, 0.0])
    assert sorted(path.name for path in out.iterdir()) == ["07_rewards.py", "parts.json"]


def test_a_part_that_stands_on_a_wrong_one_stands_on_the_librarys(tmp_path, capsys):
    course.write_lessons(tmp_path)
    worked = {cell.id: cell.source for cell in nbformat.read(ROOT / "notebooks" / "06_encoder.ipynb", 4).cells}
    wrong = worked["project_intensity"].replace("(rows >= 0) & ", "")  # wraps round the upper edge
    assert wrong != worked["project_intensity"]
    for exercise, source in {**worked, "project_intensity": wrong}.items():
        if exercise in LESSONS["06_encoder"]:
            solve(tmp_path / "06_encoder.ipynb", exercise, source)
    found = parts.export_parts(tmp_path, tmp_path / "out")
    assert {name: found[name].state for name in LESSONS["06_encoder"]} == {
        "paint_bands": "passed",
        "project_intensity": "wrong",
        "encode_state": "passed",
    }
    assert sorted(parts.load_parts(tmp_path / "out")) == ["encode_state", "paint_bands"]
    scan = np.zeros((1080, 2), np.float32)
    scan[:, 0], scan[540] = 10.0, (5.0, 0.8)  # ahead, beyond the image
    intensity = parts.load_parts(tmp_path / "out")["encode_state"].__globals__["project_intensity"](scan)
    assert not intensity.any()
    (tmp_path / "out" / "parts.json").write_text("[1]", encoding="utf-8")
    with pytest.raises(UnusableInput, match="not what an export writes"):
        parts.load_parts(tmp_path / "out")


def test_an_arm_drives_in_worlds_with_the_students_parts(tmp_path):
    course.write_lessons(tmp_path)
    lesson = tmp_path / "07_rewards.ipynb"
    worked = {cell.id: cell.source for cell in nbformat.read(LESSON_FILES[LESSONS_ORDER.index("07_rewards")], 4).cells}
    for exercise in ("safe", "goal", "reward_terms"):
        solve(lesson, exercise, worked[exercise])
    assert parts.arms_with_parts(tmp_path, ["astar"]) == [f"astar::{tmp_path.resolve() / 'parts'}"]  # the notebooks
    parts.export_parts(tmp_path, tmp_path / "我的 部件")
    (arm,) = parts.arms_with_parts(tmp_path / "我的 部件", ["stand_still"])
    both = evaluate([arm, "stand_still"], ["navigation"], range(1_000_000, 1_000_002), tmp_path / "out", progress=False)
    assert set(both.arm) == {"stand_still", "stand_still + own parts"}  # no path of this machine
    is_mine = both.arm != "stand_still"
    mine, librarys = both[is_mine], both[~is_mine]
    assert len(mine) == len(librarys) == 2
    columns = [name for name in both.columns if name.startswith("r_")]
    np.testing.assert_allclose(mine[columns].to_numpy(float), librarys[columns].to_numpy(float), rtol=1e-6)
    assert library_arm(arm, Config()).fingerprint != getattr(library_arm("stand_still", Config()), "fingerprint", "")
    with pytest.raises(UnusableInput, match=r"parts\.json"):
        parts.arms_with_parts(tmp_path / "out", ["stand_still"])
    (tmp_path / "我的 部件" / "07_rewards.py").write_text("safe = goal = reward_terms = None\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match="none of its parts passes"):
        library_arm(arm, Config())  # what passed when it was exported, and no longer does
    course.write_lessons(tmp_path / "untouched")
    with pytest.raises(UnusableInput, match="none of its parts passes"):
        parts.arms_with_parts(tmp_path / "untouched", ["stand_still"])


def test_a_status_exports_what_is_yours_and_takes_the_folder_that_a_student_works_in(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnusableInput, match="no such folder"):
        lessons_in(None)
    (tmp_path / "notebooks").mkdir()
    assert lessons_in(None).name == "notebooks"
    course.write_lessons("course")
    assert lessons_in(None).name == "course"
    source = "def safe(c):\n    return -10.0 * np.clip(0.3 - np.maximum(c, 0.0), 0.0, 0.3) ** 2"
    solve(tmp_path / "course" / "07_rewards.ipynb", "safe", source)
    parts.status("course", "zh", export="mine")
    assert capsys.readouterr().out.splitlines()[-1] == "你的部件共 1 个：mine"  # noqa: RUF001
    assert list(parts.load_parts("mine")) == ["safe"]


def test_a_students_part_travels_to_the_processes_that_simulate(capsys):
    mine = parts.part("reward_terms", ROOT / "notebooks")
    assert "yours" in capsys.readouterr().out
    step = Transition(**{one.name: 1.0 for one in fields(Transition)})
    code = "import pickle, sys; mine, step = pickle.load(sys.stdin.buffer); print(sorted(mine(step)))"
    there = subprocess.run([sys.executable, "-c", code], input=cloudpickle.dumps((mine, step)), capture_output=True)
    assert there.returncode == 0, there.stderr.decode()
    assert there.stdout.decode().strip() == str(sorted(TERMS))


def test_a_cell_that_raises_costs_only_its_own_exercise(tmp_path):
    course.write_lessons(tmp_path)
    lesson = tmp_path / "07_rewards.ipynb"
    solve(lesson, "safe", "1 / 0")
    right = "def goal(before, after, reached, gamma):\n    return 10 * (before - gamma * after * (1 - reached))"
    solve(lesson, "goal", right)
    states = {name: one.state for name, one in parts.parts_in(tmp_path, ["07_rewards"]).items()}
    assert states["safe"] == "not done"
    assert states["goal"] == "passed"


def test_folders_that_hold_no_course_are_refused(tmp_path):
    with pytest.raises(UnusableInput, match="no lesson"):
        parts.export_parts(tmp_path, tmp_path / "out")
    with pytest.raises(UnusableInput, match=r"parts\.json"):
        parts.load_parts(tmp_path)
    (tmp_path / "07_rewards.ipynb").write_text("{", encoding="utf-8")
    with pytest.raises(UnusableInput, match="07_rewards"):
        parts.part("safe", tmp_path)


def test_the_release_holds_the_library_and_no_solution_no_test_no_source(tmp_path):
    out = course.release(tmp_path / "学生 版")
    assert (out / "dualnav_lite" / "rewards.py").exists()
    assert (out / "kit.py").exists()
    assert not any((out / name).exists() for name in ("tests", "grading", ".git", "notebooks/src"))
    assert {path.name for path in out.glob("notebooks/*.ipynb")} >= {path.name for path in LESSON_FILES}
    for path in out.rglob("*.ipynb"):
        assert BEGIN not in path.read_text(encoding="utf-8"), path
    assert not list(out.rglob("__pycache__"))
    assert [path.name for path in tmp_path.iterdir()] == ["学生 版"]


def test_a_release_overwrites_nothing(tmp_path):
    (tmp_path / "mine.txt").write_text("work", encoding="utf-8")
    with pytest.raises(UnusableInput, match="is there already"):
        course.release(tmp_path)
    with pytest.raises(UnusableInput, match="lies inside"):
        course.release(ROOT / "docs" / "course")
    course.write_lessons(tmp_path / "course")
    lesson = tmp_path / "course" / "07_rewards.ipynb"
    solve(lesson, "safe", "def safe(c):\n    return 0")
    before = lesson.read_bytes()
    assert course.write_lessons(tmp_path / "course") == []
    assert lesson.read_bytes() == before


SOLUTION = f"def f(x):\n    {BEGIN}\n    return x\n    ### END SOLUTION"


@pytest.mark.parametrize(
    ("cell", "word"),
    [
        (f'# %% tags=["solution"]\n{SOLUTION}', "grade_id"),
        (f'# %% grade_id="F x" tags=["solution"]\n{SOLUTION}', "grade_id"),
        ('# %% grade_id="f" tags=["solution"]\ndef f(x):\n    return x', "BEGIN SOLUTION"),
        (f'# %% grade_id="f" tags=["solution"]\n{SOLUTION}\n    {BEGIN}', "BEGIN SOLUTION"),
        ('# %% grade_id="f_check" tags=["check"]\ncheck("f", f)', "points"),
        ('# %% grade_id="f" points=1 tags=["check"]\ncheck("f", f)', "_check"),
    ],
)
def test_an_exercise_cell_that_is_not_one_is_refused(cell, word):
    with pytest.raises(UnusableInput, match=word):
        notebooks.to_notebook(cell + "\n")


def test_a_cell_may_hold_several_solutions_at_several_margins():
    method = f"class A:\n    def f(self):\n        {BEGIN}\n        return 1\n        ### END SOLUTION"
    source = f"{method}\n\n\n{BEGIN}\na = 2\n### END SOLUTION"
    assert stub(source, "a") == (
        'class A:\n    def f(self):\n        raise NotImplementedError("exercise a")\n\n\n'
        'raise NotImplementedError("exercise a")'
    )


def test_nbgraders_own_preprocessors_accept_the_worked_notebooks():
    preprocessors = pytest.importorskip("nbgrader.preprocessors")
    validator = pytest.importorskip("nbgrader.validator")
    assert validator
    for path in LESSON_FILES:
        notebook = nbformat.read(path, as_version=4)
        resources = {}
        for name in ("IncludeHeaderFooter", "CheckCellMetadata", "LockCells", "ClearSolutions"):
            notebook, resources = getattr(preprocessors, name)().preprocess(notebook, resources)
        left = {cell.id: cell.source for cell in notebook.cells}
        ours = nbformat.reads(student_notebook(path.read_text(encoding="utf-8")), as_version=4)
        for cell in ours.cells:
            if cell.id in LESSONS[path.stem]:
                assert left[cell.id].count("NotImplementedError") == cell.source.count("NotImplementedError")
            else:
                assert left[cell.id] == cell.source


def test_a_submission_holds_notebooks_weights_and_a_manifest(tmp_path):
    course.write_lessons(tmp_path / "课程")
    (tmp_path / "课程" / "weights").mkdir()
    (tmp_path / "课程" / "weights" / "extra.onnx").write_bytes(b"weights")
    said = []
    out = submission.pack(tmp_path / "课程", "s-01", tmp_path / "out", said.append)
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["student_id"] == "s-01"
    assert set(manifest["checks"]) == set(IDS)
    found = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert found == {*(f"{lesson}.ipynb" for lesson in LESSONS), "weights/extra.onnx", "manifest.json"}
    assert set(manifest["files"]) == found - {"manifest.json"}
    missing = ", ".join(LESSONS["07_rewards"])
    assert f"07_rewards: 0 of {len(LESSONS['07_rewards'])} exercises pass; not yet: {missing}" in said
    (tmp_path / "课程" / "weights" / "extra.onnx").unlink()
    submission.pack(tmp_path / "课程", "s-01", out, said.append)
    assert not (out / "weights" / "extra.onnx").exists()
    submission.try_out(tmp_path / "课程", out, 1, said.append)
    assert "left out" in said[-1]


def test_submit_drives_the_policy_and_says_what_range_to_expect_in_other_rooms(tmp_path, monkeypatch):
    work = tmp_path / "course"
    course.write_lessons(work)
    write_atomic(work / "weights" / "ppo_actor.onnx", (ROOT / "models" / "ppo_actor.onnx").read_bytes())
    monkeypatch.chdir(tmp_path)
    said = []
    out = submission.pack(work, "s-01", "submission_s-01", said.append, "zh")
    assert said[0].startswith("01_world：3 个练习中 0 个通过；尚未通过：")  # noqa: RUF001
    for lang, expected in (
        ("en", r"of 2 runs in other rooms expect \d to 2"),
        ("zh", r"再跑 2 次，预计存活 \d 到 2 次"),  # noqa: RUF001
    ):
        said.clear()
        submission.try_out(work, out, 2, said.append, lang=lang, scenarios=("navigation", "comms_dropout"))
        assert [re.match(r"\w+", line)[0] for line in said[2::3]] == ["navigation", "comms_dropout"]
        assert re.search(expected, said[3]), said


def test_submit_without_runs_packs_the_folder_that_grading_takes(tmp_path, monkeypatch, capsys):
    course.write_lessons(tmp_path / "course")
    monkeypatch.chdir(tmp_path)
    assert teaching.submit("s-01", None, None, episodes=0, jobs=1, lang=None) == 0
    assert capsys.readouterr().out.endswith("hand in this folder: submission_s-01\n")
    assert (tmp_path / "submission_s-01" / "manifest.json").exists()


@pytest.mark.parametrize("student", ["", "../x", "a b", "x" * 65])
def test_an_id_that_is_no_id_is_refused(tmp_path, student):
    with pytest.raises(UnusableInput, match="student id"):
        submission.pack(ROOT / "notebooks", student, tmp_path / "out")


def test_a_submission_overwrites_nothing_else(tmp_path):
    (tmp_path / "mine.txt").write_text("work", encoding="utf-8")
    with pytest.raises(UnusableInput, match="no submission"):
        submission.pack(ROOT / "notebooks", "s-01", tmp_path)
