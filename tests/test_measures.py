"""Measurements on a few episodes: the columns of the contract, and what can be known beforehand."""

import gzip
import json

import numpy as np
import pandas as pd
import pytest

from dualnav_lite import drivers
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.encoder import BANDS, read_bands
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import library_arm
from dualnav_lite.figures.captions import CAPTIONS
from dualnav_lite.figures.questions import METHODS
from dualnav_lite.figures.results import APART, RESULTS, make_result_figures
from dualnav_lite.judge import made_from, published_rows
from dualnav_lite.measures import failures
from dualnav_lite.measures.adversary import PERTURBATIONS, Perturbed, search
from dualnav_lite.measures.failures import FAILURE_COLUMNS, SETTINGS, failure_search
from dualnav_lite.measures.intervention import COLUMNS as INTERVENTION_COLUMNS
from dualnav_lite.measures.intervention import with_charge
from dualnav_lite.measures.kept import all_kept, kept
from dualnav_lite.measures.latency import LATENCY_COLUMNS, STAGES, first_answer
from dualnav_lite.measures.perturb import FRONT_COLUMNS
from dualnav_lite.measures.sweep import VALUES, knob
from dualnav_lite.measures.tables import MEASURES, Options, run
from dualnav_lite.publish import blocks, publish
from dualnav_lite.scenario import load_scenario
from dualnav_lite.survival import survived

TUNING = SEEDS["tuning"].start


def options(out, **more):
    return Options(out=out, seed_base=TUNING, **({"episodes": 2} | more))


def test_the_sweep_gives_each_arm_eleven_points_and_the_knob_stands_in_preference(tmp_path):
    tables = run("front", options(tmp_path, episodes=1, arms=["astar"], scenarios=["pop_up"]))
    points = tables["pareto"]
    assert len(points) == VALUES
    assert points.preference.tolist() == pytest.approx(np.linspace(0, 1, VALUES))
    assert set(points.arm) == {"astar"}
    assert (tmp_path / "front.csv").exists()
    assert knob("astar", 0.5) == "astar@max_speed=0.525"
    with pytest.raises(UnusableInput, match="turns the knob itself"):
        run("front", options(tmp_path, arms=["astar@max_speed=0.5"]))


def test_the_battery_band_alone_is_changed():
    observations = np.random.default_rng(0).random((2, 4, 64, 64)).astype(np.float32)
    band = BANDS.index("battery")
    changed = with_charge(observations, 0.15)
    assert read_bands(changed)[:, band] == pytest.approx(0.15)
    differs = np.abs(changed - observations) > 0
    assert differs[:, [0, 1, 3]].sum() == 0
    rows = np.flatnonzero(differs.any(axis=(0, 1, 3)))
    assert len(rows) <= 8
    assert (np.delete(read_bands(changed), band, 1) == np.delete(read_bands(observations), band, 1)).all()


def test_the_intervention_compares_the_same_states_and_seeds(tmp_path):
    table = run("intervention", options(tmp_path, scenarios=["crowd_crossing"]))["intervention"]
    assert (table.low <= table.difference).all()
    assert (table.difference <= table.high).all()
    assert table.difference.to_numpy() == pytest.approx((table.at_15 - table.at_100).to_numpy())
    assert len(table) == 6


def test_latency_has_its_stages_and_a_blind_driver_never_answers(tmp_path):
    tables = run("latency", options(tmp_path, arms=["ppo"]))
    assert list(tables["latency"]) == LATENCY_COLUMNS
    assert tables["latency"].stage.tolist() == [*STAGES, "response_ticks"]
    stages = tables["latency"][tables["latency"].stage != "response_ticks"]
    assert (stages.p50_ms > 0).all()
    assert (stages.p50_ms <= stages.p99_ms).all()
    assert (tables["response_ticks"].ticks >= 1).all()
    _, _, seen, answered, ticks = first_answer("straight", TUNING)
    assert seen > 0
    assert np.isnan([answered, ticks]).all()


def test_commands_are_changed_within_bounds_and_the_hardware_s_limits():
    config = Config()
    driver = library_arm("straight", config)
    assert not Perturbed(driver, (1.0, 0.0, 1.0), config).needs_truth
    infos = [{"goal_robot": np.array([3.0, 0.1])}, {"goal_robot": np.array([0.0, 2.0])}]
    plain = driver.act(None, infos)
    assert Perturbed(driver, (1.0, 0.0, 1.0), config).act(None, infos) == pytest.approx(plain)
    slower = Perturbed(driver, (0.7, -0.05, 1.15), config).act(None, infos)
    assert slower[0] == pytest.approx([0.7 * 0.8 - 0.05, 1.15 * plain[0, 1]])
    assert slower[1, 0] == 0.0  # a robot that turns in place is not pushed forward
    assert abs(slower[1, 1]) <= 1.2
    assert all(low < high for low, high in PERTURBATIONS.values())


@pytest.mark.parametrize("method", ["evolution", "random"])
def test_a_search_keeps_its_budget_and_finds_a_valley(method):
    seen = []

    def loss(x):
        seen.append(np.sum((np.asarray(x) - 0.3) ** 2))
        return seen[-1]

    search(loss, [(0, 1), (0, 1)], 60, 0, method)
    assert 40 <= len(seen) <= 60
    assert min(seen) < 0.05


def test_failures_are_searched_and_run_again_on_fresh_seeds(tmp_path):
    table = failure_search(options(tmp_path, arms=["straight"], scenarios=["crowd_crossing"], episodes=10))
    assert table.method.tolist() == ["evolution", "random"]
    assert (table.failures <= table.episodes).all()
    assert (table.fresh_episodes == 10).all()
    assert table.default_failures_on_fresh.iloc[0] >= 8  # `straight` crosses no crowd
    assert (table.exact_low <= table.fresh_survival_rate).all()
    with pytest.raises(UnusableInput, match=f"no settings of 'low_light' are searched; known: {', '.join(SETTINGS)}"):
        failure_search(options(tmp_path, arms=["straight"], scenarios=["low_light"]))


def test_settings_that_a_fresh_room_cannot_hold_give_way_to_the_next_worst(tmp_path, monkeypatch):
    refused = []

    def episodes_of(folder, scenario, arm, first, count):
        rows = real(folder, scenario, arm, first, count)
        if first == failures.FRESH_SEED and scenario != load_scenario("crowd_crossing") and len(refused) < 2:
            refused.append(scenario)
            raise UnusableInput("no layout fits")
        return rows

    real = failures.episodes_of
    monkeypatch.setattr(failures, "episodes_of", episodes_of)
    monkeypatch.setattr(failures, "EACH", 2)
    row = failures.failures_found(tmp_path, "crowd_crossing", "straight", "random", 8).iloc[0]
    assert len(refused) == 2
    assert not any(f"crowd.speed_m_s {one.crowd.speed_m_s:.3g};" in row.worst_settings for one in refused)
    assert row.fresh_episodes == 8


def test_commands_are_searched_driven_and_the_gain_has_an_interval(tmp_path, monkeypatch):
    from dualnav_lite.measures import perturb

    for name, little in (("EACH", 2), ("WEIGHTS", (0.5,))):
        monkeypatch.setattr(perturb, name, little)
    tables = run("perturb", options(tmp_path, arms=["astar"], scenarios=["pop_up"], episodes=10))
    points, gain = tables["perturbed_front"], tables["perturbed_gain"]
    assert points.groupby("method").size().to_dict() == {"evolution": 5, "none": 1, "random": 5}
    assert points[points.pareto_optimal].fresh_hypervolume.notna().all()
    assert (gain.low <= gain.high).all()
    by_method = points[points.pareto_optimal].groupby("method").fresh_hypervolume.first()
    assert gain.set_index("question").difference["evolution_minus_random"] == pytest.approx(
        by_method["evolution"] - by_method["random"]
    )
    assert (tmp_path / "perturbed_gain.tex").exists()


def test_a_measurement_that_was_stopped_goes_on_and_gives_the_same(tmp_path, monkeypatch):
    made = []

    def part(name, stops=False):
        made.append(name)
        if stops:
            raise KeyboardInterrupt
        return pd.DataFrame({"name": [name], "value": [0.1 + len(name) / 3]})

    def tasks(stops):
        return {name: ([name], lambda name=name: part(name, stops and name == "b")) for name in ("a", "b", "c")}

    with pytest.raises(KeyboardInterrupt):
        all_kept(tmp_path, tasks(True), 1)
    table = all_kept(tmp_path, tasks(False), 1)
    assert made == ["a", "b", "b", "c"]
    assert table.value.tolist() == [0.1 + 1 / 3] * 3
    assert all_kept(tmp_path, tasks(False), 1).equals(table)
    assert len(made) == 4
    kept(tmp_path, "a", ["other"], lambda: part("aa"))  # other settings are another part
    assert made[-1] == "aa"


@pytest.mark.parametrize("name", ["intervention", "latency", "motion", "battery_trace"])
def test_no_episode_of_a_measurement_is_driven_twice(tmp_path, monkeypatch, name):
    from dualnav_lite.measures import adversary, battery_hours, intervention, motion_error
    from dualnav_lite.measures import latency as latency_module

    given = {"arms": ["ppo"], "scenarios": ["crowd_crossing"], "episodes": 1}
    first = run(name, options(tmp_path, **given))

    def twice(*given, **named):
        raise AssertionError("driven twice")

    for module, function in (
        (intervention, "of_scenario"), (latency_module, "first_answer"), (battery_hours, "drive"),
        (adversary, "run_episodes"), (motion_error, "of_episodes"),
    ):  # fmt: skip
        monkeypatch.setattr(module, function, twice)
    again = run(name, options(tmp_path, **given))
    for table in set(first) - {"latency"}:  # wall-clock
        pd.testing.assert_frame_equal(first[table], again[table])


def test_an_unknown_measurement_is_named_with_the_known_ones(tmp_path):
    with pytest.raises(UnusableInput, match=f"unknown measurement 'fronts'; known: {', '.join(MEASURES)}"):
        run("fronts", options(tmp_path))


def test_ablations_need_the_default_that_they_are_held_against(tmp_path, monkeypatch):
    monkeypatch.setattr(drivers, "ABLATION_FOLDER", tmp_path)
    with pytest.raises(UnusableInput, match="ablation_default"):
        run("ablations", options(tmp_path))


def test_published_rows_come_back_with_what_made_them(tmp_path, monkeypatch, capsys):
    from dualnav_lite import publish as module

    small = {"main": (["straight"], ["pop_up"], 2), "rest": (["stand_still"], ["pop_up"], 1)}
    monkeypatch.setattr(module, "blocks", lambda share: small)
    work, to = tmp_path / "work", tmp_path / "to"
    rows = publish(work, to, only=["main"], command="a command")
    said = capsys.readouterr().err
    assert "0 of 1 chunks are there; the rest: about 0.0 hours on 1 processes" in said
    assert "not made yet: rest" in said
    assert len(rows) == 2
    assert list(made_from(to)["blocks"]) == ["main"]
    # Elsewhere, where no chunk of the earlier call is: its block stays, with its own command.
    rows = publish(tmp_path / "other work", to, only=["rest"], command="another command")
    assert len(rows) == 3
    again = published_rows(to)
    pd.testing.assert_frame_equal(again, rows, check_dtype=False)
    made = made_from(to)
    assert [made["blocks"][name]["command"] for name in ("main", "rest")] == ["a command", "another command"]
    assert set(made) >= {"config", "policy_sha256"}
    assert set(made["blocks"]["main"]) >= {"commit", "cpu_flags", "code_sha256"}
    first = (to / "episodes.csv.gz").read_bytes()
    # Rows of other settings do not stay: nobody would know which belong together.
    (to / "episodes.json").write_text(json.dumps(made | {"config_sha256": "0"}), encoding="utf-8")
    assert len(publish(tmp_path / "third work", to, only=["rest"], command="a command")) == 1
    publish(work, to, only=["rest"], command="a command")  # finds its chunks of `main`
    monkeypatch.setattr(module, "evaluate", lambda *given, **named: None)  # everything is there
    publish(work, to, command="a command")
    assert "2 of 2 chunks are there" in capsys.readouterr().err
    assert (to / "episodes.csv.gz").read_bytes() == first
    assert gzip.decompress(first).startswith(b"scenario,arm,")
    assert pd.read_csv(to / "survival.csv").arm.tolist() == ["stand_still", "straight"]
    assert "`a command`" in (to / "report.md").read_text(encoding="utf-8")
    with pytest.raises(UnusableInput, match="unknown block"):
        publish(work, to, only=["all"])
    assert {name: count for name, (_, _, count) in blocks().items()}["main"] == 1000


@pytest.mark.slow
def test_published_rows_run_again_are_the_same_outcomes(tmp_path):
    from dualnav_lite.evaluate import evaluate
    from dualnav_lite.publish import cpu_flags

    rows = published_rows()
    rows = rows[(rows.arm == "ppo") & (rows.seed < SEEDS["test"].start + 50)]
    rows = rows[rows.scenario.isin(["pop_up", "crowd_crossing", "low_light", "comms_dropout"])]
    if rows.empty:
        pytest.skip("nothing is published yet")
    again = evaluate(["ppo"], sorted(rows.scenario.unique()), sorted(rows.seed.unique()), tmp_path, progress=False)
    both = rows.merge(again, on=["scenario", "seed"], suffixes=("", "_again"))
    assert len(both) == len(rows)
    assert (both.outcome == both.outcome_again).mean() >= 0.95
    if made_from()["blocks"]["main"]["cpu_flags"] == cpu_flags():
        assert (both.outcome == both.outcome_again).all()
        assert (both.energy_j == both.energy_j_again).all()


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """A folder with small tables for every figure that is drawn from one."""
    folder, noise = tmp_path_factory.mktemp("表 格"), np.random.default_rng(0)
    from dualnav_lite.episodes import COLUMNS
    from dualnav_lite.judge import csv_text
    from dualnav_lite.pareto import pareto, pareto_episodes
    from dualnav_lite.survival import rows_of, survival

    episodes = []
    for arm in ("ppo", "cv_sampling", "ceiling", "straight", "ablation_default", "ablation_cache_off"):
        for scenario in ("pop_up", "crowd_crossing"):
            for seed in range(12):
                row = dict.fromkeys(COLUMNS) | {"scenario": scenario, "arm": arm, "seed": seed, "preference": 0.5}
                row |= {"outcome": "goal" if seed > 2 else "hit_box", "steps": 9, "path_m": 4.0}
                episodes.append(row | {"min_clearance_m": noise.uniform(0, 0.6), "energy_j": noise.uniform(150, 400)})
    rows = rows_of(episodes)
    main = rows[~rows.arm.str.startswith("ablation")]
    made = {
        "survival": survival(main),
        "ablations": survival(rows[rows.arm.str.startswith("ablation")]),
        "pareto": pareto(main),
        "pareto_episodes": pareto_episodes(main),
        "latency": pd.DataFrame([[stage, 0.1, 0.2, 0.4, 9] for stage in STAGES], columns=LATENCY_COLUMNS),
        "response_ticks": pd.DataFrame({"ticks": [1, 2, 2, 8, np.nan]}),
        "intervention": pd.DataFrame(
            [["pop_up", measure, 1.0, 1.1, -0.1, -0.2, 0.0, 9] for measure in ("survived", "energy of a run [J]")],
            columns=INTERVENTION_COLUMNS,
        ),
        "perturbed_front": pd.DataFrame(
            [
                ["pop_up", m, 0.5, 1, 0, 1, x, 900 * x, 0.9, 10, True, x, 950 * x, 1.0]
                for m in METHODS
                for x in (0.2, 0.3)
            ],
            columns=FRONT_COLUMNS,
        ),
        "failure_search": pd.DataFrame(
            [["pop_up", m, 50, 9, 0.18, "x 1", 0.4, 20, 6, 1, 0.7, 0.5, 0.9] for m in ("evolution", "random")],
            columns=FAILURE_COLUMNS,
        ),
        "battery_trace": pd.DataFrame({"arm": "ppo", "time_s": [0, 10800], "battery": [1, 0.2], "goals": [0, 540]}),
    }
    for name, table in made.items():
        (folder / f"{name}.csv").write_text(csv_text(table), encoding="utf-8")
    assert survived(main).any()
    return folder


def test_every_figure_is_drawn_from_its_table_in_every_format_with_a_caption(tables):
    names = [name for name, (needed, _) in RESULTS.items() if needed]
    written = make_result_figures(tables, "en", ("png", "svg", "pdf"), names)
    assert len(written) == 3 * len(names)
    assert all(path.stat().st_size > 2000 for path in written)
    captions = (tables / "figures" / "captions.md").read_text(encoding="utf-8")
    assert all(f"**{name}.**" in captions for name in names)
    assert set(RESULTS | APART) == set(CAPTIONS)
    first = [path.read_bytes() for path in written]
    again = make_result_figures(tables, "en", ("png", "svg", "pdf"), names)
    assert [path.read_bytes() for path in again] == first


def test_a_figure_without_its_table_is_named(tmp_path):
    with pytest.raises(UnusableInput, match=r"needs latency\.csv"):
        make_result_figures(tmp_path, names=["latency"], reference=tmp_path)
    with pytest.raises(UnusableInput, match="unknown figure of results 'front'; known: survival"):
        make_result_figures(tmp_path, names=["front"])
