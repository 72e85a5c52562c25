"""Claims about the reward: signs, bounds, telescoping, weights, and what the article's own terms do."""

import dataclasses
import itertools

import numpy as np
import pytest

from dualnav_lite.config import Power, Rewards
from dualnav_lite.kernels import intrusion
from dualnav_lite.motion import STEPS, Prediction
from dualnav_lite.rewards import (
    TERMS,
    Transition,
    WindowScore,
    article_potential,
    linear_potential,
    matched_velocities,
    predicted_intrusion,
    reward_terms,
    reward_weights,
    shaping,
    vector_reward,
)

REPAIRED, ARTICLE, FIXED = (Rewards(form=form) for form in ("repaired", "article", "article_fixed"))
FORMS = (REPAIRED, ARTICLE, FIXED)


def transition(**changes):
    """An uneventful step of one world, with some quantities changed."""
    quiet = {
        "clearance": 1.0,
        "min_range": 1.2,
        "action": np.array([0.8, 0.0]),
        "mover_velocity": np.zeros(2),
        "predicted_velocity": np.zeros(2),
        "intrusion": 0.0,
        "energy_j": 2.42,
        "reference_j": 2.42,
        "path_before": 5.0,
        "path_after": 4.92,
        "goal_distance": 4.9,
        "reached": False,
        "collided": False,
        "flat_battery": False,
    }
    return Transition(**{**quiet, **changes})


def random_transitions(n, seed=0):
    """n drawn steps as one batched transition."""
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, 6, n)
    return Transition(
        clearance=rng.uniform(-0.05, 2, n),
        min_range=rng.uniform(0.05, 3, n),
        action=rng.uniform(-1, 1, (n, 2)) * [0.8, 1.2],
        mover_velocity=rng.normal(size=(n, 2)),
        predicted_velocity=rng.normal(size=(n, 2)),
        intrusion=rng.uniform(0, 1, n),
        energy_j=rng.uniform(0.5, 5, n),
        reference_j=np.full(n, 2.42),
        path_before=rng.uniform(0, 15, n),
        path_after=rng.uniform(0, 15, n),
        goal_distance=rng.uniform(0, 12, n),
        reached=ends == 0,
        collided=ends == 1,
        flat_battery=ends == 2,
    )


def test_more_clearance_never_lowers_r_safe():
    clearances = np.linspace(-0.1, 3, 400)
    safe = reward_terms(transition(clearance=clearances), REPAIRED)["safe"]
    assert (np.diff(safe) >= 0).all()
    assert safe[0] < safe[-1] == 0


def test_article_sign_is_inverted_and_pays_for_hugging_walls():
    near, far = (reward_terms(transition(min_range=d), ARTICLE)["safe"] for d in (0.1, 5.0))
    assert (near, far) == (-1.0, -50.0)
    assert (
        reward_terms(transition(min_range=0.1), FIXED)["safe"] < reward_terms(transition(min_range=5.0), FIXED)["safe"]
    )


def test_hinge_is_measured_from_the_hull_and_not_from_the_sensor():
    # 0.35 m from the sensor is 0.15 m from the hull: the article's scan minimum sees no danger there.
    step = transition(clearance=0.15, min_range=0.35)
    assert reward_terms(step, FIXED)["safe"] == 0
    assert reward_terms(step, REPAIRED)["safe"] == pytest.approx(-10 * 0.15**2)


def test_terms_of_the_article_by_hand():
    step = transition(
        min_range=0.5,
        action=np.array([-0.4, 1.0]),
        mover_velocity=np.array([0.8, 0.3]),
        predicted_velocity=np.array([0.5, -0.1]),
        goal_distance=5.0,
        reached=True,
    )
    terms = reward_terms(step, ARTICLE)
    assert terms["safe"] == pytest.approx(-5.0)
    assert terms["dynamic"] == pytest.approx(-2.5)  # 5 x hypot(0.3, 0.4)
    assert terms["energy"] == pytest.approx(-1.8)  # 2 x (0.4 + 0.5 x 1.0)
    assert terms["goal"] == pytest.approx(3 / np.e)
    assert terms["terminal"] == 0  # it has none, not even for arriving
    assert reward_terms(transition(min_range=0.1), FIXED)["safe"] == pytest.approx(-0.4)


def test_terms_of_the_repaired_form_by_hand():
    step = transition(clearance=0.1, intrusion=0.3, energy_j=1.21, path_before=5.0, path_after=4.9)
    terms = reward_terms(step, REPAIRED)
    assert terms["safe"] == pytest.approx(-0.4)
    assert terms["dynamic"] == pytest.approx(-0.3)
    assert terms["energy"] == pytest.approx(-0.02)
    assert terms["goal"] == pytest.approx(1.0)
    assert terms["terminal"] == 0


def test_standing_still_is_free_for_the_article_and_costs_idle_power_here():
    still = transition(action=np.zeros(2), energy_j=Power().idle_w * 0.1)
    assert reward_terms(still, ARTICLE)["energy"] == 0
    assert reward_terms(still, REPAIRED)["energy"] < 0


@pytest.mark.parametrize(
    ("end", "value"), [("reached", 10.0), ("collided", -10.0), ("flat_battery", -10.0), ("nothing", 0.0)]
)
def test_terminal_names_how_the_run_ended(end, value):
    step = transition() if end == "nothing" else transition(**{end: True})
    assert reward_terms(step, REPAIRED)["terminal"] == value


def test_contact_on_the_goal_line_counts_as_contact():
    assert reward_terms(transition(reached=True, collided=True), REPAIRED)["terminal"] == -10


@pytest.mark.parametrize("potential", [linear_potential, article_potential])
def test_shaping_telescopes_so_no_detour_changes_its_sum(potential):
    rng = np.random.default_rng(1)
    start, end, gamma, steps = 7.0, 2.5, 0.97, 40
    sums = []
    for _ in range(2):
        way = np.concatenate([[start], rng.uniform(0.5, 12, steps - 1), [end]])
        pays = [shaping(a, b, False, gamma, potential) for a, b in itertools.pairwise(way)]
        sums.append(sum(gamma**t * pay for t, pay in enumerate(pays)))
    assert sums[0] == pytest.approx(sums[1], abs=1e-9)
    assert sums[0] == pytest.approx(gamma**steps * potential(end) - potential(start), abs=1e-9)


def test_arriving_pays_the_whole_potential_whatever_distance_counts_as_arrival():
    assert shaping(0.45, 0.39, True, 0.99) == pytest.approx(-linear_potential(0.45))


def test_loitering_near_the_goal_pays_only_in_the_article():
    loiter = transition(path_before=0.5, path_after=0.5, goal_distance=0.5)
    discounted = reward_terms(loiter, ARTICLE)["goal"] / (1 - 0.99)
    assert discounted == pytest.approx(271, abs=1)
    assert reward_terms(loiter, REPAIRED)["goal"] == 0


def test_a_discounted_potential_pays_a_standing_robot_as_much_as_a_driving_one_that_never_arrives():
    def worth(speed, gamma):
        """Discounted goal term of 800 steps down a way of 100 m."""
        way = 100.0 - speed * 0.1 * np.arange(801)
        return sum(0.99**t * shaping(a, b, False, gamma) for t, (a, b) in enumerate(itertools.pairwise(way)))

    left = 0.99**800 * linear_potential(36.0) - 0.99**800 * linear_potential(100.0)  # what the end leaves over
    assert worth(0.8, 0.99) - worth(0.0, 0.99) == pytest.approx(left)
    assert worth(0.0, 1.0) == 0
    assert worth(0.8, 1.0) > 70


def test_driving_to_and_fro_pays_less_than_arriving():
    """With gamma 1 in the potential the discount leaves something of a step forth that is taken back later."""
    leg = 0.08 * np.arange(51)
    way = np.tile(np.concatenate([4.0 - leg[:-1], leg[:-1]]), 30)  # 4 m there, 4 m back
    swing = REPAIRED.goal * sum(0.99**t * shaping(a, b, False, 1.0) for t, (a, b) in enumerate(itertools.pairwise(way)))
    arrival = REPAIRED.goal * sum(0.99**t * 0.8 for t in range(50)) + 0.99**50 * 10.0
    assert 0 < swing < 0.3 * arrival


def test_gradient_towards_the_goal_is_the_same_at_ten_metres_as_at_one():
    step = 0.08

    def gain(way, potential):
        return float(potential(way - step) - potential(way))

    assert gain(10, linear_potential) == pytest.approx(gain(1, linear_potential))
    assert gain(10, article_potential) < 0.2 * gain(1, article_potential)


@pytest.mark.parametrize("preference", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("charge", [0.2, 1.0])
def test_driving_eight_metres_is_worth_more_than_parking(preference, charge):
    def power(v):
        p = Power()
        return p.idle_w + p.linear_w_s_m * v + p.quadratic_w_s2_m2 * v * v

    def discounted(v, way=8.0, horizon=3000):
        total, weights = 0.0, reward_weights(preference, charge, REPAIRED)
        for t in range(horizon):
            after = max(way - v * 0.1, 0.0)
            reached = after == 0
            energy = power(v) * 0.1
            step = transition(
                path_before=way, path_after=after, reached=reached, energy_j=energy, reference_j=power(0.8) * 0.1
            )
            total += 0.99**t * float(vector_reward(reward_terms(step, REPAIRED)) @ weights)
            way = after
            if reached:
                break
        return total

    assert discounted(0.8) > discounted(0.0) + 0.1


def test_article_pays_for_parking_at_a_wall_beside_the_goal_and_nothing_for_arriving():
    hugging = transition(goal_distance=0.5, min_range=0.21, action=np.zeros(2))
    arriving = transition(goal_distance=0.4, min_range=1.2, reached=True)
    weights = reward_weights(0.5, 1.0, ARTICLE)
    parked, arrived = (float(vector_reward(reward_terms(t, ARTICLE)) @ weights) for t in (hugging, arriving))
    assert parked > 0 > arrived


def test_weights_are_the_articles_at_even_preference_and_full_charge():
    weights = reward_weights(0.5, 1.0, REPAIRED)
    np.testing.assert_allclose(weights, [0.45, 0.25, 0.20, 0.10, 1.0])
    assert weights[:4].sum() == pytest.approx(1.0)


def test_preference_trades_safety_for_thrift_and_an_empty_battery_adds_to_thrift():
    np.testing.assert_allclose(reward_weights(0.0, 0.4, REPAIRED), [0.9, 0.25, 0.0, 0.10, 1.0])
    np.testing.assert_allclose(reward_weights(1.0, 1.0, REPAIRED), [0.0, 0.25, 0.4, 0.10, 1.0])
    np.testing.assert_allclose(reward_weights(1.0, 0.0, REPAIRED), [0.0, 0.25, 1.6, 0.10, 1.0])
    np.testing.assert_allclose(reward_weights(0.5, 0.15, REPAIRED)[2], 0.2 * (1 + 3 * 0.85))


def test_article_sums_the_dictionary_and_its_fixed_form_applies_the_table():
    np.testing.assert_allclose(reward_weights(0.1, 0.3, ARTICLE), np.ones(5))
    np.testing.assert_allclose(reward_weights(0.1, 0.3, FIXED), [0.45, 0.25, 0.20, 0.10, 1.0])


@pytest.mark.parametrize("rewards", FORMS, ids=lambda r: r.form)
def test_batched_equals_world_by_world(rewards):
    n = 50
    batch = random_transitions(n)
    together = vector_reward(reward_terms(batch, rewards))
    assert together.shape == (n, 5)
    for i in range(n):
        one = Transition(**{f.name: getattr(batch, f.name)[i] for f in dataclasses.fields(batch)})
        np.testing.assert_array_equal(vector_reward(reward_terms(one, rewards)), together[i])


@pytest.mark.parametrize("rewards", FORMS, ids=lambda r: r.form)
def test_every_form_names_the_five_terms_and_stays_finite(rewards):
    terms = reward_terms(random_transitions(500), rewards)
    assert tuple(terms) == TERMS
    assert all(np.isfinite(term).all() for term in terms.values())


def test_repaired_terms_stay_inside_their_bounds():
    terms = reward_terms(random_transitions(2000), REPAIRED)
    assert -0.9 <= terms["safe"].min() <= terms["safe"].max() == 0
    assert -1 <= terms["dynamic"].min() <= terms["dynamic"].max() <= 0
    assert terms["energy"].max() < 0
    assert set(terms["terminal"]) == {-10.0, 0.0, 10.0}


def one_mover(start, velocity, radius=0.25):
    """A prediction of one world with a single mover on a straight line."""
    times = 0.1 * np.arange(1, STEPS + 1)
    positions = np.asarray(start) + times[:, None] * np.asarray(velocity)
    return Prediction(
        positions[None, None], np.asarray(velocity, float)[None, None], np.ones((1, 1), bool), np.full((1, 1), radius)
    )


def intruded(twist, *mover):
    return float(predicted_intrusion(np.array([twist]), one_mover(*mover))[0])


def test_driving_into_a_standing_mover_by_hand():
    # Gap of centres 1.0 m, hulls 0.45 m: after j steps at 0.5 m/s the surface gap is 0.55 - 0.05 j.
    expected = max(min(1.0, 1 - (0.55 - 0.05 * j) / 0.3) * (1 - (j - 1) / 20) for j in range(1, 21))
    assert intruded([0.5, 0.0], [1.0, 0.0], [0.0, 0.0]) == pytest.approx(max(expected, 0))


def test_earlier_contact_counts_more():
    values = [intruded([0.8, 0.0], [d, 0.0], [0.0, 0.0]) for d in (0.6, 0.9, 1.2, 1.6, 2.6)]
    assert values == sorted(values, reverse=True)
    assert values[0] > 0.8
    assert values[-1] == 0


def test_yielding_to_a_crossing_mover_is_better_than_driving_on():
    crossing = ([1.2, -1.2], [0.0, 0.8])
    assert intruded([0.8, 0.0], *crossing) > 0.2
    assert intruded([0.0, 0.0], *crossing) == 0


def test_turning_away_is_better_than_driving_straight_on():
    ahead = ([1.2, -0.1], [-0.3, 0.0])
    assert intruded([0.6, 1.2], *ahead) < intruded([0.6, 0.0], *ahead)


def test_intrusion_matches_a_slow_simulation_of_the_robot():
    rng = np.random.default_rng(3)
    for _ in range(20):
        twist, start, velocity = rng.uniform([-0.2, -1.2], [0.8, 1.2]), rng.uniform(-1.5, 1.5, 2), rng.uniform(-1, 1, 2)
        worst, (x, y, heading) = 0.0, (0.0, 0.0, 0.0)
        substeps = 400
        for j in range(1, STEPS + 1):
            for _ in range(substeps):
                heading += 0.5 * twist[1] * 0.1 / substeps
                x += twist[0] * np.cos(heading) * 0.1 / substeps
                y += twist[0] * np.sin(heading) * 0.1 / substeps
                heading += 0.5 * twist[1] * 0.1 / substeps
            mover = start + velocity * 0.1 * j
            gap = np.hypot(mover[0] - x, mover[1] - y) - 0.45
            worst = max(worst, np.clip(1 - gap / 0.3, 0, 1) * (1 - (j - 1) / STEPS))
        assert intruded(twist, start, velocity) == pytest.approx(worst, abs=1e-5)


def test_intrusion_kernel_equals_its_python_source():
    rng = np.random.default_rng(4)
    args = (rng.normal(size=(3, 2)), rng.normal(size=(3, 4, STEPS, 2)), np.full((3, 4), 0.3), rng.random((3, 4)) < 0.7)
    compiled, plain = np.empty(3), np.empty(3)
    intrusion.predicted_intrusion(*args, 0.2, 0.3, 0.1, compiled)
    intrusion.predicted_intrusion.py_func(*args, 0.2, 0.3, 0.1, plain)
    np.testing.assert_allclose(compiled, plain, atol=1e-12)
    alone = np.array(
        [
            predicted_intrusion(
                args[0][i : i + 1], Prediction(*(a[i : i + 1] for a in (args[1], args[1][:, :, 0], args[3], args[2])))
            )[0]
            for i in range(3)
        ]
    )
    np.testing.assert_array_equal(compiled, alone)


def test_article_dynamic_compares_the_nearest_prediction_with_the_truth_there():
    prediction = one_mover([1.0, 0.0], [0.5, 0.0])
    truth = (np.array([[[1.1, 0.0], [3.0, 3.0]]]), np.array([[[0.8, 0.1], [9.0, 9.0]]]), np.array([[True, True]]))
    actual, predicted = matched_velocities(prediction, *truth)
    np.testing.assert_allclose(actual, [[0.8, 0.1]])
    np.testing.assert_allclose(predicted, [[0.5, 0.0]])
    nobody = matched_velocities(prediction, truth[0], truth[1], np.array([[False, True]]))
    np.testing.assert_array_equal(nobody, np.zeros((2, 1, 2)))


def test_window_score_is_the_articles_listing():
    rng = np.random.default_rng(5)
    score, buffer = WindowScore(2), []
    for step in range(250):
        values = rng.normal(3, 2, (2, 5))
        scored = score({name: values[:, k] for k, name in enumerate(TERMS)})
        buffer.append(values[1, 0])
        if len(buffer) > 100:
            buffer.pop(0)
        expected = (values[1, 0] - np.mean(buffer)) / (np.std(buffer) + 1e-6)
        assert scored["safe"][1] == pytest.approx(expected, abs=1e-9), step
        np.testing.assert_array_equal(scored["terminal"], values[:, 4])


def test_window_score_cannot_tell_always_safe_from_always_unsafe():
    def scores(value):
        score = WindowScore(1)
        return [score({name: np.array([value]) for name in TERMS})["safe"][0] for _ in range(50)]

    np.testing.assert_allclose([scores(0.0), scores(-0.9)], 0.0, atol=1e-6)


def test_window_score_of_a_world_does_not_see_its_neighbours():
    rng = np.random.default_rng(6)
    values = rng.normal(size=(60, 3, 5))
    together, alone = WindowScore(3), WindowScore(1)
    for step, now in enumerate(values):
        if step == 30:
            together.reset([0, 1])
            alone.reset([0])
        both = together({name: now[:, k] for k, name in enumerate(TERMS)})
        one = alone({name: now[1:2, k] for k, name in enumerate(TERMS)})
        assert both["goal"][1] == one["goal"][0]
