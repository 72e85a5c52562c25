import shutil

import pytest

from dualnav_lite.config import ROOT, UnusableInput
from dualnav_lite.drivers import MODEL_FOLDER
from dualnav_lite.episodes import COLUMNS, rows_to_csv
from dualnav_lite.model_card import READMES, policy_lines, write_card, write_readmes
from dualnav_lite.survival import read_episodes


@pytest.fixture
def parts(tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    shutil.copy(MODEL_FOLDER / "ppo_actor.onnx", models)
    for name in READMES:
        shutil.copy(ROOT / name, tmp_path)
    log, rows = tmp_path / "log.csv", tmp_path / "episodes.csv"
    log.write_text("stage,step,reached,round\nimitate,16,0.5,0\nimitate,32,0.75,1\nppo,960,0.9,\n", encoding="utf-8")
    numbers = {
        "scenario": "pop_up",
        "arm": "ppo",
        "steps": 10,
        "time_s": 1.0,
        "path_m": 1.0,
        "min_clearance_m": 0.25,
        "energy_j": 30.0,
    }
    episodes = [
        dict.fromkeys(COLUMNS)
        | numbers
        | {"scenario": "pop_up", "arm": "ppo", "seed": 1_000_000 + k, "outcome": outcome}
        for k, outcome in enumerate(["goal", "goal", "goal", "hit_box"])
    ]
    rows.write_bytes(rows_to_csv(episodes))
    return models, log, rows


def test_the_card_says_what_files_log_and_rows_hold(parts):
    models, log, rows = parts
    (models / "ablations").mkdir()
    shutil.copy(models / "ppo_actor.onnx", models / "ablations" / "ablation_default.onnx")
    text = write_card("training/record.yaml", log, rows, "abc1234", 31.6, models, models.parent).read_text(
        encoding="utf-8"
    )
    assert "stage `imitate`: 32 labels; the last ones reached 75%" in text
    assert "stage `ppo`: 960 steps; the last ones reached 90%" in text
    assert "| pop_up | ppo | 3 of 4 | 19.4% to 99.4% | 0.25 | 30 |" in text  # Clopper-Pearson, from a table
    assert "commit abc1234, 32 minutes" in text
    assert "`ppo_actor.onnx`" in text
    assert "`ppo_critic.pth`" not in text  # is not there
    assert "one training each | at most 2.28 | 1 file |" in text
    assert "| Pop-up obstacle | 92% | 3 of 4 | 19.4% to 99.4% |" in (models.parent / "README.md").read_text("utf-8")
    assert "| 突现障碍 | 92% | 4 次中 3 次 |" in (models.parent / "README.zh-CN.md").read_text("utf-8")


def test_the_readmes_say_what_the_committed_rows_hold(tmp_path):
    for name in READMES:
        shutil.copy(ROOT / name, tmp_path)
    write_readmes(read_episodes(ROOT / "stress_tests" / "reference" / "policy_tuning.csv.gz"), tmp_path)
    for name in READMES:
        assert (tmp_path / name).read_bytes() == (ROOT / name).read_bytes()


def test_a_readme_without_the_marks_is_named(parts, tmp_path):
    (tmp_path / "README.md").write_text("nothing", encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"README\.md: no "):
        write_readmes(read_episodes(parts[2]), tmp_path)


def test_a_missing_file_is_named(parts, tmp_path):
    models, log, _ = parts
    with pytest.raises(UnusableInput, match=r"nothing\.csv: no such file"):
        write_card("training/record.yaml", log, tmp_path / "nothing.csv", "abc", 1, models, tmp_path)


def test_the_committed_card_is_what_the_committed_tables_make():
    committed = (MODEL_FOLDER / "README.md").read_text(encoding="utf-8")
    rows = read_episodes(ROOT / "stress_tests" / "reference" / "policy_tuning.csv.gz")
    assert "\n".join(policy_lines(rows)) + "\n" == committed[committed.index("\n## The filter") :]
