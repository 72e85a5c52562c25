"""Scenario files: seven of them, checked key by key."""

import numpy as np
import pytest

from dualnav_lite.config import Config, UnusableInput, validated
from dualnav_lite.env import DynamicNavEnv, DynamicNavVectorEnv
from dualnav_lite.evaluate import evaluate
from dualnav_lite.mapping import Mapper
from dualnav_lite.parallel_env import ParallelVectorEnv
from dualnav_lite.recording import record
from dualnav_lite.scenario import (
    SCENARIO_FOLDER,
    STRESS_SCENARIOS,
    Link,
    Scenario,
    all_scenarios,
    configured_scenarios,
    load_scenario,
    read_scenarios,
)


def test_the_seven_files_of_the_contract_are_there():
    names = sorted(path.stem for path in SCENARIO_FOLDER.glob("*.yaml"))
    assert names == [
        "battery",
        "comms_dropout",
        "crowd_crossing",
        "crowd_reactive",
        "low_light",
        "navigation",
        "pop_up",
    ]


def test_the_article_s_numbers_stand_in_the_files():
    pop_up, crowd = load_scenario("pop_up").pop_up, load_scenario("crowd_crossing").crowd
    assert (pop_up.ahead_m, pop_up.speed_m_s) == (2.0, 1.5)
    assert (crowd.count, crowd.speed_m_s, crowd.reactive) == (5, 0.8, False)
    assert crowd.gap_m.high <= 0.5
    assert load_scenario("low_light").sensing.ambient_lux < 10
    assert (load_scenario("comms_dropout").link.delay_s, load_scenario("comms_dropout").link.loss) == (1.0, 0.3)
    assert load_scenario("battery").dispatcher.duration_s == 3 * 3600
    claims = {name: s.article_claim for name, s in all_scenarios().items() if s.article_claim is not None}
    assert claims == {
        "pop_up": 0.92,
        "crowd_crossing": 0.76,
        "low_light": 0.89,
        "low_light_phantoms": 0.89,
        "battery": 1.0,
        "comms_dropout": 0.68,
        "comms_dropout_bursts": 0.68,
    }


def test_a_variant_changes_only_what_it_names():
    plain, bursts = load_scenario("comms_dropout"), load_scenario("comms_dropout_bursts")
    assert bursts.link.burst_mean_s == 1.0
    assert bursts.link.delay_s == plain.link.delay_s
    assert bursts.room == plain.room


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("id: bad\ntitle: t\ntitle_zh: t\nroom: {size_m: {low: 9, high: 8}}\n", ["room.size_m", "below low"]),
        ("id: other\ntitle: t\ntitle_zh: t\n", ["file's name 'bad'", "other"]),
        ("- 1\n", ["keys and values"]),
        ("id: bad\ntitle: t\ntitle_zh: t\nvariants: {x: {link: {los: 1}}}\n", ["variant x", "link.los"]),
        (
            "id: bad\ntitle: t\ntitle_zh: t\nroom: {furniture: {low: 0, high: 500}}\n",
            ["room.furniture", "between 0 and 30"],
        ),
        (
            "id: bad\ntitle: t\ntitle_zh: t\npeople: {count: {low: 40, high: 40}}\n",
            ["people.count", "between 0 and 12"],
        ),
        (
            "id: bad\ntitle: t\ntitle_zh: t\npeople: {radius_m: {low: -1, high: 0.3}}\n",
            ["people.radius_m", "between 0.02 and 1"],
        ),
    ],
)
def test_wrong_scenario_files_are_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UnusableInput) as caught:
        read_scenarios(path)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("room: {furnitures: 3}", ["room.furnitures", "furniture"]),
        ("room: {size_m: {low: 8, high: 13}}", ["room.size_m", "between 3 and 12"]),
        ("pop_up: {count: {low: 0, high: 2}}", ["pop_up.count", "between 1 and 6"]),
        ("crowd: {count: 0}", ["crowd.count", "1"]),
        ("link: {delay_s: 1.0e6}", ["link.delay_s", "60"]),
        ("link: {loss: 0.3, burst_mean_s: 0.05}", ["link: ", "burst_mean_s must be 0 or at least 0.1 s to lose 0.3"]),
        ("link: {loss: 0.9, burst_mean_s: 0.3}", ["link: ", "burst_mean_s must be 0 or at least 0.901 s to lose 0.9"]),
        ("variants: {x: {link: {loss: 0.7, burst_mean_s: 0.2}}}", ["variant x", "at least 0.234 s to lose 0.7"]),
        ("sensing: {phantoms: 500}", ["sensing.phantoms", "8"]),
        ("start_charge: {low: 0.5, high: 5}", ["start_charge", "between 0 and 1"]),
        ("people: {speed_m_s: {low: .nan, high: 1}}", ["people.speed_m_s", "finite"]),
        ("people: {speed_m_s: {low: 1.0, high: 0.4}}", ["people.speed_m_s", "high (0.4) is below low (1.0)"]),
        ("goal_radius_m: .inf", ["goal_radius_m", "finite"]),
        ("pop_up: {ahead_m: -2}", ["pop_up.ahead_m", "greater than 0"]),
        ("crowd: {count: true}", ["crowd.count", "a number is wanted"]),
        ("start_charge: {low: true, high: true}", ["start_charge.low", "a number is wanted"]),
        (
            "people: {count: {low: 12, high: 12}, forklift_share: 1}\nroom: {pushable_boxes: {low: 0, high: 6}}",
            ["holds 12 movers", "up to 19", "people.count 12, people.forklift_share 1, room.pushable_boxes 6"],
        ),
        ("pop_up: {count: {low: 1, high: 3}}\ncrowd: {count: 5}", ["up to 14", "pop_up.count 3, crowd.count 5"]),
        (
            "room: {hall: true, size_m: {low: 5, high: 12}, goal_distance_m: {low: 7, high: 11}}",
            ["room.size_m.low", "1.4 m more than room.goal_distance_m.low (7)", "got 5"],
        ),
        (
            "room: {hall: true, size_m: {low: 3, high: 12}, goal_distance_m: {low: 1, high: 2}}",
            ["room.size_m.low", "at least 4 m in a hall", "got 3"],
        ),
        ("room: {door_width_m: {low: 0.9, high: 7}}", ["room.door_width_m.high", "at most 6.4 m", "got 7"]),
        ("variants: 3", ["variants", "changed keys"]),
        ("variants: {x: 3}", ["variants", "changed keys"]),
    ],
)
def test_what_no_world_can_hold_is_refused_in_one_line(tmp_path, text, words):
    test_wrong_scenario_files_are_refused_in_one_line(tmp_path, f"id: bad\ntitle: t\ntitle_zh: t\n{text}\n", words)


def test_every_link_that_a_scenario_may_ask_for_is_one_that_the_mapper_takes():
    config, keys = Config(), np.zeros(1, np.uint64)
    mapper, refused = Mapper(config.map, config.lidar, 1, config.control_dt_s), 0
    for loss in (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97):
        for burst in (0.0, 0.01, 0.1, 0.2, 0.234, 0.3, 0.9, 0.9000001, 3.3):
            try:
                link = validated(Link, {"loss": loss, "burst_mean_s": burst}, "link")
            except UnusableInput:
                refused += 1
                with pytest.raises(ValueError, match="too short"):
                    mapper.reset([0], np.zeros((1, 3)), [0.0], [loss], [burst], keys)
            else:
                mapper.reset([0], np.zeros((1, 3)), [link.delay_s], [link.loss], [link.burst_mean_s], keys)
    assert refused > 10


def test_a_missing_scenario_is_answered_with_the_known_ones():
    with pytest.raises(UnusableInput, match=r"unknown scenario 'fog'.*crowd_crossing.*navigation"):
        load_scenario("fog")
    with pytest.raises(UnusableInput, match="cannot be read"):
        load_scenario("nowhere.yaml")


def test_a_scenario_of_another_world_is_refused_with_the_command_that_drives_it(tmp_path):
    cars = r"'parking' is of cars: run `python kit\.py beyond parking`.*HighwayEnv.*known here: battery"
    robots = r"'fleet_crossing' is of several robots: run `python kit\.py beyond fleet`.*FleetEnv.*known here: battery"
    (tmp_path / "my_road.yaml").write_text("id: my_road\ntitle: t\ntitle_zh: t\ncars: {task: traffic}\n", "utf-8")
    road = str(tmp_path / "my_road.yaml")
    for name, words in (
        ("parking", cars),
        ("fleet_crossing", robots),
        (road, "'my_road' is of cars.* beyond traffic`"),
    ):
        for make in (
            lambda: DynamicNavVectorEnv(1, scenario=name),  # noqa: B023
            lambda: DynamicNavEnv(config=Config(scenario=name)),  # noqa: B023
            lambda: DynamicNavVectorEnv(1, scenario=["navigation", load_scenario(name)]),  # noqa: B023
            lambda: ParallelVectorEnv(2, 2, scenario=name),  # noqa: B023
            lambda: evaluate(["straight"], [name], [1], tmp_path / "rows"),  # noqa: B023
            lambda: record([name], ["straight"], [1], tmp_path / "drives", progress=False),  # noqa: B023
        ):
            with pytest.raises(UnusableInput, match=words) as caught:
                make()
            assert "\n" not in str(caught.value)
    assert not (tmp_path / "rows").exists()
    assert not (tmp_path / "drives").exists()


def test_a_misspelt_scenario_is_answered_with_those_of_the_world_that_was_asked():
    with pytest.raises(UnusableInput, match=r"unknown scenario 'parkin'; known: battery, .*pop_up_head_on$") as caught:
        DynamicNavVectorEnv(1, scenario="parkin")
    assert "parking" not in str(caught.value)
    assert "fleet" not in str(caught.value)


def test_a_config_asks_for_its_scenario_and_in_test_mode_for_the_five():
    assert configured_scenarios(Config(scenario="pop_up")) == ["pop_up"]
    assert configured_scenarios(Config(scenario="pop_up", test_mode=True)) == list(STRESS_SCENARIOS)


def test_a_scenario_cannot_change_after_it_was_read():
    scenario = load_scenario("navigation")
    assert isinstance(scenario, Scenario)
    with pytest.raises(ValueError, match="frozen"):
        scenario.goal_radius_m = 1.0
