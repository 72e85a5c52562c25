"""The contract of the environment, over every scenario."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import dualnav_lite  # noqa: F401  (registers DualNav-v0)
from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.encoder import BANDS, CHANNELS, read_bands
from dualnav_lite.env import DynamicNavEnv, DynamicNavVectorEnv, split_infos
from dualnav_lite.parallel_env import flat
from dualnav_lite.rewards import TERMS
from dualnav_lite.scenario import all_scenarios
from tests.drivers import run_episodes, seek

SCENARIOS = list(all_scenarios())
FIRST = 1_000_000


def trace(scenario, seed, steps, **settings):
    """Bytes of everything an episode returned, step by step."""
    env = DynamicNavEnv(scenario=scenario, **settings)
    observation, info = env.reset(seed=seed)
    seen = [observation.tobytes()]
    for _ in range(steps):
        command = seek({"goal_robot": info["goal_robot"][None]})[0]
        observation, reward, terminated, truncated, info = env.step(command)
        seen.append(observation.tobytes() + np.float64(reward).tobytes() + info["scan"].tobytes())
        if terminated or truncated:
            break
    return seen


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_gymnasium_s_checker_has_nothing_to_say(scenario):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*normalized.*|.*not within.*symmetric.*")
        check_env(DynamicNavEnv(scenario=scenario, render_mode="rgb_array"), skip_render_check=True)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_same_seed_same_bytes_other_seed_other_bytes(scenario):
    first = trace(scenario, FIRST, 30)
    assert first == trace(scenario, FIRST, 30)
    assert first[0] != trace(scenario, FIRST + 1, 1)[0]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_every_number_is_finite_inside_the_space_and_no_channel_or_band_is_constant(scenario):
    env = DynamicNavVectorEnv(50, with_overrides(Config(), {"preference": "drawn"}), scenario, autoreset=False)
    observations, infos = env.reset(seed=FIRST)
    seen = [observations]
    for _ in range(25):
        observations, rewards, _, _, infos = env.step(seek(infos))
        assert env.observation_space.contains(observations)
        assert np.isfinite(rewards).all()
        assert np.isfinite(infos["vector_reward"]).all()
        seen.append(observations)
    seen = np.concatenate(seen)
    for k, name in enumerate(CHANNELS):
        assert np.ptp(seen[:, k]) > 0, name
    bands = read_bands(seen)
    for k, name in enumerate(BANDS):
        if name == "battery" and scenario == "battery":
            assert np.ptp(bands[:, k]) > 0  # starts full, and falls
        elif name == "map_age" and not scenario.startswith("comms"):
            assert np.ptp(bands[:, k]) == 0  # without a lossy link the map is always fresh
        else:
            assert np.ptp(bands[:, k]) > 0.05, name


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_no_memory_is_shared_between_steps(scenario):
    env = DynamicNavVectorEnv(2, scenario=scenario, truth=True, full_map=True)
    observations, infos = env.reset(seed=FIRST)
    for _ in range(3):
        kept = observations.copy(), infos["scan"].copy(), infos["map"].copy(), infos["truth"]["circles"].copy()
        command = np.array([[0.5, 0.3], [0.2, -0.3]])
        fresh, _, _, _, fresh_infos = env.step(command)
        for old, new in (
            (observations, fresh),
            (infos["scan"], fresh_infos["scan"]),
            (infos["map"], fresh_infos["map"]),
        ):
            assert not np.shares_memory(old, new)
        held = observations, infos["scan"], infos["map"], infos["truth"]["circles"]
        for before, now in zip(kept, held, strict=True):
            assert np.array_equal(before, now)
        observations, infos = fresh, fresh_infos


def test_a_reader_who_scribbles_on_what_it_got_changes_nothing():
    clean = trace("crowd_crossing", FIRST, 12)
    env = DynamicNavEnv(scenario="crowd_crossing")
    observation, info = env.reset(seed=FIRST)
    seen = [observation.tobytes()]
    for _ in range(12):
        command = seek({"goal_robot": info["goal_robot"][None]})[0]
        observation[:] = 7.0
        info["scan"][:] = 7.0
        info["map"][:] = 7.0
        info["tracks"]["positions"][:] = 7.0
        observation, reward, _, _, info = env.step(command)
        seen.append(observation.tobytes() + np.float64(reward).tobytes() + info["scan"].tobytes())
    assert seen == clean


@pytest.mark.parametrize(
    "scenario", ["navigation", "pop_up", "crowd_reactive", "low_light_phantoms", "comms_dropout_bursts"]
)
def test_rows_do_not_depend_on_how_many_worlds_run_side_by_side(scenario):
    seeds = range(FIRST, FIRST + 10)
    runs = [run_episodes(DynamicNavVectorEnv(n, scenario=scenario, autoreset=False), seeds) for n in (1, 8, 32)]
    for seed in seeds:
        for other in runs[1:]:
            assert repr(runs[0][seed]) == repr(other[seed])


def test_turning_up_the_preference_changes_the_weights_and_nothing_else():
    env = DynamicNavVectorEnv(2, scenario="navigation")
    _, safe = env.reset(seed=[FIRST, FIRST], options={"preference": [0.0, 1.0]})
    assert safe["preference"].tolist() == [0.0, 1.0]
    _, _, _, _, infos = env.step(np.full((2, 2), 0.3))
    assert np.array_equal(infos["vector_reward"][0], infos["vector_reward"][1])
    assert infos["reward_weights"][0, 0] > 0
    assert infos["reward_weights"][1, 0] == 0
    assert infos["reward_weights"][0, 2] == 0
    assert infos["reward_weights"][1, 2] > 0.2


def test_the_reward_is_the_weighted_sum_of_its_terms():
    env = DynamicNavEnv(scenario="navigation")
    _, info = env.reset(seed=FIRST)
    for _ in range(20):
        _, reward, _, _, info = env.step([0.6, 0.2])
        assert reward == pytest.approx(float(info["vector_reward"] @ info["reward_weights"]), abs=1e-12)
        assert [info["reward_terms"][name] for name in TERMS] == info["vector_reward"].tolist()
        assert isinstance(reward, float)


def discounted_returns(driver, num_envs=40):
    """(n,) discounted return of one episode a world, and how each ended."""
    env = DynamicNavVectorEnv(num_envs, scenario="navigation", autoreset=False)
    _, infos = env.reset(seed=FIRST)
    returns, outcomes, discount = np.zeros(num_envs), np.full(num_envs, "", object), 1.0
    while (outcomes == "").any():
        _, reward, _, _, infos = env.step(driver(infos))
        returns += discount * reward
        discount *= 0.99
        if "summary" in infos:
            outcomes = np.where(infos["_summary"], infos["summary"]["outcome"], outcomes)
    return returns, outcomes


def test_driving_to_the_goal_pays_and_parking_does_not():
    driven, outcomes = discounted_returns(seek)
    parked, ends = discounted_returns(lambda infos: np.zeros((40, 2)))
    assert set(ends) == {"timeout"}
    arrived = outcomes == "goal"
    assert arrived.sum() >= 5
    assert (driven[arrived] > parked[arrived] + 1).all()
    assert (driven[~arrived] < parked[~arrived] - 1).all()


def test_a_contact_ends_a_short_run_and_is_named():
    rows = run_episodes(DynamicNavVectorEnv(20, scenario="crowd_crossing", autoreset=False), range(FIRST, FIRST + 20))
    summaries = [summary for summary, _ in rows.values()]
    assert sum(summary["outcome"] == "hit_person" for summary in summaries) > 15
    for summary in summaries:
        assert (summary["collided_with"] == "person") == (summary["outcome"] == "hit_person")
        assert summary["contacts"] == (summary["outcome"] != "goal")
        assert summary["events"] == 1
        assert 0 < summary["first_event_s"] <= summary["time_s"]
        assert summary["min_clearance_m"] == 0 or summary["outcome"] == "goal"


def test_time_runs_out_as_truncation_not_as_termination():
    env = DynamicNavEnv(scenario="navigation")
    env.reset(seed=FIRST)
    limit = env.worlds.sim.layouts[0].time_limit_s
    steps = 0
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step([0.0, 0.0])
        steps += 1
    assert truncated
    assert not terminated
    assert steps == pytest.approx(limit / 0.1, abs=1.01)
    assert info["summary"]["outcome"] == "timeout"
    assert env.episode_energy_costs == [pytest.approx(5.0 * 0.1 * steps)]


def test_a_flat_battery_ends_the_run():
    config = with_overrides(Config(), {"power.capacity_wh": 0.01})
    env = DynamicNavEnv(config=config, scenario="navigation")
    env.reset(seed=FIRST)
    for _ in range(200):
        _, _, terminated, _, info = env.step([0.0, 0.0])
        if terminated:
            break
    assert info["summary"]["outcome"] == "flat_battery"
    assert info["battery"] == 0.0


def test_same_step_autoreset_hands_out_the_last_observation_and_the_next_first():
    env = DynamicNavVectorEnv(4, scenario="crowd_crossing")
    assert env.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.SAME_STEP
    _, infos = env.reset(seed=FIRST)
    for _ in range(200):
        observations, _, terminated, truncated, infos = env.step(seek(infos))
        ended = terminated | truncated
        if ended.any():
            i = int(np.flatnonzero(ended)[0])
            assert infos["_final_obs"].tolist() == ended.tolist()
            assert infos["final_obs"][i].shape == (4, 64, 64)
            assert not np.array_equal(infos["final_obs"][i], observations[i])
            assert infos["time_s"][i] == 0.0
            assert infos["final_info"]["time_s"][i] > 1.0
            assert infos["summary"]["outcome"][i]
            return
    pytest.fail("no episode ended")


def test_a_finished_world_stands_still_until_it_is_reset():
    env = DynamicNavVectorEnv(4, scenario="crowd_crossing", autoreset=False, truth=True)
    _, infos = env.reset(seed=FIRST)
    done = np.zeros(4, bool)
    while not done.any():
        observations, _, terminated, truncated, infos = env.step(seek(infos))
        done = terminated | truncated
    i = int(np.flatnonzero(done)[0])
    later, reward, _, _, later_infos = env.step(seek(infos))
    assert np.array_equal(later[i], observations[i])
    assert reward[i] == 0.0
    last, now = (split_infos(one, 4)[i] for one in (infos, later_infos))
    assert np.abs(last["twist"]).max() > 0.1  # it was moving when it ended
    of_the_step = {"reward_terms", "vector_reward", "clipped", "summary"}
    told = {path: value for path, value in flat(last).items() if path[0] not in of_the_step}
    assert len(told) > 30
    for path, value in told.items():
        np.testing.assert_array_equal(flat(now)[path], value, err_msg=".".join(path))


def test_the_time_limit_follows_the_speed_that_the_hardware_allows():
    for speed in (0.8, 0.4):
        env = DynamicNavEnv(config=with_overrides(Config(), {"hardware.max_lin_vel": speed}))
        env.reset(seed=FIRST)
        layout = env.worlds.sim.layouts[0]
        assert layout.time_limit_s == pytest.approx(2.0 * layout.shortest_path_m / speed + 15.0)


def test_test_mode_draws_the_stress_scenarios_itself():
    env = DynamicNavVectorEnv(30, with_overrides(Config(), {"test_mode": True}))
    env.reset(seed=FIRST)
    drawn = {scenario.id for scenario in env.sim.scenarios}
    assert drawn == {"pop_up", "crowd_crossing", "low_light", "battery", "comms_dropout"}


def test_truth_is_only_there_for_those_who_ask():
    env = DynamicNavVectorEnv(2, scenario="crowd_crossing")
    _, infos = env.reset(seed=FIRST)
    assert "truth" not in infos
    assert "received_map" not in infos
    env = DynamicNavVectorEnv(2, scenario="crowd_crossing", truth=True)
    _, infos = env.reset(seed=FIRST)
    assert infos["truth"]["num_circles"].tolist() == [5, 5]
    assert np.array_equal(infos["truth"]["pose"], env.sim.poses)
    one = split_infos(infos, 2)[1]
    assert one["truth"]["circles"].shape == infos["truth"]["circles"].shape[1:]
    assert set(one["reward_terms"]) == set(TERMS)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ([0.1, 0.2, 0.3], r"shape \(2,\).*got \(3,\)"),
        (0.5, r"shape \(2,\)"),
        ([np.nan, 0.0], "finite"),
        ([np.inf, 0.0], "finite"),
        (["fast", "left"], "finite real numbers, got <U4"),
        ([0.5 + 1j, 0.0], "finite real numbers, got complex128"),
        (np.array([0.5, None]), "finite real numbers, got object"),
        (np.array([0.5, 0.1], object), "finite real numbers, got object"),
        (None, r"shape \(2,\)"),
    ],
)
def test_wrong_actions_raise_and_say_what_is_wanted(action, words):
    env = DynamicNavEnv(scenario="navigation")
    env.reset(seed=FIRST)
    with pytest.raises(ValueError, match=words):
        env.step(action)


def test_out_of_range_actions_are_clipped_and_noted():
    env, twin = DynamicNavEnv(scenario="navigation"), DynamicNavEnv(scenario="navigation")
    env.reset(seed=FIRST)
    twin.reset(seed=FIRST)
    observation, _, _, _, info = env.step([5.0, -1e6])
    expected, _, _, _, twin_info = twin.step(env.action_space.high * [1, -1])
    assert info["clipped"]
    assert not twin_info["clipped"]
    assert np.array_equal(observation, expected)


def test_steps_before_reset_and_after_the_end_raise():
    env = DynamicNavEnv(scenario="crowd_crossing")
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step([0.0, 0.0])
    _, info = env.reset(seed=FIRST)
    for _ in range(400):
        _, _, terminated, truncated, info = env.step(seek({"goal_robot": info["goal_robot"][None]})[0])
        if terminated or truncated:
            break
    with pytest.raises(gymnasium.error.ResetNeeded, match="over"):
        env.step([0.0, 0.0])
    env.reset(seed=FIRST)
    env.step([0.0, 0.0])


def test_wrong_settings_are_refused_in_one_line():
    with pytest.raises(UnusableInput, match=r"unknown scenario 'fog'.*navigation"):
        DynamicNavEnv(scenario="fog")
    with pytest.raises(UnusableInput, match="scenario: at least one is wanted, got none; known: battery"):
        DynamicNavVectorEnv(1, scenario=[])
    with pytest.raises(gymnasium.error.ResetNeeded, match="before render"):
        DynamicNavEnv(render_mode="rgb_array").render()
    for number in (0, -1, 1.5, "3"):
        with pytest.raises(UnusableInput, match="num_envs must be a whole number of at least 1"):
            DynamicNavVectorEnv(number)
    with pytest.raises(UnusableInput, match="render_mode 'human'"):
        DynamicNavEnv(render_mode="human")
    with pytest.raises(UnusableInput, match="simulator 'highway'"):
        DynamicNavEnv(config=with_overrides(Config(), {"simulator": "highway"}))
    env = DynamicNavEnv()
    with pytest.raises(UnusableInput, match=r"unknown option 'preferense'.*preference"):
        env.reset(options={"preferense": 1})
    for reset in (env.reset, env.worlds.reset):
        for seed in (-3, 1.5, "ab", True, {}):
            with pytest.raises(UnusableInput, match=f"a seed must be a whole number of at least 0, got {seed!r}$"):
                reset(seed=seed)
    with pytest.raises(UnusableInput, match=r"at least 0, got 0\.5"):
        DynamicNavVectorEnv(2).reset(seed=[1, 0.5])
    env.reset(seed=np.int64(3))


def test_it_is_registered_and_reads_the_article_s_config(tmp_path):
    path = tmp_path / "config.yaml"
    env = gymnasium.make("DualNav-v0", config_path=str(path))
    assert path.exists()
    observation, _ = env.reset(seed=FIRST)
    assert env.observation_space.contains(observation)
    worlds = gymnasium.make_vec("DualNav-v0", num_envs=3, scenario="pop_up")
    observations, _ = worlds.reset(seed=FIRST)
    assert observations.shape == (3, 4, 64, 64)


@pytest.mark.parametrize("num_envs", [None, 2])
def test_gymnasium_s_record_of_episodes_stands_beside_the_summary(num_envs):
    if num_envs is None:
        env = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.make("DualNav-v0", scenario="crowd_crossing"))
    else:
        worlds = gymnasium.make_vec("DualNav-v0", num_envs=num_envs, scenario="crowd_crossing")
        env = gymnasium.wrappers.vector.RecordEpisodeStatistics(worlds)
    _, info = env.reset(seed=FIRST)
    total, ended = 0.0, np.array(False)
    while not ended.any():
        action = seek({"goal_robot": np.atleast_2d(info["goal_robot"])})
        _, reward, terminated, truncated, info = env.step(action if num_envs else action[0])
        total, ended = total + reward, np.logical_or(terminated, truncated)
    ended, summary, record = np.atleast_1d(ended), info["summary"], info["episode"]
    assert (np.atleast_1d(record["l"]) == np.atleast_1d(summary["steps"]))[ended].all()
    assert np.atleast_1d(record["r"])[ended] == pytest.approx(np.atleast_1d(total)[ended])


def test_a_student_s_parts_are_called_a_world_at_a_time():
    calls = {"encoder": 0, "reward": 0, "predictor": 0}

    def encode_state(scans, poses, map_crop, ego):
        calls["encoder"] += 1
        assert scans.shape == (3, 1080, 2)
        assert poses.shape == (3, 3)
        assert map_crop.shape == (64, 64)
        assert 0 <= ego.battery <= 1
        return np.zeros((4, 64, 64))

    def reward_terms(t):
        calls["reward"] += 1
        return {name: float(t.clearance > 0) for name in TERMS}

    def predictor(scans, poses):
        calls["predictor"] += 1
        assert scans.shape == (2, 10, 1080, 2)
        assert poses.shape == (2, 10, 3)
        return np.zeros((2, 3, 20, 2)), np.zeros((2, 3, 2)), np.zeros((2, 3), bool)

    env = DynamicNavVectorEnv(
        2, scenario="navigation", encoder=encode_state, reward_function=reward_terms, predictor=predictor
    )
    observations, _ = env.reset(seed=FIRST)
    assert not observations.any()
    _, _, _, _, infos = env.step(np.zeros((2, 2)))
    assert infos["vector_reward"].tolist() == [[1.0] * 5] * 2
    assert calls == {"encoder": 4, "reward": 2, "predictor": 2}


def test_a_student_s_reward_sees_how_fast_the_nearest_mover_goes_and_was_thought_to_go():
    seen = []

    def reward_terms(t):
        seen.append([*t.mover_velocity, *t.predicted_velocity])
        return dict.fromkeys(TERMS, 0.0)

    env = DynamicNavVectorEnv(2, scenario="crowd_reactive", reward_function=reward_terms)
    _, infos = env.reset(seed=FIRST)
    for _ in range(100):
        _, _, _, _, infos = env.step(seek({"goal_robot": infos["guide_robot"]}))
    true, predicted = np.hypot(*np.array(seen).reshape(-1, 2, 2).T)
    assert true.max() > 0.5
    assert predicted.max() > 0.2


def test_a_full_battery_band_and_a_filter_on_faint_returns_change_what_they_name():
    plain, changed = (
        DynamicNavVectorEnv(2, with_overrides(Config(), changes), "low_light")
        for changes in ({}, {"observation.battery": "full", "lidar.faintest": 0.07})
    )
    (before, infos), (after, filtered) = plain.reset(seed=FIRST), changed.reset(seed=FIRST)
    charge = BANDS.index("battery")
    assert (read_bands(before)[:, charge] < 1.0).all()
    assert (read_bands(after)[:, charge] == 1.0).all()
    strength = infos["scan"][..., 1]
    is_faint = strength < 0.07
    assert (is_faint & (strength > 0)).any()
    assert (filtered["scan"][is_faint] == [10.0, 0.0]).all()
    assert np.array_equal(filtered["scan"][~is_faint], infos["scan"][~is_faint])


def test_a_part_that_returns_other_terms_is_told_which_are_wanted():
    env = DynamicNavVectorEnv(1, scenario="navigation", reward_function=lambda t: {"safe": 1.0})
    env.reset(seed=FIRST)
    with pytest.raises(ValueError, match="safe, dynamic, energy, goal, terminal"):
        env.step(np.zeros((1, 2)))


def test_a_long_run_opens_a_goal_a_period_and_survives_contacts():
    env = DynamicNavVectorEnv(2, scenario="battery", autoreset=False)
    _, infos = env.reset(seed=FIRST)
    idle, contacts = [], 0
    for _ in range(1200):
        _, _, terminated, truncated, infos = env.step(seek({"goal_robot": infos["guide_robot"]}))
        assert not terminated.any()
        assert not truncated.any()
        idle.append(infos["idle"].copy())
        stands = infos["idle"]
        assert (infos["goal_robot"][stands] == 0).all()
    contacts = env.journal.contacts.sum()
    assert contacts >= 1  # a driver that cuts corners hits something within two minutes, and goes on
    assert env.journal.goals.sum() >= 2
    idle = np.array(idle)
    assert idle.any()
    assert not idle.all()
