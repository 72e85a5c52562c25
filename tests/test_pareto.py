"""Fronts against points counted by hand; rows to tables against rows counted by hand."""

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from dualnav_lite import pages
from dualnav_lite.commands.suite import show_stress
from dualnav_lite.config import UnusableInput
from dualnav_lite.episodes import COLUMNS
from dualnav_lite.judge import beside_claim, bounds, joined, judge, published_rows
from dualnav_lite.metrics import bootstrap_rate
from dualnav_lite.pareto import (
    front,
    hypervolume,
    on_front,
    pareto,
    pareto_episodes,
    reference_point,
    safe_distance,
    trade,
)
from dualnav_lite.report import HEADER, PAIRED_HEADER, frame_texts, latex, markdown, survival_lines, terminal_lines
from dualnav_lite.survival import rows_of


def rows(*episodes):
    """Rows from (scenario, arm, seed, outcome, further columns)."""
    full = []
    for scenario, arm, seed, outcome, *more in episodes:
        row = dict.fromkeys(COLUMNS) | {"scenario": scenario, "arm": arm, "seed": seed, "outcome": outcome}
        row |= {"steps": 10, "preference": 0.5, "min_clearance_m": 0.3, "energy_j": 200.0, "path_m": 5.0}
        full.append(row | (more[0] if more else {}))
    return rows_of(full)


def point(arm, preference, safe, energy, seeds=range(4), **more):
    values = {"preference": preference, "min_clearance_m": safe, "energy_j": energy}
    return [("pop_up", arm, seed, "goal", values | more) for seed in seeds]


def test_the_article_s_own_table_has_one_point_on_its_front():
    # Article 5.1 marks (0.31 m, 22.7 J) optimal; (0.42 m, 18.3 J) is better in both.
    assert on_front([[0.42, 18.3], [0.31, 22.7], [0.25, 35.1], [0.38, 29.5]]).tolist() == [True, False, False, False]


def test_fronts_keep_equal_points_and_leave_out_what_reached_no_goal():
    assert on_front([[0.3, 100], [0.3, 100], [0.3, 120], [0.9, np.inf]]).tolist() == [True, True, False, False]
    assert on_front(np.zeros((0, 2))).tolist() == []


def test_hypervolume_is_the_area_worked_out_by_hand():
    # (0.2 m, 300 J) covers 0.2 x 700; (0.4 m, 600 J) adds 0.2 x 400.
    assert hypervolume([[0.2, 300], [0.4, 600], [0.1, np.inf]], (0.0, 1000.0)) == pytest.approx(140 + 80)
    assert hypervolume([[0.2, 1200]], (0.0, 1000.0)) == 0.0


def test_a_collision_has_no_clearance_and_its_energy_still_counts():
    some = rows(
        ("pop_up", "ppo", 0, "goal", {"min_clearance_m": 0.4, "energy_j": 300.0}),
        ("pop_up", "ppo", 1, "hit_box", {"min_clearance_m": 0.1, "energy_j": 100.0}),
    )
    assert safe_distance(some).tolist() == [0.4, 0.0]
    row = pareto(some).iloc[0]
    assert (row.safe_dist_m, row.energy_j_per_goal, row.survival_rate, row.episodes) == (0.2, 400.0, 0.5, 2)
    assert row.pareto_optimal
    assert row.hypervolume_share == pytest.approx(1.0)


def test_dominance_never_reaches_across_scenarios():
    some = rows(*point("ppo", 0.5, 0.1, 500.0), ("crowd_crossing", "ppo", 0, "goal", {"min_clearance_m": 0.9}))
    assert pareto(some).pareto_optimal.all()


def test_the_front_table_counts_each_arm_s_share_and_bounds_it():
    some = rows(*point("a", 0.0, 0.4, 400.0), *point("a", 1.0, 0.2, 200.0), *point("b", 0.5, 0.1, 300.0))
    table = front(some, draws=50).set_index("arm")
    assert table.share_on_front.to_dict() == {"a": 1.0, "b": 0.0}
    assert table.hypervolume["a"] == pytest.approx(0.2 * 800 + 0.2 * 600)
    assert (table.low <= table.share_on_front).all()
    assert (table.high >= table.share_on_front).all()
    assert table.reference_point.tolist() == ["0 m; 1000 J"] * 2


def test_an_uncertain_front_has_a_wide_interval_and_one_seed_of_training_too_many_is_seen():
    noise = np.random.default_rng(1)
    episodes = []
    for arm in ("a", "b"):
        for seed in range(12):
            episodes += point(arm, 0.5, float(noise.uniform(0.1, 0.5)), 300.0, [seed])
    table = front(rows(*episodes), draws=200).set_index("arm")
    assert (table.low == 0).all()
    assert (table.high == 1).all()


def test_what_a_preference_trades_is_held_against_itself_on_the_same_seeds():
    episodes = []
    for seed, room in enumerate(np.random.default_rng(1).uniform(0.2, 0.5, 40)):  # seeds differ more than preferences
        for preference in (0.0, 0.5, 1.0):
            episodes += point("a", preference, room - 0.1 * preference, 300 - 40 * preference + 100 * room, [seed])
        episodes += point("b", 0.3, room, 300.0, [seed])  # ran none of the preferences that are compared
    table = trade(rows(*episodes), draws=200)
    assert set(table.arm) == {"a"}
    assert list(zip(table.preference_a, table.preference_b, strict=True))[::2] == [(0.0, 0.5), (0.5, 1.0), (0.0, 1.0)]
    whole = table[table.preference_b - table.preference_a == 1.0].set_index("measure")
    assert whole.difference.to_dict() == pytest.approx({"safe_dist_m": -0.1, "energy_j_per_goal": -40.0})
    assert (whole.high - whole.low).to_dict() == pytest.approx({"safe_dist_m": 0.0, "energy_j_per_goal": 0.0}, abs=1e-9)
    assert set(table.n) == {40}
    broken = [("pop_up", "a", 0, "hit_box", {"preference": p}) for p in (0.0, 1.0)]
    assert trade(rows(*broken), draws=5).set_index("measure").difference.isna()["energy_j_per_goal"]


def test_two_levels_of_resampling_are_wider_than_one():
    agree = np.tile([1.0, 0.0], (4, 50))
    differ = np.repeat([[1.0], [0.0], [1.0], [0.0]], 100, axis=1)
    assert bootstrap_rate(agree)[0] == bootstrap_rate(differ)[0] == 0.5
    widths = [high - low for _, low, high in map(bootstrap_rate, (agree, differ))]
    assert widths[0] == pytest.approx(2 * 1.96 * np.sqrt(0.25 / 100), rel=0.1)
    assert widths[1] > 0.7
    assert bootstrap_rate(agree) == bootstrap_rate(agree)


def test_the_article_s_view_flags_runs_within_scenario_and_arm():
    some = rows(*point("a", 0.5, 0.4, 400.0, [0]), *point("a", 0.5, 0.2, 500.0, [1]), *point("b", 0.5, 0.1, 900.0, [2]))
    table = pareto_episodes(some)
    assert table.pareto_optimal.tolist() == [True, False, True]


def test_the_reference_point_is_committed_and_a_wrong_file_is_named(tmp_path):
    assert reference_point("pop_up") == (0.0, 1000.0)
    path = tmp_path / "point.yaml"
    path.write_text("default: {safe_dist_m: 0.0}\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match="energy_j_per_goal"):
        reference_point("pop_up", path)
    path.write_text("default: {safe_dist_m: 0.0, energy_j_per_goal: much}\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"point\.yaml: energy_j_per_goal: .*got 'much'"):
        reference_point("pop_up", path)


MEASURED = rows(
    *[("pop_up", "ppo", seed, "goal" if seed < 9 else "hit_box") for seed in range(10)],
    *[("pop_up", "ppo_filter", seed, "goal") for seed in range(10)],
    ("battery", "ppo", 0, "survived", {"contacts": 2, "goals": 540}),
)
PUBLISHED = rows(
    *[("pop_up", "ppo", seed, "timeout") for seed in range(10)],  # measured anew, so it does not count
    *[("pop_up", "ceiling", seed, "goal") for seed in range(20)],
    *[("pop_up", "straight", seed, "hit_box") for seed in range(10)],
    *[("pop_up", "crawl", seed, "goal" if seed < 2 else "timeout") for seed in range(10)],
    ("low_light", "ceiling", 0, "goal"),
)


def test_published_arms_are_joined_by_seed_and_never_in_place_of_measured_ones():
    found = joined(MEASURED, PUBLISHED)
    assert set(found.arm) == {"ceiling", "straight", "crawl"}
    assert set(found.scenario) == {"pop_up"}
    assert found.seed.max() == 9


def test_every_table_is_a_function_of_rows():
    tables = judge(MEASURED, PUBLISHED)
    table = tables["survival"]
    assert set(table[table.source == "published"].arm) == {"ceiling", "straight", "crawl"}
    ppo = table[(table.arm == "ppo") & (table.scenario == "pop_up")].iloc[0]
    assert (ppo.survived, ppo.episodes, ppo.article_claim) == (9, 10, 0.92)
    beside = bounds(table, "pop_up")
    assert beside["blind"].arm == "crawl"
    assert beside["ceiling"].survival_rate == 1.0
    assert "floor" not in beside
    assert tables["survival_strict"].survived.tolist() == [0]
    pairs = tables["paired"].set_index("arm_b")
    assert (pairs.arm_a == "ppo").all()
    assert (pairs.only_a["crawl"], pairs.only_b["crawl"], pairs.both["crawl"]) == (7, 0, 2)
    again = judge(MEASURED.sample(frac=1, random_state=0), PUBLISHED.sample(frac=1, random_state=0))
    for name in ("survival", "paired", "outcomes"):
        pd.testing.assert_frame_equal(again[name].reset_index(drop=True), tables[name].reset_index(drop=True))


def test_ablations_are_held_against_their_default_alone():
    trained = [
        ("pop_up", f"ablation_{name}", seed, "goal" if seed < survived else "hit_box")
        for name, survived in (("default", 8), ("motion_none", 5))
        for seed in range(10)
    ]
    tables = judge(pd.concat([MEASURED, rows(*trained)], ignore_index=True), PUBLISHED)
    plain = judge(MEASURED, PUBLISHED)
    for name in ("survival", "survival_strict", "paired", "outcomes"):
        pd.testing.assert_frame_equal(tables[name], plain[name])
    assert "ablations" not in plain
    assert tables["ablations"].set_index("arm").survived.to_dict() == {
        "ablation_default": 8,
        "ablation_motion_none": 5,
    }
    (pair,) = tables["ablations_paired"].itertuples()
    assert (pair.arm_a, pair.arm_b, pair.only_a) == ("ablation_default", "ablation_motion_none", 3)
    alone = judge(rows(*trained), PUBLISHED)
    assert set(alone["survival"].arm) > {
        "ablation_default",
        "ablation_motion_none",
    }  # asked for by name: they stand there
    assert len(judge(rows(*trained[10:]), PUBLISHED)["ablations_paired"]) == 0


def test_several_training_seeds_get_a_row_of_their_own():
    trained = [("pop_up", "ppo", seed, "goal", {"training_seed": t}) for t in range(3) for seed in range(5)]
    table = judge(rows(*trained), published_rows())["training_seeds"]
    assert table.training_seeds.tolist() == [3]
    assert table.survival_rate.tolist() == [1.0]


def test_a_claim_is_beaten_or_missed_only_with_certainty():
    def row(survived, episodes, claim):
        wins = [("pop_up", "ppo", s, "goal" if s < survived else "timeout") for s in range(episodes)]
        return judge(rows(*wins), published_rows())["survival"].assign(article_claim=claim).iloc[0]

    assert beside_claim(row(50, 50, 0.92)) == "beaten"  # at least 92.9 %
    assert beside_claim(row(48, 50, 0.92)) == "open"
    assert beside_claim(row(10, 10, 1.0)) == "open"
    assert beside_claim(row(9, 10, 1.0)) == "missed"
    assert beside_claim(row(20, 50, 0.92)) == "missed"
    assert beside_claim(row(9, 10, np.nan)) is None


def test_the_report_names_bounds_claims_failures_and_published_arms_in_two_languages(tmp_path):
    tables = judge(MEASURED, PUBLISHED)
    paths = pages.write_report(tmp_path, tables, "a command", [("low_light", "RuntimeError: <dark>")])
    assert [path.name for path in paths] == ["report.md", "report.html", "report.zh.md", "report.zh.html"]
    english, page, chinese, chinese_page = (path.read_text(encoding="utf-8") for path in paths)
    for part in (
        "`low_light`: RuntimeError: <dark>",
        "20 % crawl",
        "92 %",
        "published arms",
        "2 contacts in all",
        "of 10 of these seeds",
    ):
        assert part.lower() in english.lower(), part
    assert "RuntimeError: &lt;dark&gt;" in page
    assert "prefers-color-scheme:dark" in page
    for text in (chinese, chinese_page):
        assert "突现障碍" in text
        assert "最好的盲驾方案" in text
        assert not re.search(r"\b(survived|clearance|beaten|furniture|to)\b", text.partition("`a command`")[2])
        assert re.search(r"[+-]\d+\.\d 至 [+-]\d+\.\d", text)
    assert re.search(r"[+-]\d+\.\d to [+-]\d+\.\d", english)
    assert len(survival_lines(tables["survival"])) == 2 + 3


def test_both_languages_of_the_report_have_the_same_texts_with_the_same_gaps():
    english, chinese = pages.TEXTS["en"], pages.TEXTS["zh"]
    assert list(english) == list(chinese)
    for name, text in english.items():
        assert set(re.findall(r"{\w+}", text)) == set(re.findall(r"{\w+}", chinese[name])), name
    assert {*HEADER, *PAIRED_HEADER} - {"a", "b", "a - b"} == set(pages.HEADS)


def test_the_screen_shows_what_a_rate_is_read_beside_in_a_hundred_columns():
    tables = judge(MEASURED, PUBLISHED)
    lines = terminal_lines(tables["survival"], tables["survival_strict"])
    assert "Pop-up obstacle: article 92 %, best blind arm 20 % (crawl), ceiling 100.0 %" in lines
    assert any(line.split()[:5] == ["ppo", "9", "/", "10", "90.0"] and line.endswith("open") for line in lines)
    assert any(line.endswith("without any contact") for line in lines)
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize(
    ("survived", "word"), [(50, "is beaten"), (48, "is not beaten with certainty"), (20, "is missed")]
)
def test_the_report_tells_a_claim_that_is_missed_from_one_left_open(survived, word):
    wins = [("pop_up", "ppo", s, "goal" if s < survived else "timeout") for s in range(50)]
    tables = judge(rows(*wins), published_rows())
    tables["survival"]["article_claim"] = 0.92
    text = pages.as_markdown(pages.blocks(tables, "", []), "en")
    assert f"the article's 92 % {word}." in text


def test_a_claim_of_all_is_met_and_not_beaten():
    wins = [("pop_up", "ppo", s, "goal") for s in range(50)]
    tables = judge(rows(*wins), published_rows())
    tables["survival"]["article_claim"] = 1.0
    text = pages.as_markdown(pages.blocks(tables, "", []), "en")
    assert "the article's 100 % is met by these runs" in text
    assert "beats 0 with certainty" in text
    assert any(line.endswith("met so far") for line in terminal_lines(tables["survival"]))


def test_tables_as_text_keep_columns_in_line_and_print_in_latex_as_they_are():
    lines = markdown(("arm", "rate"), [("a_b", "9 %"), ("c", "100 %")])
    assert len({len(line) for line in lines}) == 1
    assert lines[1] == "| --- | ----: |"
    text = latex(("arm", "rate"), [("a_b", "9 %")], "50 % & more", "x")
    assert r"a\_b & 9 \% \\" in text
    assert r"\caption{50 \% \& more}" in text
    assert text.count("{") == text.count("}")
    twice = latex(("scenario", "rate"), [("pop_up", "1"), ("pop_up", "2"), ("b", "3")], "", "x")
    assert twice.count(r"pop\_up") == 1
    assert set(frame_texts("front", pd.DataFrame({"arm": ["a"], "share": [0.123456]}))) == {"front.tex", "front.md"}
    assert "0.1235" in frame_texts("front", pd.DataFrame({"arm": ["a"], "share": [0.123456]}))["front.md"]
    assert text.index(r"\toprule") < text.index(r"\midrule") < text.index(r"\bottomrule")


@pytest.mark.parametrize(("arm", "survived", "code"), [("ppo", 20, 1), ("ppo", 50, 0), ("crawl", 20, 0)])
def test_a_policy_that_misses_the_article_s_rate_ends_the_command_with_one(arm, survived, code, capsys):
    wins = [("pop_up", arm, s, "goal" if s < survived else "timeout") for s in range(50)]
    plan = SimpleNamespace(out="results", shard="1/1")
    assert show_stress(plan, judge(rows(*wins), published_rows()), []) == code
    assert "article 92 %" in capsys.readouterr().out
