"""The page of claims: verdicts by hand-made tables, and what is not measured says so."""

import pandas as pd
import pytest

from dualnav_lite.claims import (
    CLAIM_FILE,
    NOT_MEASURED,
    Claim,
    Found,
    all_claims,
    claims_page,
    claims_table,
    find,
    reference_tables,
    verdict,
)
from dualnav_lite.config import ROOT, UnusableInput, read_yaml
from dualnav_lite.figures.results import RESULTS


def a_claim(**values):
    return Claim.model_validate({"claim": "x", "article_text": "…", "article_value": 0.92} | values)


@pytest.mark.parametrize(
    ("wants", "article", "found", "expected"),
    [
        ("above", 0.92, (0.95, 0.93, 0.97), "stands"),
        ("above", 0.92, (0.93, 0.90, 0.96), "open"),
        ("above", 0.92, (0.80, 0.75, 0.85), "falls"),
        ("above", 1.0, (1.0, 0.97, 1.0), "stands"),
        ("above", 1.0, (0.99, 0.97, 1.0), "falls"),
        ("at_most", 2, (2, None, None), "stands"),
        ("at_most", 2, (8, None, None), "falls"),
        ("positive", 0, (0.1, 0.02, 0.2), "stands"),
        ("positive", 0, (0.0, -0.1, 0.1), "open"),
        ("negative", 0, (-0.1, -0.2, -0.02), "stands"),
        ("negative", 0, (0.1, 0.02, 0.2), "falls"),
        ("not_positive", 0, (0.1, 0.02, 0.2), "falls"),
        ("not_positive", 0, (-0.1, -0.2, 0.0), "stands"),
    ],
)
def test_verdicts_follow_from_bounds(wants, article, found, expected):
    value, low, high = found
    assert verdict(a_claim(wants=wants, article_value=article), Found(value=value, low=low, high=high)) == expected


def test_each_source_is_found_in_its_table_and_missing_ones_are_not_measured():
    survival = pd.DataFrame(
        [["pop_up", "ppo", 0.97, 0.95, 0.98, 1000]],
        columns=["scenario", "arm", "survival_rate", "exact_low", "exact_high", "episodes"],
    )
    stages = pd.DataFrame({"stage": ["encode", "policy"], "p99_ms": [0.5, 1.5], "n": [10, 10]})
    points = pd.DataFrame({"scenario": "pop_up", "arm": "ppo", "pareto_optimal": [True, False, False, False]})
    tables = {"survival": survival, "latency": stages, "pareto_episodes": points}
    rate = a_claim(wants="above", rate={"scenario": "pop_up", "arm": "ppo"})
    assert find(rate, tables) == Found(value=0.97, low=0.95, high=0.98, n=1000)
    both = {"from": "latency", "sum_where": {"stage": ["encode", "policy"]}, "value": "p99_ms", "n": "n"}
    assert find(a_claim(wants="at_most", **both), tables) == Found(value=2.0, n=10)
    share = find(a_claim(wants="above", pareto_episodes={"scenario": "pop_up", "arm": "ppo"}), tables)
    assert (share.value, share.n) == (0.25, 4)
    assert find(a_claim(wants="above", rate={"scenario": "pop_up", "arm": "nobody"}), tables) is None
    assert verdict(rate, find(rate, {})) == NOT_MEASURED


def test_the_committed_page_is_what_the_tables_make():
    known = all_claims()
    table = claims_table(known, reference_tables())
    assert (ROOT / "docs" / "CLAIMS.md").read_text(encoding="utf-8") == claims_page(known, table), (
        "run `python kit.py claims`"
    )


def test_claims_quote_the_article_s_rates_and_name_figures_that_exist():
    by_name = {one.claim: one for one in all_claims()}
    for name, value in (("pop_up", 0.92), ("crowd_crossing", 0.76), ("low_light", 0.89), ("comms_dropout", 0.68)):
        assert by_name[name].article_value == value
        assert f"{value:.0%}" in by_name[name].article_text
    assert {one.figure for one in by_name.values()} - {""} <= set(RESULTS)
    assert len(by_name) == len(read_yaml(CLAIM_FILE))


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("- {claim: a, article_text: b, article_value: 1, wants: above, rats: {}}", "unknown key 'rats'"),
        ("claim: a", "list of claims"),
        ("- {claim: a, article_text: b, article_value: 1, wants: above}\n" * 2, "twice"),
    ],
)
def test_a_wrong_claim_file_is_one_clear_line(tmp_path, text, word):
    path = tmp_path / "claims.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UnusableInput, match=word):
        all_claims(path)
