import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

from dualnav_lite.agent import PPOAgent
from dualnav_lite.policy import Critic, make_actor
from dualnav_lite.ppo import PPO, Batch, make_optimizers, normalised, policy_loss, update, value_loss
from dualnav_lite.ppo_loop import collect
from dualnav_lite.rollout import RunningDeviation
from dualnav_lite.trunks import trunk_for


@pytest.mark.parametrize("clip_range", [0.15, 0.2])
def test_clipped_loss_agrees_with_the_paper_sample_by_sample(clip_range):
    rng = np.random.default_rng(0)
    new, old, advantages = rng.normal(0, 0.3, 200), rng.normal(0, 0.3, 200), rng.normal(0, 2, 200)
    objective = 0.0
    for log_new, log_old, advantage in zip(new, old, advantages, strict=True):
        ratio = np.exp(log_new) / np.exp(log_old)
        # Schulman et al. 2017, figure 1: flat where a good action is already likelier, or a bad one already rarer.
        if (advantage > 0 and ratio > 1 + clip_range) or (advantage < 0 and ratio < 1 - clip_range):
            ratio = 1 + clip_range if advantage > 0 else 1 - clip_range
        objective += ratio * advantage / 200
    tensors = (torch.from_numpy(values) for values in (new, old, advantages))
    assert float(policy_loss(*tensors, clip_range)) == pytest.approx(-objective, rel=1e-12)


def test_first_gradient_is_that_of_the_plain_policy_gradient():
    # At ratio 1 nothing is clipped, and grad r = grad log pi.
    advantages = torch.tensor([1.0, -2.0, 0.5])
    log_probs = torch.tensor([-1.0, -2.0, -3.0], requires_grad=True)
    policy_loss(log_probs, log_probs.detach(), advantages, 0.15).backward()
    assert torch.allclose(log_probs.grad, -advantages / 3)


def test_clipped_samples_pull_no_further():
    log_probs = torch.tensor([0.3, -0.3, 0.3, -0.3], requires_grad=True)
    advantages = torch.tensor([1.0, -1.0, -1.0, 1.0])
    policy_loss(log_probs, torch.zeros(4), advantages, 0.15).backward()
    assert [bool(g != 0) for g in log_probs.grad] == [False, False, True, True]


def test_value_loss_by_hand():
    values, returns = torch.tensor([[1.0, 2.0], [0.0, 0.0]]), torch.tensor([[0.0, 0.0], [0.0, 2.0]])
    assert float(value_loss(values, returns)) == 0.5 * ((1 + 4) + 4) / 2


def test_normalised_advantages_have_mean_zero_and_deviation_one():
    found = normalised(torch.tensor([1.0, 2.0, 3.0, 10.0]))
    assert float(found.mean()) == pytest.approx(0.0, abs=1e-6)
    assert float(found.std(unbiased=False)) == pytest.approx(1.0, abs=1e-6)


def pair(seed=0, terms=2, size=3, head="gaussian"):
    torch.manual_seed(seed)
    return make_actor((size,), head, [1.0, 1.0]), Critic(trunk_for((size,)), terms)


def some_batch(actor, samples=96, terms=2, size=3, seed=0):
    generator = torch.Generator().manual_seed(seed)
    observations = torch.randn(samples, size, generator=generator)
    with torch.no_grad():
        actions, log_probs = actor.head.sample(actor(observations), generator)
    drawn = [torch.randn(samples, *rest, generator=generator) for rest in ((), (terms,), (terms,))]
    return Batch(observations, actions, log_probs, *drawn)


def weights_of(*networks):
    return np.concatenate([p.detach().numpy().ravel() for network in networks for p in network.parameters()])


@pytest.mark.parametrize("head", ["gaussian", "commands"])
def test_one_update_agrees_with_a_formula_written_out(head):
    actor, critic = pair(head=head)
    batch = some_batch(actor)
    settings = PPO(epochs=1, minibatch=96, micro_batch=96, entropy_coef=0.02, max_gradient_norm=1e9, target_kl=1e9)
    twins = pair(head=head)
    expected = []
    for twin in twins:
        if twin is twins[0]:
            a = (batch.advantages - batch.advantages.mean()) / batch.advantages.std(unbiased=False)
            if head == "gaussian":
                mean, log_std = twin(batch.observations).chunk(2, dim=1)
                normal = torch.distributions.Normal(mean, log_std.exp())
                new, entropy = normal.log_prob(batch.actions).sum(1), normal.entropy().sum(1)
            else:
                categorical = torch.distributions.Categorical(logits=twin(batch.observations))
                new, entropy = categorical.log_prob(batch.actions), categorical.entropy()
            r = (new - batch.log_probs).exp()
            loss = -torch.min(r * a, r.clamp(0.85, 1.15) * a).mean() - 0.02 * entropy.mean()
            rate = settings.learning_rate_actor
        else:
            loss = ((twin(batch.observations) - batch.returns) ** 2).sum() / (2 * 96)
            rate = settings.learning_rate_critic
        loss.backward()
        # Adam's first step: the bias corrections cancel the moments' (1 - beta), which leaves g / (|g| + eps).
        step = [p - rate * p.grad / (p.grad.abs() + 1e-5) for p in twin.parameters()]
        expected.append(np.concatenate([p.detach().numpy().ravel() for p in step]))
    update(actor, critic, make_optimizers(actor, critic, settings), batch, settings, np.random.default_rng(0))
    np.testing.assert_allclose(weights_of(actor, critic), np.concatenate(expected), atol=2e-6)


def updated(seed=0, **changes):
    actor, critic = pair()
    batch = some_batch(actor)
    settings = PPO(**{"epochs": 3, "minibatch": 32, "micro_batch": 32, "threads": 1} | changes)
    numbers = update(
        actor, critic, make_optimizers(actor, critic, settings), batch, settings, np.random.default_rng(seed)
    )
    return weights_of(actor, critic), numbers


def test_micro_batches_change_the_speed_and_not_the_update():
    np.testing.assert_allclose(updated(micro_batch=8)[0], updated(micro_batch=32)[0], atol=1e-5)


def test_two_threads_give_the_weights_of_one():
    assert np.array_equal(updated(threads=2)[0], updated(threads=1)[0])


def test_epochs_end_where_the_policy_has_moved_too_far():
    calm, hasty = updated(epochs=8)[1], updated(epochs=8, target_kl=1e-6)[1]
    assert calm["epochs"] == 8
    assert hasty["epochs"] < 8
    assert hasty["approx_kl"] > 1.5e-6


def test_a_reference_holds_the_policy_back():
    def moved(coefficient):
        actor, critic = pair()
        batch = some_batch(actor)
        with torch.no_grad():
            before = actor(batch.observations)
        batch.reference = before
        settings = PPO(epochs=8, minibatch=32, learning_rate_actor=1e-2, target_kl=1e9, reference_coef=coefficient)
        update(actor, critic, make_optimizers(actor, critic, settings), batch, settings, np.random.default_rng(0))
        with torch.no_grad():
            return float(actor.head.divergence(before, actor(batch.observations)).mean())

    assert moved(10.0) < 0.3 * moved(0.0)


@pytest.mark.parametrize(("broken", "named"), [("advantages", "policy loss"), ("returns", "value loss")])
def test_a_loss_that_is_no_number_is_named(broken, named):
    actor, critic = pair()
    batch = some_batch(actor)
    getattr(batch, broken)[3] = float("nan")
    settings = PPO()
    with pytest.raises(FloatingPointError, match=named):
        update(actor, critic, make_optimizers(actor, critic, settings), batch, settings, np.random.default_rng(0))


class ThreeLines(gymnasium.Env):
    """Say the sign of what you see; truncated after `limit` steps."""

    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def __init__(self, limit=8):
        self.limit = limit

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time, self.seen = 0, self.np_random.choice([-1.0, 1.0])
        return np.array([self.seen], np.float32), {}

    def step(self, action):
        reward, self.time, self.seen = (
            -abs(float(action[0]) - self.seen),
            self.time + 1,
            self.np_random.choice([-1.0, 1.0]),
        )
        return np.array([self.seen], np.float32), reward, False, self.time >= self.limit, {}


def worlds(make, n):
    return gymnasium.vector.SyncVectorEnv([make] * n, autoreset_mode=AutoresetMode.SAME_STEP)


def test_collected_steps_bootstrap_from_the_last_observation_not_from_the_next_episode():
    torch.manual_seed(0)
    env, actor, critic = (
        worlds(lambda: ThreeLines(limit=4), 3),
        make_actor((1,), "gaussian", [1.0]),
        Critic(trunk_for((1,)), 1),
    )
    seen = []
    observations, _ = env.reset(seed=5)
    rollout, _ = collect(
        env, actor, critic, observations, 10, torch.Generator().manual_seed(0), RunningDeviation(3, 1), seen.append
    )
    assert len(rollout) == len(seen) == 10
    assert [bool(flags.all()) for flags in rollout.truncated] == [False] * 3 + [True] + [False] * 3 + [True] + [
        False
    ] * 2
    for t in range(9):
        expected = rollout.values[t + 1]
        if rollout.truncated[t].all():
            last = np.stack(list(seen[t]["final_obs"]))
            expected = critic(torch.from_numpy(last)).detach().numpy()
            assert not np.array_equal(last, rollout.observations[t + 1])
        np.testing.assert_allclose(rollout.next_values[t], expected, rtol=1e-6)


def trained(make, size, limits, steps, settings, n=16, length=64, seed=0):
    """Mean reward a step over the first and over the last tenth of the training."""
    torch.manual_seed(seed)
    env, actor, critic = worlds(make, n), make_actor((size,), "gaussian", limits), Critic(trunk_for((size,)), 1)
    optimizers, rng, generator = (
        make_optimizers(actor, critic, settings),
        np.random.default_rng(seed),
        torch.Generator(),
    )
    generator.manual_seed(seed)
    deviation = RunningDeviation(n, 1, settings.gamma)
    observations, _ = env.reset(seed=seed)
    observations, means = np.asarray(observations, np.float32), []
    for _ in range(steps // (n * length)):
        rollout, observations = collect(
            env, actor, critic, observations, length, generator, deviation, lambda infos: None
        )
        means.append(np.mean(rollout.rewards))
        update(actor, critic, optimizers, Batch.of(rollout, settings, actor, deviation.deviations), settings, rng)
    tenth = max(1, len(means) // 10)
    return np.mean(means[:tenth]), np.mean(means[-tenth:])


@pytest.mark.slow
def test_a_three_line_environment_is_learned():
    settings = PPO(epochs=10, minibatch=64, learning_rate_actor=1e-3, entropy_coef=0.0, threads=1)
    first, last = trained(ThreeLines, 1, [1.0], 40_000, settings)
    assert first < -0.9  # saying nothing costs 1 a step
    assert last > -0.25


@pytest.mark.slow
def test_pendulum_is_learned():
    # A pendulum that hangs or spins costs about 1,200 to 1,500 an episode of 200 steps; held upright, about 150 to 250.
    settings = PPO(
        epochs=10, minibatch=64, gamma=0.9, learning_rate_actor=1e-3, entropy_coef=0.0, target_kl=0.05, threads=1
    )
    _, last = trained(lambda: gymnasium.make("Pendulum-v1"), 3, [2.0], 300_000, settings, n=8, length=128)
    assert last * 200 > -350


def test_the_articles_call_and_loop_work():
    agent = PPOAgent(state_dim=4, action_dim=2, lr_actor=0.0003, lr_critic=0.001, gamma=0.99, K_epochs=2, eps_clip=0.15)
    rng = np.random.default_rng(0)
    state = rng.normal(size=4)
    before = weights_of(agent.actor, agent.critic)
    for t in range(40):
        action, log_prob = agent.select_action(state)
        assert action.shape == (2,)
        assert np.isfinite(log_prob)
        state, last = rng.normal(size=4), state
        agent.buffer.push(last, action, log_prob, 1.0, t % 10 == 9)
    assert len(agent.buffer) == 40
    numbers = agent.update()
    assert len(agent.buffer) == 0
    assert {"policy_loss", "value_loss", "approx_kl", "entropy", "explained_variance"} <= set(numbers)
    assert not np.array_equal(before, weights_of(agent.actor, agent.critic))


def test_the_closed_loop_fits_on_a_page_and_runs():
    loop = Path(__file__).parent.parent / "training" / "closed_loop.py"
    assert len(loop.read_text(encoding="utf-8").splitlines()) < 50
    done = subprocess.run([sys.executable, str(loop), "1"], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"Ep 1: SafeDist=\d\.\d\dm \| Energy=\d+\.\d\dJ\n", done.stdout)


def test_an_image_agent_draws_physical_commands_and_finds_them_again():
    agent = PPOAgent((3, 64, 64), 2)
    state = np.random.default_rng(0).random((3, 64, 64))
    for _ in range(5):
        action, log_prob = agent.select_action(state)
        assert abs(action[0]) <= 0.8 + 1e-6
        assert abs(action[1]) <= 1.2 + 1e-6
        agent.buffer.push(state, action, log_prob, 0.0, False)
    with torch.no_grad():
        parameters = agent.actor(torch.from_numpy(np.float32(state))[None])
    for drawn, log_prob in zip(agent.buffer.rollout.actions, agent.buffer.rollout.log_probs, strict=True):
        assert parameters[0, drawn[0]] == pytest.approx(log_prob[0])


def test_a_truncated_step_needs_the_state_it_ended_in():
    agent = PPOAgent(2, 1)
    with pytest.raises(ValueError, match="next_state"):
        agent.buffer.push(np.zeros(2), np.zeros(1), 0.0, 0.0, True, truncated=True)
