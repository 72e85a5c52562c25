"""The page of the tables beyond our own world says what the CSVs beside it say."""

import shutil

import pandas as pd
import pytest

from dualnav_lite.beyond.page import BLOCK, COLUMNS, PAGE, table_lines, write_page
from dualnav_lite.beyond.tables import TABLES
from dualnav_lite.config import UnusableInput
from dualnav_lite.judge import REFERENCE

FOLDER = REFERENCE / "beyond"


def test_the_committed_page_holds_every_table_as_its_csv_has_it(tmp_path):
    committed = (FOLDER / PAGE).read_text(encoding="utf-8")
    assert {name for _, name, _ in BLOCK.findall(committed)} == set(TABLES) == set(COLUMNS)
    copy = tmp_path / "另外的 世界"
    shutil.copytree(FOLDER, copy)
    write_page(copy)
    assert (copy / PAGE).read_text(encoding="utf-8") == committed


def test_a_new_row_comes_onto_the_page_and_the_sentences_stay(tmp_path):
    page = tmp_path / PAGE
    page.write_text("Before.\n\n<!-- onboard.csv -->\n<!-- end -->\n\nAfter.\n", encoding="utf-8")
    row = {"scenario": "low_light", "frames": 9, "frames_per_s": 50.4, "p50_ms": 7.04, "p99_ms": None}
    pd.DataFrame([row | {"most_different": 0, "folder_mb": 3.0}]).to_csv(tmp_path / "onboard.csv", index=False)
    write_page(tmp_path)
    text = page.read_text(encoding="utf-8")
    assert text.startswith("Before.\n\n<!-- onboard.csv -->\n\n| scenario ")
    assert [cell.strip() for cell in text.splitlines()[6].split("|")[1:-1]] == [
        "low_light",
        "9",
        "50",
        "7.0",
        "",
        "0",
        "3.0",
    ]
    assert text.endswith("\n<!-- end -->\n\nAfter.\n")


def test_a_block_without_its_table_is_named_and_a_folder_without_a_page_is_left_alone(tmp_path):
    assert write_page(tmp_path) is None
    (tmp_path / PAGE).write_text("<!-- parking.csv -->\n<!-- end -->\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"parking\.csv"):
        write_page(tmp_path)


def test_what_is_not_there_is_empty():
    row = dict.fromkeys(["arm", "training_seed", "preference", "arrived_rate", "wilson_low", "wilson_high"])
    lines = table_lines("streets", pd.DataFrame([row | {"mean_excess": 0.5, "excess_low": 0.25, "excess_high": 0.75}]))
    assert lines[2].split("|")[-2].strip() == "50.00% [25.00%, 75.00%]"
