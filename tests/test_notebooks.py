"""Notebook pipeline: same bytes each time, edits come back, parameters are checked, every notebook runs."""

import json
import re
import time

import nbformat
import pytest

from dualnav_lite import execution, notebooks
from dualnav_lite.config import UnusableInput
from dualnav_lite.doctor import LESSON_SPEED, control_speed

SOURCE = """# %% [markdown]
# # A lesson

# %% tags=["parameters"]
seed = 1

# %% [markdown]
# ## 2. 看一看

# %% grade_id="energy" tags=["solution"]
### BEGIN SOLUTION
answer = seed + 1
### END SOLUTION

# %%
with open("answer.txt", "w", encoding="utf-8") as file:
    file.write(str(answer))
"""


@pytest.fixture
def kit(tmp_path):
    """A kit with one lesson in a folder whose name holds Chinese characters and a space."""
    root = tmp_path / "我的 课程"
    source = root / "notebooks" / "src" / "01_lesson.py"
    source.parent.mkdir(parents=True)
    source.write_text(SOURCE, encoding="utf-8")
    notebooks.rebuild(root)
    return root


def test_a_source_makes_the_same_bytes_each_time():
    assert notebooks.to_notebook(SOURCE) == notebooks.to_notebook(SOURCE)


def test_cells_are_named_by_exercise_or_section_and_ordinal():
    cells = json.loads(notebooks.to_notebook(SOURCE))["cells"]
    assert [cell["id"] for cell in cells] == ["a-lesson-1", "a-lesson-2", "2-1", "energy", "2-3"]


def test_a_cell_added_in_one_section_leaves_the_ids_of_others():
    longer = SOURCE.replace("# %% [markdown]\n# ## 2.", "# %%\nseed\n\n# %% [markdown]\n# ## 2.")
    before, after = (json.loads(notebooks.to_notebook(text))["cells"] for text in (SOURCE, longer))
    assert {cell["id"] for cell in after} - {cell["id"] for cell in before} == {"a-lesson-3"}


def test_two_cells_with_one_exercise_id_are_refused():
    with pytest.raises(UnusableInput, match="energy"):
        notebooks.to_notebook(SOURCE + '\n# %% grade_id="energy"\n1\n')


def test_check_names_what_differs_and_changes_nothing(kit):
    assert notebooks.rebuild(kit, check=True) == []
    source, notebook = notebooks.pairs(kit)[0]
    source.write_text(SOURCE.replace("seed = 1", "seed = 2"), encoding="utf-8")
    before = notebook.read_bytes()
    assert notebooks.rebuild(kit, check=True) == [notebook]
    assert notebook.read_bytes() == before
    assert notebooks.rebuild(kit) == [notebook]
    assert notebooks.rebuild(kit, check=True) == []


def test_a_notebook_without_a_source_is_refused(kit):
    (kit / "notebooks" / "src" / "01_lesson.py").unlink()
    with pytest.raises(UnusableInput, match="01_lesson"):
        notebooks.rebuild(kit, check=True)


def test_an_edit_in_jupyterlab_comes_back_and_outputs_do_not(kit):
    source, path = notebooks.pairs(kit)[0]
    opened = nbformat.read(path, as_version=4)
    opened.cells[1].source = "seed = 41"
    opened.cells[1].execution_count = 7
    opened.cells[1].outputs = [nbformat.v4.new_output("stream", text="noise")]
    opened.cells[1].metadata["scrolled"] = True
    opened.metadata["widgets"] = {"state": {}}
    nbformat.write(opened, path)
    assert notebooks.take_back("01", kit) == source
    assert source.read_text(encoding="utf-8") == SOURCE.replace("seed = 1", "seed = 41")
    assert notebooks.rebuild(kit, check=True) == []
    assert "noise" not in path.read_text(encoding="utf-8")


def test_taking_back_an_untouched_notebook_changes_nothing(kit):
    source, path = notebooks.pairs(kit)[0]
    before = source.read_bytes(), path.read_bytes()
    notebooks.take_back("01_lesson.ipynb", kit)
    assert (source.read_bytes(), path.read_bytes()) == before


def edit(path, old, new):
    """Change a text file as an editor, or JupyterLab, would."""
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_a_rebuild_does_not_overwrite_an_edit_made_in_jupyterlab(kit):
    source, path = notebooks.pairs(kit)[0]
    edit(path, "answer = seed + 1", "answer = seed + 2")
    edit(source, "# # A lesson", "# # The lesson")
    before = path.read_bytes()
    with pytest.raises(UnusableInput, match="--take-back 01_lesson"):
        notebooks.rebuild(kit)
    assert path.read_bytes() == before


def test_taking_back_does_not_overwrite_an_edit_of_the_source(kit):
    source, _ = notebooks.pairs(kit)[0]
    edit(source, "answer = seed + 1", "answer = seed + 2")
    before = source.read_bytes()
    with pytest.raises(UnusableInput, match="was edited since"):
        notebooks.take_back("01", kit)
    assert source.read_bytes() == before


def test_outputs_alone_are_no_edit(kit):
    _, path = notebooks.pairs(kit)[0]
    clean = path.read_bytes()
    opened = nbformat.read(path, as_version=4)
    opened.cells[1].outputs = [nbformat.v4.new_output("stream", text="noise")]
    nbformat.write(opened, path)
    assert notebooks.rebuild(kit) == [path]
    assert path.read_bytes() == clean


@pytest.mark.parametrize("name", ["02", "lesson", "01_lesson_two"])
def test_taking_back_a_notebook_that_is_not_there_is_refused(kit, name):
    with pytest.raises(UnusableInput, match="no notebook"):
        notebooks.take_back(name, kit)


def test_taking_back_a_broken_notebook_is_refused_and_the_source_stays(kit):
    source, path = notebooks.pairs(kit)[0]
    path.write_text("{", encoding="utf-8")
    with pytest.raises(UnusableInput, match="01_lesson"):
        notebooks.take_back("01", kit)
    assert source.read_text(encoding="utf-8") == SOURCE


@pytest.mark.parametrize(
    ("parameters", "word"), [({"sede": 1}, "unknown parameter 'sede'"), ({}, "missing parameter 'seed'")]
)
def test_papermill_gets_no_misspelt_and_no_missing_parameter(kit, tmp_path, parameters, word):
    with pytest.raises(UnusableInput, match=word):
        execution.run_notebook(notebooks.pairs(kit)[0][1], tmp_path / "out.ipynb", parameters)


def test_a_notebook_without_a_parameters_cell_is_refused(kit, tmp_path):
    path = kit / "notebooks" / "02_plain.ipynb"
    path.write_text(notebooks.to_notebook("# %%\nseed = 1\n"), encoding="utf-8")
    with pytest.raises(UnusableInput, match="parameters"):
        execution.run_notebook(path, tmp_path / "out.ipynb", {"seed": 2})


def test_papermill_runs_a_notebook_with_the_value_it_was_given(kit):
    out = kit / "results" / "done.ipynb"
    execution.run_notebook(notebooks.pairs(kit)[0][1], out, {"seed": 41})
    assert (out.parent / "answer.txt").read_text(encoding="utf-8") == "42"


REPOSITORY = notebooks.pairs()


@pytest.mark.parametrize("pair", REPOSITORY, ids=lambda pair: pair[1].stem)
def test_every_notebook_is_what_its_source_makes_and_back(pair):
    source, notebook = (path.read_text(encoding="utf-8") for path in pair)
    assert notebook == notebooks.to_notebook(source)
    assert notebooks.to_source(notebooks.opened(pair[1]).cells) == source


@pytest.mark.parametrize("pair", REPOSITORY, ids=lambda pair: pair[1].stem)
def test_every_notebook_is_committed_without_outputs(pair):
    cells = json.loads(pair[1].read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


LESSONS = [path for _, path in REPOSITORY if path.parent.name == "notebooks"]


SECONDS = re.compile(r"\*\*Time\*\*: \d+ minutes for you, (\d+) s of CPU")


def head_of(lesson):
    """The first cell, which says what a lesson asks and what it takes."""
    return "".join(json.loads(lesson.read_text(encoding="utf-8"))["cells"][0]["source"])


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda path: path.stem)
def test_every_lesson_states_aim_time_and_number_and_ends_with_something_to_change(lesson):
    cells = json.loads(lesson.read_text(encoding="utf-8"))["cells"]
    last = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"][-1]
    head = head_of(lesson).replace("\n", " ")
    assert "**Aim**: " in head
    assert SECONDS.search(head)
    assert "**Number to expect**: " in head
    assert "Change this" in last


NUMBER = r"\d+(?:\.\d+)?"


def hold_expectations(executed, pattern):
    """Compare what cells printed with what their comments say: the words exactly, the numbers within 10 %."""
    checked = 0
    for cell in nbformat.read(executed, as_version=4).cells:
        printed = "".join(output.get("text", "") for output in cell.get("outputs", []))
        for expected in re.findall(pattern, cell.source, re.MULTILINE):
            same_words = re.escape(re.sub(NUMBER, "0", expected)).replace("0", f"({NUMBER})")
            found = re.search(same_words, printed)
            assert found, f"expected '{expected}', printed '{printed}'"
            numbers = [float(number) for number in re.findall(NUMBER, expected)]
            assert [float(n) for n in found.groups()] == pytest.approx(numbers, rel=0.1, abs=0.02), printed
            checked += 1
    assert checked


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda path: path.stem)
def test_every_lesson_runs_in_its_short_mode_and_prints_what_it_tells_to_expect(lesson, tmp_path):
    execution.run_notebook(lesson, tmp_path / lesson.name, {"quick": True})
    hold_expectations(tmp_path / lesson.name, r"^# expect: (.+)$")


BY_THE_CLOCK = "11_train"  # trains for as many minutes as it says, however fast the machine is


@pytest.mark.slow
@pytest.mark.parametrize("lesson", [one for one in LESSONS if one.stem != BY_THE_CLOCK], ids=lambda path: path.stem)
def test_every_lesson_takes_at_most_three_times_the_seconds_it_states(lesson, tmp_path):
    resource = pytest.importorskip("resource", reason="processor time of a kernel is counted on Unix alone")

    def spent():
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return children.ru_utime + children.ru_stime

    slowness = LESSON_SPEED / control_speed(clock=time.process_time)
    before = spent()
    execution.run_notebook(lesson, tmp_path / lesson.name, {"quick": False})
    taken, stated = spent() - before, int(SECONDS.search(head_of(lesson).replace("\n", " "))[1])
    assert 0.5 < taken < 3.0 * stated * slowness, f"{taken:.0f} s of CPU, stated {stated} s, machine x {slowness:.2f}"
    hold_expectations(tmp_path / lesson.name, r"^# expect(?: in full)?: (.+)$")


def test_the_lesson_that_trains_by_the_clock_states_its_minutes_and_the_judging():
    lesson = next(one for one in LESSONS if one.stem == BY_THE_CLOCK)
    cells = [cell.source for cell in nbformat.read(lesson, as_version=4).cells]
    minutes = re.search(r"^minutes = [\d.]+ if quick else ([\d.]+)$", "\n".join(cells), re.MULTILINE)
    stated = int(SECONDS.search(head_of(lesson).replace("\n", " "))[1])
    assert 2 * 60 * float(minutes[1]) <= stated <= 2 * 600  # on two cores, ten minutes in all
