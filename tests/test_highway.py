"""Cars: terms against numbers worked out by hand, the interface's promises, and PPO that learns to park (slow)."""

import numpy as np
import pytest
import torch

from dualnav_lite import rewards
from dualnav_lite.beyond.highway_agent import CarDriver, Follower, config_of, highway_table, judge, train_car
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.episodes import COLUMNS, OUTCOMES
from dualnav_lite.highway import HighwayEnv, HighwayVectorEnv
from dualnav_lite.highway.car_ways import CIRCLE_M, car_way
from dualnav_lite.highway.cars import (
    DRAG_KG_M,
    IDLE_W,
    MASS_KG,
    ROLLING_N,
    CarTransition,
    car_terms,
    gaps,
    predicted_intrusion,
    step_energy,
    time_gap,
)
from dualnav_lite.policy import make_actor

CAR = [0.0, 0.0, 0.0, 2.5, 1.0]


@pytest.mark.parametrize(
    ("other", "gap"),
    [
        ([9.0, 0.0, 0.0, 2.5, 1.0], 4.0),  # bumper to bumper
        ([0.0, 4.0, 0.0, 2.5, 1.0], 2.0),  # side by side
        ([8.0, 5.0, 0.0, 2.5, 1.0], np.hypot(3.0, 3.0)),  # corner to corner
        ([6.0, 0.0, np.pi / 2, 2.5, 1.0], 2.5),  # across the way
        ([4.0, 0.5, 0.3, 2.5, 1.0], 0.0),
    ],
)
def test_gaps_between_bodies_are_those_of_a_ruler(other, gap):
    assert gaps(CAR, [other])[0] == pytest.approx(gap)
    assert gaps(other, [CAR])[0] == pytest.approx(gap)


def test_energy_is_force_times_way_and_braking_gives_nothing_back():
    steady = (IDLE_W / 10.0 + ROLLING_N + DRAG_KG_M * 100.0) * 2.0  # 2 m at 10 m/s
    assert step_energy(10.0, 10.0, 0.2) == pytest.approx(steady)
    assert step_energy(-10.0, -10.0, 0.2) == pytest.approx(steady)
    assert step_energy(0.0, 1.0, 0.2) - step_energy(0.5, 0.5, 0.2) == pytest.approx(0.5 * MASS_KG)
    assert step_energy(10.0, 8.0, 0.2) == IDLE_W * 0.2


def test_the_cheapest_speed_lies_between_crawling_and_racing():
    joules_a_metre = [step_energy(v, v, 0.2) / (0.2 * v) for v in (5.0, 18.0, 25.0)]
    assert joules_a_metre[1] < min(joules_a_metre[0], joules_a_metre[2])


def test_intrusion_is_one_at_a_touch_and_less_the_later_it_comes():
    still = np.zeros((1, 2))
    assert predicted_intrusion(np.array([[4.0, 0.0]]), still, 1.0) == 1.0
    assert predicted_intrusion(np.array([[9.0, 0.0]]), still, 1.0) == 0.0
    soon, late = (predicted_intrusion(np.array([[9.0, 0.0]]), np.array([[v, 0.0]]), 1.0) for v in (-8.0, -2.5))
    assert 0.0 < late < soon < 1.0
    assert predicted_intrusion(np.zeros((0, 2)), np.zeros((0, 2)), 1.0) == 0.0


def test_the_time_gap_looks_ahead_in_the_own_way_only():
    cars = np.array([[25.0, 0.5], [8.0, 4.0], [-7.0, 0.0]])
    assert time_gap(cars, 10.0) == pytest.approx(2.0)
    assert time_gap(cars[1:], 10.0) == np.inf


def transition(**changes):
    """A step without danger at the usual speed."""
    calm = {
        "clearance": 9.0,
        "safe_m": 1.0,
        "time_gap": 9.0,
        "intrusion": 0.0,
        "lost_j": 100.0,
        "reference_j": 100.0,
        "energy_scale": 0.04,
    }
    calm |= {"way_before": 20.0, "way_after": 18.0, "way_scale": 2.0, "reached": False, "collided": False}
    return CarTransition(**calm | changes)


def test_terms_of_a_calm_step_are_those_worked_out_by_hand():
    terms = car_terms(transition())
    assert tuple(terms) == rewards.TERMS
    assert terms == pytest.approx({"safe": 0.0, "dynamic": 0.0, "energy": -0.04, "goal": 10.0, "terminal": 0.0})


def test_more_room_never_lowers_r_safe_and_its_range_is_the_robots():
    by_gap = [car_terms(transition(clearance=c))["safe"] for c in np.linspace(0.0, 2.0, 21)]
    by_time = [car_terms(transition(time_gap=t))["safe"] for t in np.linspace(0.0, 3.0, 21)]
    for values in (by_gap, by_time):
        assert values[0] == pytest.approx(rewards.hinge(0.0)) == -0.9
        assert values[-1] == 0.0
        assert (np.diff(values) >= 0).all()


def test_there_and_back_is_worth_nothing_and_arriving_pays_the_whole_way():
    there, back = transition(), transition(way_before=18.0, way_after=20.0)
    assert car_terms(there)["goal"] + car_terms(back)["goal"] == 0.0
    assert car_terms(transition(way_after=1.0, reached=True))["goal"] == 100.0
    assert car_terms(transition(collided=True))["terminal"] == rewards.FAILED


def test_the_way_of_a_car_is_a_drive_and_never_shorter_than_the_beeline():
    assert car_way((-10.0, 0.0), 0.0) == pytest.approx(10.0, abs=0.5)
    assert car_way((10.0, 0.0), 0.0) == pytest.approx(10.0, abs=0.5)  # backwards
    assert car_way((0.0, 4.0), 0.0) > 8.0  # nobody drives sideways
    assert car_way((0.0, 0.0), np.pi) == pytest.approx(np.pi * CIRCLE_M, rel=0.1)  # three arcs of 60 degrees
    rng = np.random.default_rng(0)
    for x, y, heading in rng.uniform([-30, -30, -np.pi], [30, 30, np.pi], (50, 3)):
        assert car_way((x, y), heading) >= 0.97 * np.hypot(x, y) - 0.8
        assert car_way((x, y), heading) == pytest.approx(car_way((x, -y), -heading), abs=0.7)


@pytest.mark.parametrize("scenario", ["parking", "traffic"])
def test_the_world_of_cars_keeps_the_interfaces_promises(scenario):
    """Same seed, same bytes; finite; the reward is the weighted vector; a world's rows do not depend on the others."""
    runs = []
    for worlds in (3, 1):
        env = HighwayVectorEnv(worlds, config_of(scenario))
        observations, infos = env.reset(seed=[7, 8, 9][:worlds])
        assert env.observation_space.contains(observations)
        seen, rng = [observations[0]], np.random.default_rng(1)
        for _ in range(25):
            action = rng.uniform(-1, 1, 2) * env.single_action_space.high * [1.0, 0.2]
            observations, reward, _, _, infos = env.step(np.tile(action, (worlds, 1)))
            assert np.isfinite(observations).all()
            np.testing.assert_allclose(reward, (infos["vector_reward"] * infos["reward_weights"]).sum(axis=1))
            seen.append(observations[0])
        runs.append(np.stack(seen))
        env.close()
    np.testing.assert_array_equal(runs[0], runs[1])
    assert len(np.unique(runs[0][:, 1])) > 5


@pytest.mark.parametrize("scenario", ["parking", "traffic"])
def test_a_picture_shows_the_car_where_there_is_no_display(scenario):
    env = HighwayEnv(config_of(scenario, 0.5), render_mode="rgb_array")
    env.reset(seed=4)
    before = env.render()
    assert before.ndim == 3
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 3  # road, lines, cars: not black
    for _ in range(5):
        env.step([1.0, 0.0])
    assert (env.render() != before).any()
    env.close()


def test_a_car_that_drives_on_hits_a_wall_and_its_summary_says_so():
    env = HighwayEnv(config_of("parking", 0.25))
    env.reset(seed=3)
    info, done = {}, False
    while not done:
        _, reward, terminated, truncated, info = env.step([2.0, 0.0])
        done = terminated or truncated
    summary = info["summary"]
    assert set(summary) == set(COLUMNS) - {"scenario", "arm", "training_seed", "seed"}
    assert summary["outcome"] == "hit_wall" in OUTCOMES
    assert summary["collided_with"] == "wall"
    assert summary["min_clearance_m"] == 0.0
    assert summary["preference"] == 0.25
    assert reward < -9.0
    assert summary["energy_j"] > 0.5 * MASS_KG * 2.9**2


@pytest.mark.parametrize(("scenario", "begins"), [("parking", 0.0), ("traffic", 15.0)])
def test_a_run_is_charged_what_it_drew_whatever_it_kept_in_between(scenario, begins):
    env = HighwayEnv(config_of(scenario, 0.5))
    env.reset(seed=3)
    task, info, charged = env.unwrapped.worlds.tasks[0], {}, 0.0
    for step in range(1000):
        push = 2.0 if step % 20 < 14 else -2.0  # speeds up, brakes, and ends at a wall or beside the road
        _, _, terminated, truncated, info = env.step([push, 0.02])
        charged -= info["reward_terms"]["energy"]
        if terminated or truncated:
            break
    assert info["summary"]["outcome"].startswith("hit_")
    usual = task.usual_speed
    joules = charged / task.energy_scale * step_energy(usual, usual, 0.2)
    constant = 0.5 * MASS_KG * (begins**2 - usual**2)
    assert joules == pytest.approx(info["summary"]["energy_j"] + constant)


def test_finished_worlds_begin_anew_and_their_last_observation_is_kept():
    env = HighwayVectorEnv(2, config_of("parking"))
    env.reset(seed=1)
    for _ in range(200):
        observations, _, terminated, truncated, infos = env.step(np.tile([2.0, 0.1], (2, 1)))
        ended = terminated | truncated
        if ended.any():
            break
    i = int(np.flatnonzero(ended)[0])
    assert not np.array_equal(infos["final_obs"][i], observations[i])
    assert observations[i][0] == 0.0  # at rest
    assert infos["time_s"][i] == 0.0
    assert infos["final_info"]["time_s"][i] > 0.0


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (Config(), "'pymunk' has an environment of its own"),
        (Config(simulator="highway"), "'navigation' is of one robot: .*; known here: parking, traffic"),
        (Config(simulator="highway", scenario="fog"), "unknown scenario 'fog'; known: parking, traffic"),
    ],
)
def test_the_wrong_simulator_or_scenario_is_refused_in_one_line(config, words):
    with pytest.raises(UnusableInput, match=words):
        HighwayVectorEnv(1, config)
    with pytest.raises(UnusableInput, match=r"dualnav_lite\.highway"):
        DynamicNavEnv(config=Config(simulator="highway"))


def test_training_and_judging_go_through_the_kits_own_tables():
    seen = []
    actor = train_car("parking", 1_024, seed=5, on_step=lambda infos, share: seen.append(share))
    assert len(seen) == 128  # one update of 16 worlds
    rows = judge(CarDriver(actor, 5), "parking", 0.5, 2)
    assert list(rows.columns) == list(COLUMNS)
    assert rows.seed.tolist() == [2_000_000, 2_000_001]
    assert (rows.training_seed == 5).all()
    again = train_car("parking", 1_024, seed=5)
    for one, other in zip(actor.parameters(), again.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0.0, atol=0.0)


def test_the_follower_keeps_its_lane_and_its_distance():
    rows = judge(Follower(), "traffic", 0.5, 3)
    assert (rows.outcome == "goal").all()
    assert (rows.min_clearance_m > 1.0).all()
    blind = judge(CarDriver(make_actor((32,), "gaussian", [4.0, 0.05])), "traffic", 0.5, 3)
    assert not (blind.outcome == "goal").all()


def test_the_table_of_a_few_episodes_has_a_row_for_each_preference():
    table = highway_table("traffic", (0,), 1_024, 2, peers=False)
    assert table.arm.tolist() == ["follower", "ppo", "ppo", "ppo"]
    assert table.preference.tolist() == [0.5, 0.0, 0.5, 1.0]
