"""The row of an episode and the seeds: text of values, refusals, who may use what."""

from itertools import combinations

import numpy as np
import pytest

from dualnav_lite.episodes import COLUMNS, OUTCOMES, SEEDS, cell_text, rows_to_csv
from dualnav_lite.scenario import all_scenarios
from dualnav_lite.semantics import CONTACT_OUTCOME

EMPTY = dict.fromkeys(COLUMNS) | {"outcome": "goal", "seed": 3, "steps": 1}


def test_seeds_for_training_tuning_publishing_and_grading_are_disjoint():
    for a, b in combinations(SEEDS.values(), 2):
        assert a[-1] < b[0] or b[-1] < a[0]


def test_seed_ranges_are_those_of_the_contract():
    assert (SEEDS["train"][0], SEEDS["train"][-1]) == (0, 999_999)
    assert (SEEDS["tuning"][0], SEEDS["tuning"][-1]) == (1_000_000, 1_099_999)
    assert SEEDS["test"][:1000] == range(2_000_000, 2_001_000)
    assert SEEDS["grading"][0] > 3_000_000_000


def test_each_of_the_articles_five_claims_stands_in_its_scenario():
    claims = {name: scenario.article_claim for name, scenario in all_scenarios().items()}
    article = {"pop_up": 0.92, "crowd_crossing": 0.76, "low_light": 0.89, "battery": 1.0, "comms_dropout": 0.68}
    assert {name: claims[name] for name in article} == article
    assert claims["navigation"] is None


def test_every_contact_has_an_outcome_that_counts_as_a_collision():
    assert {OUTCOMES[outcome] for outcome in CONTACT_OUTCOME.values()} == {"collision"}


@pytest.mark.parametrize(
    ("column", "value", "text"),
    [
        ("time_s", np.float32(0.1), "0.1"),
        ("time_s", 12.3456789, "12.345679"),
        ("r_safe", -1e-9, "0.0"),
        ("min_clearance_m", np.inf, "inf"),
        ("first_event_s", np.nan, ""),
        ("training_seed", None, ""),
        ("seed", np.int64(2**62), "4611686018427387904"),
        ("goals", 3.0, "3"),
        ("reason", "two\nlines é", "two lines \\xe9"),
        ("collided_with", None, ""),
    ],
)
def test_a_value_has_one_text(column, value, text):
    assert cell_text(column, value) == text


def test_bytes_are_the_same_on_every_system():
    content = rows_to_csv([EMPTY])
    assert content.count(b"\r") == 0
    assert content.decode("ascii").splitlines()[1] == ",,,3,,goal" + "," * 3 + ",1" + "," * 16


def test_an_incomplete_row_and_an_unknown_outcome_are_refused():
    with pytest.raises(ValueError, match="goals"):
        rows_to_csv([{name: value for name, value in EMPTY.items() if name != "goals"}])
    with pytest.raises(ValueError, match=r"flew_away.*hit_wall"):
        rows_to_csv([EMPTY | {"outcome": "flew_away"}])
