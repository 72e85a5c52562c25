import shutil

import pytest

from dualnav_lite.config import UnusableInput
from dualnav_lite.deploy import MODEL_FOLDER
from dualnav_lite.episodes import COLUMNS, rows_to_csv
from dualnav_lite.model_card import write_card


@pytest.fixture
def parts(tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    shutil.copy(MODEL_FOLDER / "ppo_actor.onnx", models)
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
    text = write_card("training/record.yaml", log, rows, "abc1234", 31.6, models).read_text(encoding="utf-8")
    assert "stage `imitate`: 32 labels; the last ones reached 75%" in text
    assert "stage `ppo`: 960 steps; the last ones reached 90%" in text
    assert "| pop_up | ppo | 3 of 4 | 19.4% to 99.4% | 0.25 | 30 |" in text  # Clopper-Pearson, from a table
    assert "commit abc1234, 32 minutes" in text
    assert "`ppo_actor.onnx`" in text
    assert "`ppo_critic.pth`" not in text  # is not there


def test_a_missing_file_is_named(parts, tmp_path):
    models, log, _ = parts
    with pytest.raises(UnusableInput, match=r"nothing\.csv: no such file"):
        write_card("training/record.yaml", log, tmp_path / "nothing.csv", "abc", 1, models)
