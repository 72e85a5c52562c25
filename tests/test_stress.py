"""The stress runner: papermill per notebook, one table, and a notebook that fails costs only itself."""

import shutil

import pandas as pd
import pytest

from dualnav_lite import notebooks, stress
from dualnav_lite.config import UnusableInput
from dualnav_lite.episodes import SEEDS
from dualnav_lite.survival import read_episodes, survived

TUNING = SEEDS["tuning"].start


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A stress folder that holds one real notebook; the others take minutes."""
    shutil.copy(stress.FOLDER / "01_pop_up.ipynb", tmp_path)
    monkeypatch.setattr(stress, "FOLDER", tmp_path)
    return tmp_path


def run(out):
    return stress.run_stress(["stand_still", "straight"], 2, ["straight"], 1, TUNING, 1, out, "a command")


def test_a_run_leaves_rows_a_table_a_report_and_the_executed_notebook(folder, tmp_path):
    (folder / "02_broken.ipynb").write_text(
        notebooks.to_notebook(
            '# %% tags=["parameters"]\narms = []\nepisodes = 1\nseed_base = 1\njobs = 1\nout = ""\n\n# %%\n1 / 0\n'
        ),
        encoding="utf-8",
    )
    out = tmp_path / "结果 一"
    table, failed = run(out)
    assert failed == ["02_broken"]
    assert list(table.arm) == ["stand_still", "straight"]
    assert set(table.seed_first) == {TUNING}
    rows = read_episodes(out / "episodes.csv")
    assert len(rows) == 4
    assert not survived(rows[rows.arm == "stand_still"]).any()
    assert len(pd.read_csv(out / "survival.csv")) == 2
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "02_broken" in report
    assert "Pop-up obstacle" in report
    assert "ZeroDivisionError" in (out / "02_broken.ipynb").read_text(encoding="utf-8")
    assert "image/png" in (out / "01_pop_up.ipynb").read_text(encoding="utf-8")


def test_nothing_to_show_is_an_error_not_an_empty_table(folder, tmp_path):
    (folder / "01_pop_up.ipynb").unlink()
    with pytest.raises(UnusableInput, match="no stress notebook"):
        run(tmp_path / "out")


def test_the_notebooks_ask_for_exactly_what_the_runner_gives():
    import papermill

    for name in stress.notebook_names():
        known = papermill.inspect_notebook(str(stress.FOLDER / f"{name}.ipynb"))
        assert set(known) == {"arms", "episodes", "seed_base", "jobs", "out"}, name
    assert stress.LONG in stress.notebook_names()


def test_every_scenario_of_the_article_has_a_notebook():
    sources = " ".join(path.read_text(encoding="utf-8") for path in stress.FOLDER.glob("src/*.py"))
    for name, scenario in stress.all_scenarios().items():
        if scenario.article_claim is not None or name == "crowd_reactive":
            assert f'"{name}"' in sources, name


def test_the_three_hour_notebook_has_arms_and_a_count_of_its_own(monkeypatch, tmp_path):
    given = {}
    monkeypatch.setattr(stress, "run_notebook", lambda notebook, out, values, _: given.update({notebook.stem: values}))
    with pytest.raises(UnusableInput):
        run(tmp_path)
    assert len(given) == 5
    for name, values in given.items():
        expected = (["straight"], 1) if name == stress.LONG else (["stand_still", "straight"], 2)
        assert (values["arms"], values["episodes"]) == expected, name
