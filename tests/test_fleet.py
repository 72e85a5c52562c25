"""A fleet: layouts from the seed, robots that see each other, and the article's cross-agent term."""

import numpy as np
import pytest

from dualnav_lite.beyond.fleet_drive import cross_of_commands, drive_fleets, row_of
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.fleet import CrossTerm, FleetWorlds, cross_term, draw_layout
from dualnav_lite.fleet.env import FleetEnv
from dualnav_lite.motion import STEPS
from dualnav_lite.scenario import load_scenario

SCENARIO, CONFIG = load_scenario("fleet_crossing"), Config()


def chase(infos):
    """Actions that turn each agent to its guide point and drive."""
    bearing = {agent: np.arctan2(*info["guide_robot"][::-1]) for agent, info in infos.items()}
    return {agent: [0.5 * max(0.0, np.cos(b)), np.clip(2.0 * b, -1.2, 1.2)] for agent, b in bearing.items()}


def fleet(count, seed=3):
    """Worlds of one fleet with so many robots."""
    scenario = SCENARIO.model_copy(update={"fleet": SCENARIO.fleet.model_copy(update={"robots": count})})
    return FleetWorlds([draw_layout(scenario, CONFIG, seed)], scenario, CONFIG)


@pytest.mark.parametrize("count", [2, 4])
def test_robots_start_apart_and_can_reach_a_place_opposite(count):
    for seed in range(5):
        worlds = fleet(count, seed)
        gaps = np.hypot(*(worlds.poses[:, None, :2] - worlds.poses[None, :, :2]).transpose(2, 0, 1))
        assert gaps[~np.eye(count, dtype=bool)].min() > 1.0
        assert (worlds.clearance > 0.2).all()
        assert (worlds.path_length > 4.0).all()
        assert (worlds.path_length < 16.0).all()
    again = fleet(count, 4)
    np.testing.assert_array_equal(again.poses, worlds.poses)


def test_neighbours_are_those_within_radio_range():
    worlds = fleet(3)
    worlds.poses[:3, :2] = [[1.0, 1.0], [1.0, 5.9], [1.0, 6.1]]
    assert worlds.nearby_robots(0).tolist() == [1]
    assert worlds.nearby_robots(1).tolist() == [0, 2]


def test_robots_that_meet_have_hit_each_other_and_stand():
    worlds = fleet(2)
    worlds.poses[:2] = [[3.0, 4.0, 0.0], [5.0, 4.0, np.pi]]
    for _ in range(60):
        worlds.advance(np.tile([0.8, 0.0], (2, 1)))
    assert worlds.outcomes.tolist() == ["hit_robot", "hit_robot"]
    assert np.hypot(*(worlds.poses[0] - worlds.poses[1])[:2]) < 0.4
    np.testing.assert_array_equal(worlds.past[-1], worlds.past[-2])


def test_the_cross_term_is_minus_the_mean_distance_of_said_and_done():
    ahead = np.stack([np.arange(1.0, 21.0), np.zeros(20)], axis=1)
    assert cross_term(ahead, ahead) == 0.0
    assert cross_term(ahead, ahead + np.array([0.3, 0.4])) == pytest.approx(-0.5)


def test_the_parallel_interface_drives_a_fleet_to_its_end_and_counts_the_term():
    runs = []
    for weight in (0.0, 1.0):
        env = FleetEnv(CONFIG, cross_weight=weight)
        observations, infos = env.reset(seed=3)
        assert set(observations) == set(infos) == set(env.agents) == {"robot_0", "robot_1", "robot_2"}
        assert env.observation_space("robot_0").contains(observations["robot_0"])
        rewards, terms = [], []
        while env.agents:
            agents = list(env.agents)
            observations, reward, terminated, truncated, infos = env.step(chase(infos))
            assert set(reward) == set(terminated) == set(truncated) == set(infos) == set(agents)
            assert set(env.agents) == {one for one in agents if not (terminated[one] or truncated[one])}
            rewards.append([reward.get(agent, 0.0) for agent in env.possible_agents])
            terms.append([infos[a]["r_cross"] if a in infos else 0.0 for a in env.possible_agents])
        runs.append((np.array(rewards), np.array(terms)))
    without, with_term = runs
    np.testing.assert_allclose(without[1], with_term[1])
    assert (without[1][:STEPS] == 0.0).all()
    assert (without[1] <= 0.0).all()
    assert without[1].min() < -0.01
    # the weight of r_dynamic is 0.25
    np.testing.assert_allclose(with_term[0] - without[0], 0.25 * without[1], atol=1e-9)


def test_the_term_needs_two_seconds_of_the_past():
    env = FleetEnv(CONFIG)
    env.reset(seed=3)
    cross, found = CrossTerm(), []
    for _ in range(STEPS + 3):
        found.append(cross(env.worlds, env._percept))
        env.step(dict.fromkeys(env.agents, (0.0, 0.0)))
    assert not np.any(found[:STEPS])


@pytest.mark.parametrize("actions", [{}, {"robot_0": [0.0, 0.0], "robot_9": [0.0, 0.0]}])
def test_an_action_for_each_agent_is_asked_for(actions):
    env = FleetEnv(CONFIG)
    env.reset(seed=3)
    with pytest.raises(ValueError, match="robot_0"):
        env.step(actions)


@pytest.mark.parametrize("seed", [1.5, "ab", -1])
def test_a_seed_that_is_none_is_refused_in_one_line(seed):
    with pytest.raises(UnusableInput, match=f"a seed must be a whole number of at least 0, got {seed!r}$"):
        FleetEnv(CONFIG).reset(seed=seed)


def test_a_scenario_without_a_fleet_is_refused():
    with pytest.raises(UnusableInput, match=r"'navigation' is of one robot: .* known here: fleet_crossing"):
        FleetEnv(CONFIG, "navigation")


def test_r_cross_of_a_command_is_least_for_the_one_that_is_driven_already():
    grid = np.array([[0.0, 0.0], [0.4, 0.0], [0.8, 0.0], [0.4, 1.0], [0.4, -1.0]])
    cross = cross_of_commands(grid, np.array([0.4, 0.0]))
    assert cross[1] == pytest.approx(0.0)
    assert cross.argmax() == 1
    # a mean over 0.1, ..., 2.0 s is 1.05 s
    assert cross[0] == cross[2] == pytest.approx(-0.4 * 1.05)
    assert cross[3] == pytest.approx(cross[4])


def test_the_weight_moves_commands_towards_those_that_are_expected_and_zero_is_the_policy():
    seeds = range(1_000_000, 1_000_002)
    tables = [drive_fleets(SCENARIO, seeds, CONFIG, "ppo", weight) for weight in (0.0, 0.0, 3.0)]
    assert tables[0][0]["outcomes"] == tables[1][0]["outcomes"]
    np.testing.assert_array_equal(tables[0][1]["energy"], tables[1][1]["energy"])
    assert not np.array_equal(tables[0][1]["energy"], tables[2][1]["energy"])
    row = row_of(SCENARIO, "ppo", 3.0, tables[2])
    counts = [row[name] for name in ("robots_arrived", "hit_robot", "hit_other", "timeouts")]
    assert sum(counts) == 3 * row["runs"] == 6
    assert row["deviation_m"] > 0


def test_an_arm_without_probabilities_has_nothing_to_choose_among():
    with pytest.raises(UnusableInput, match="'cv_sampling' gives no probabilities"):
        drive_fleets(SCENARIO, [1_000_000], CONFIG, "cv_sampling", 0.3)
