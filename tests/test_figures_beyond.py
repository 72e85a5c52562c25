"""Figures of studies and from beyond the own world: from their tables, in both languages, not in other reports."""

import numpy as np
import pandas as pd
import pytest

from dualnav_lite import figures
from dualnav_lite.beyond.algorithms import COLUMNS as ALGORITHM_COLUMNS
from dualnav_lite.beyond.fleet_drive import COLUMNS as FLEET_COLUMNS
from dualnav_lite.beyond.highway_agent import COLUMNS as HIGHWAY_COLUMNS
from dualnav_lite.config import UnusableInput
from dualnav_lite.figures.results import APART, make_result_figures
from dualnav_lite.study_tables import COLUMNS as STUDY_COLUMNS

has_chinese_font = bool(set(figures.CHINESE_FONTS) & {f.name for f in figures.font_manager.fontManager.ttflist})
LANGUAGES = ["en", pytest.param("zh", marks=pytest.mark.skipif(not has_chinese_font, reason="no Chinese font"))]


def table(columns, rows):
    """Rows with what they name, and numbers that rise in every other column."""
    ramp = {name: np.linspace(0.2, 0.8, len(rows)) for name in columns}
    return pd.DataFrame(ramp)[columns].assign(**{name: [row[name] for row in rows] for name in rows[0]})


TABLES = {
    "traffic": table(
        HIGHWAY_COLUMNS,
        [{"arm": "follower", "training_seed": np.nan, "preference": 0.5}]
        + [{"arm": "ppo", "training_seed": 0, "preference": p} for p in (0.0, 0.5, 1.0)],
    ),
    "fleet": table(FLEET_COLUMNS, [{"robots": n, "cross_weight": w} for n in (2, 3) for w in (0.0, 0.3)]),
    "studies": table(
        STUDY_COLUMNS,
        [
            {"study": "cache", "variant": v, "training_seed": t, "scenario": s}
            for v in ("with", "without")
            for t in (0, 1)
            for s in ("navigation", "comms_dropout")
        ],
    ),
    "algorithms": table(ALGORITHM_COLUMNS, [{"algorithm": a} for a in ("ppo", "dqn", "sac") for _ in range(2)]),
}


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_table_has_its_figure_and_caption(language, tmp_path):
    assert set(TABLES) == set(APART)
    for name, rows in TABLES.items():
        rows.to_csv(tmp_path / f"{name}.csv", index=False)
    written = make_result_figures(tmp_path, language, ("png",), reference=tmp_path / "nowhere", names=list(TABLES))
    assert len(written) == len(TABLES)
    assert all(path.stat().st_size > 5_000 for path in written)
    ending = ".zh" if language == "zh" else ""
    captions = (tmp_path / "figures" / f"captions{ending}.md").read_text(encoding="utf-8")
    assert all(f"**{name}.**" in captions for name in TABLES)


def test_a_report_of_stress_scenarios_does_not_draw_them(tmp_path):
    (tmp_path / "reference" / "beyond").mkdir(parents=True)
    TABLES["fleet"].to_csv(tmp_path / "reference" / "beyond" / "fleet.csv", index=False)
    (tmp_path / "results").mkdir()
    settings = {"formats": ("png",), "reference": tmp_path / "reference"}
    drawn = {path.stem for path in make_result_figures(tmp_path / "results", **settings)}
    assert not drawn & set(APART)
    (asked,) = make_result_figures(tmp_path / "results", names=["fleet"], **settings)
    assert asked.stem == "fleet"


def test_studies_of_one_training_seed_have_no_figure_and_say_so(tmp_path):
    TABLES["studies"].query("training_seed == 0").to_csv(tmp_path / "studies.csv", index=False)
    settings = {"formats": ("png",), "reference": tmp_path / "nowhere"}
    with pytest.raises(UnusableInput, match=r"figure 'studies': studies\.csv holds nothing that it could show"):
        make_result_figures(tmp_path, names=["studies"], **settings)
    assert "studies.png" not in {path.name for path in make_result_figures(tmp_path, **settings)}
