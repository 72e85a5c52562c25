import numpy as np
import pytest

from dualnav_lite.rollout import Rollout, RunningDeviation, gae, gae_reference

GAMMA, LAMBDA = 0.5, 0.5  # powers of two, so that every number below is exact


def test_three_steps_without_an_end_by_hand():
    # V = 1, 2, 3 and 4 behind the last step; r = 1, 1, 1.
    # delta_2 = 1 + 0.5 * 4 - 3 = 0;     A_2 = 0
    # delta_1 = 1 + 0.5 * 3 - 2 = 0.5;   A_1 = 0.5 + 0.25 * 0 = 0.5
    # delta_0 = 1 + 0.5 * 2 - 1 = 1;     A_0 = 1 + 0.25 * 0.5 = 1.125
    never = np.zeros((3, 1), bool)
    advantages, returns = gae([[1.0]] * 3, [[1.0], [2.0], [3.0]], [[2.0], [3.0], [4.0]], never, never, GAMMA, LAMBDA)
    assert advantages.ravel().tolist() == [1.125, 0.5, 0.0]
    assert returns.ravel().tolist() == [2.125, 2.5, 3.0]


def test_a_terminated_and_a_truncated_step_by_hand():
    # World 0 terminates at step 1: the value 100 behind it must not count, nor what the next episode brings.
    # delta_2 = 2 + 0.5 * 2 - 1 = 2;      A_2 = 2
    # delta_1 = 4 + 0 - 2 = 2;            A_1 = 2
    # delta_0 = 1 + 0.5 * 2 - 4 = -2;     A_0 = -2 + 0.25 * 2 = -1.5
    # World 1 is truncated at step 1 in a state worth 8: that counts, the next episode does not.
    # delta_2 = 2 + 0.5 * 2 - 1 = 2;      A_2 = 2
    # delta_1 = 4 + 0.5 * 8 - 2 = 6;      A_1 = 6
    # delta_0 = 1 + 0.5 * 2 - 4 = -2;     A_0 = -2 + 0.25 * 6 = -0.5
    rewards = [[1.0, 1.0], [4.0, 4.0], [2.0, 2.0]]
    values = [[4.0, 4.0], [2.0, 2.0], [1.0, 1.0]]
    next_values = [[2.0, 2.0], [100.0, 8.0], [2.0, 2.0]]
    terminated = np.array([[0, 0], [1, 0], [0, 0]], bool)
    truncated = np.array([[0, 0], [0, 1], [0, 0]], bool)
    for estimate in (gae, gae_reference):
        advantages, returns = estimate(rewards, values, next_values, terminated, truncated, GAMMA, LAMBDA)
        assert advantages.T.tolist() == [[-1.5, 2.0, 2.0], [-0.5, 6.0, 2.0]]
        assert (returns - advantages).tolist() == values


def some_steps(terms=5, steps=40, n=6, seed=0):
    rng = np.random.default_rng(seed)
    ended = rng.random((steps, n))
    arrays = (rng.normal(size=(steps, n, terms)) for _ in range(3))
    return *arrays, ended < 0.05, ended > 0.95


def test_fast_and_slow_estimates_agree():
    steps = some_steps()
    for fast, slow in zip(gae(*steps, 0.99, 0.95), gae_reference(*steps, 0.99, 0.95), strict=True):
        np.testing.assert_allclose(fast, slow, atol=1e-12)


def test_sum_of_weighted_estimates_is_the_estimate_of_the_weighted_sum():
    rewards, values, next_values, terminated, truncated = some_steps()
    weights = np.array([0.45, 0.25, 0.2, 0.1, 1.0])
    apart, _ = gae(rewards, values, next_values, terminated, truncated)
    together, _ = gae(rewards @ weights, values @ weights, next_values @ weights, terminated, truncated)
    assert np.abs(apart @ weights - together).max() < 1e-6


def test_with_lambda_one_the_advantage_is_the_discounted_return_minus_the_value():
    rewards, values, next_values, terminated, _ = some_steps(terms=1, steps=12, n=3)
    rewards, values = rewards[..., 0], values[..., 0]
    next_values = np.concatenate([values[1:], next_values[-1:, :, 0]])  # one episode: values follow each other
    never = np.zeros_like(terminated)
    advantages, returns = gae(rewards, values, next_values, never, never, 0.9, 1.0)
    for t in range(12):
        powers = 0.9 ** np.arange(12 - t)
        expected = powers @ rewards[t:] + 0.9 ** (12 - t) * next_values[-1]
        np.testing.assert_allclose(returns[t], expected, atol=1e-12)
        np.testing.assert_allclose(advantages[t], expected - values[t], atol=1e-12)


def test_shapes_that_do_not_fit_are_refused():
    ones, flags = np.ones((4, 2)), np.zeros((4, 2), bool)
    with pytest.raises(ValueError, match="share a shape"):
        gae(ones, ones[:3], ones, flags, flags)
    with pytest.raises(ValueError, match="must be"):
        gae(ones, ones, ones, flags[:, :1], flags)


def test_running_deviation_is_that_of_the_discounted_returns():
    rng = np.random.default_rng(1)
    rewards = rng.normal(2.0, [1.0, 5.0], size=(50, 3, 2))
    scale = RunningDeviation(3, 2, gamma=0.9)
    seen, running = [], np.zeros((3, 2))
    for t in range(50):
        ended = np.array([t == 20, False, t == 30])
        scale.update(rewards[t], ended)
        running = 0.9 * running + rewards[t]
        seen.append(running.copy())
        running[ended] = 0.0
    np.testing.assert_allclose(scale.deviations, np.concatenate(seen).std(axis=0), rtol=1e-12)


def test_running_deviation_goes_on_from_a_checkpoint():
    rng = np.random.default_rng(2)
    whole, part = RunningDeviation(4, 3), RunningDeviation(4, 3)
    for t in range(60):
        if t == 30:
            whole.restart()
            resumed = RunningDeviation(4, 3)
            resumed.load_state_dict(part.state_dict())
            part = resumed
        rewards, ended = rng.normal(size=(4, 3)), rng.random(4) < 0.1
        whole.update(rewards, ended)
        part.update(rewards, ended)
    assert whole.deviations.tolist() == part.deviations.tolist()


def test_a_term_that_never_varies_is_not_scaled():
    scale = RunningDeviation(2, 1)
    scale.update(np.zeros((2, 1)), np.zeros(2, bool))
    assert scale.deviations.tolist() == [1.0]


def filled_rollout(deviations=(1.0, 4.0)):
    rng = np.random.default_rng(3)
    rollout = Rollout()
    for _ in range(6):
        rollout.add(
            observations=np.zeros((2, 1), np.float32),
            actions=np.zeros(2),
            log_probs=np.zeros(2),
            rewards=rng.normal(size=(2, 2)) * deviations,
            weights=np.array([[1.0, 0.5], [1.0, 0.5]]),
            values=np.zeros((2, 2)),
            next_values=np.zeros((2, 2)),
            terminated=np.zeros(2, bool),
            truncated=np.zeros(2, bool),
        )
    return rollout


def test_unscaled_weights_give_the_advantage_of_the_environments_own_reward():
    rollout = filled_rollout()
    summed, returns = rollout.estimate(0.9, 0.8, deviations=(1.0, 4.0), weigh_scaled=False)
    flags = np.zeros((6, 2), bool)
    scalar = (np.stack(rollout.rewards) * np.stack(rollout.weights)).sum(axis=-1)
    expected, _ = gae(scalar, 0 * scalar, 0 * scalar, flags, flags, 0.9, 0.8)
    np.testing.assert_allclose(summed, expected.ravel(), rtol=1e-5)
    assert returns.shape == (12, 2)


def test_scaled_weights_do_not_care_for_the_units_of_a_term():
    summed = [filled_rollout((1.0, unit)).estimate(0.9, 0.8, deviations=(1.0, unit))[0] for unit in (4.0, 400.0)]
    np.testing.assert_allclose(summed[0], summed[1], rtol=1e-5)


def test_a_step_with_a_missing_field_is_refused():
    with pytest.raises(ValueError, match="next_values"):
        Rollout().add(**{name: None for name in vars(Rollout()) if name != "next_values"})
