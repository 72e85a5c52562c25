import numpy as np
import pandas as pd
import pytest

from dualnav_lite.config import ROOT
from dualnav_lite.study_tables import read_studies, stability, studies_page, study_lines, summarise


def test_summary_by_hand():
    rows = pd.DataFrame(
        [["s", "a", seed, "navigation", rate] for seed, rate in enumerate([0.5, 0.7, 0.9])]
        + [["s", "b", 0, "navigation", 0.4]],
        columns=["study", "variant", "training_seed", "scenario", "survival_rate"],
    )
    a, b = summarise(rows).itertuples()
    assert (a.runs, b.runs) == (3, 1)
    assert a.mean_rate == pytest.approx(0.7)
    assert a.coefficient_of_variation == pytest.approx(0.2 / 0.7)
    assert a.low == pytest.approx(0.7 - 4.302653 * 0.2 / np.sqrt(3))  # t of two degrees of freedom, from a table
    assert np.isnan(b.low)


def study(rates, name="s", scenario="navigation"):
    """Rows of a study from variant -> rates by training seed."""
    numbers = {"study": name, "scenario": scenario, "episodes": 200}
    return pd.DataFrame(
        numbers | {"variant": variant, "training_seed": seed, "survival_rate": rate}
        for variant, values in rates.items()
        for seed, rate in enumerate(values)
    )


def test_a_difference_is_taken_training_seed_by_training_seed():
    a, b = summarise(study({"a": [0.5, 0.7, 0.9], "b": [0.4, 0.6, 0.8]})).itertuples()
    assert np.isnan(a.difference)
    assert (b.difference, b.difference_low, b.difference_high) == pytest.approx((-0.1, -0.1, -0.1))
    _, other = summarise(study({"a": [0.5], "b": [0.4]})).itertuples()
    assert other.difference == pytest.approx(-0.1)
    assert np.isnan(other.difference_low)
    assert study_lines(study({"a": [0.5], "b": [0.4]}))[3].split("|")[2].strip() == "40.0; -10.0"


def test_stability_is_the_fall_of_the_coefficient_of_variation():
    wide, narrow = [0.4, 0.5, 0.6], [0.45, 0.5, 0.55]
    table = stability(study({"gae_015": wide, "gae_020": wide, "returns_015": narrow, "returns_020": wide}))
    found = table.set_index("question")
    assert found.difference["article_choice"] == pytest.approx(0.5)  # 0.05 / 0.5 beside 0.1 / 0.5
    assert found.difference["returns"] == pytest.approx(0.25)
    assert found.difference["clip_015"] == pytest.approx(0.25)
    assert (found.low <= found.difference + 1e-12).all()
    assert set(found.n) == {3}


def test_stability_claims_nothing_where_seeds_agree_by_chance():
    noise = np.random.default_rng(0)
    variants = ("gae_015", "gae_020", "returns_015", "returns_020")
    found = stability(study({variant: noise.uniform(0.3, 0.7, 10) for variant in variants})).set_index("question")
    assert found.low["article_choice"] < 0 < found.high["article_choice"]


def test_the_committed_page_is_what_the_read_studies_make():
    committed = (ROOT / "docs" / "STUDIES.md").read_text(encoding="utf-8")
    assert committed == studies_page(read_studies()), "run `python kit.py claims`"


def test_the_page_gives_each_study_its_question_and_its_command():
    page = studies_page(study({"with": [0.9, 0.8], "without": [0.7, 0.7]}, "cache"))
    assert "What is the cached, re-projected map worth" in page
    assert "`python kit.py study cache`, 2 training seeds, 200 episodes a scenario." in page
    assert "-15.0 (" in page
