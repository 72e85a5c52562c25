"""Checks of lesson 10's update, watched from outside on a problem of two actions."""

import copy
import dataclasses
import math

import numpy as np
import torch
from torch import nn

from dualnav_lite.check.verdict import Text, Wrong, hold, shown, verdict_on
from dualnav_lite.policy import Actor, Critic
from dualnav_lite.ppo import PPO, Batch
from dualnav_lite.trunks import VectorTrunk, layer

# update(actor, critic, optimizers, batch, settings, rng)

SETTINGS = PPO(epochs=3, minibatch=12, clip_range=0.2, entropy_coef=0.0, target_kl=10.0, threads=1)
NEGATED = Text("a loss is made small, the objective large: minus", "损失要最小化，目标函数要最大化：取负号")


class TwoActions(nn.Module):
    """A head with two actions, for a problem small enough to be looked at."""

    def __init__(self, features: int):
        super().__init__()
        self.linear = layer(nn.Linear(features, 2), gain=0.01)

    def forward(self, features):
        """(n, 2) log-probabilities."""
        return torch.log_softmax(self.linear(features), dim=1)

    def judge(self, log_probabilities, actions):
        """(n,) log-probability of each action and (n,) entropy."""
        entropies = -(log_probabilities.exp() * log_probabilities).sum(dim=1)
        return log_probabilities.gather(1, actions.long()[:, None])[:, 0], entropies


class Counting(torch.optim.SGD):
    """Plain gradient descent that counts its steps and remembers the longest gradient."""

    def __init__(self, parameters, rate: float):
        super().__init__(parameters, lr=rate)
        self.steps, self.longest = 0, 0.0

    def step(self, closure=None):
        """Count, look, and step."""
        gradients = [one.grad.norm() for group in self.param_groups for one in group["params"] if one.grad is not None]
        self.longest = max(self.longest, float(torch.stack(gradients).norm()) if gradients else 0.0)
        self.steps += 1
        return super().step(closure)


def a_problem(samples: int = 48, scale: float = 1.0, shift: float = 0.0, first: float = 0.0):
    """Policy, values, optimisers and a batch in which action 1 was better than expected and action 0 worse.

    `scale` multiplies all advantages, `shift` adds to all, `first` to those of the first minibatch.
    """
    with torch.random.fork_rng():
        torch.manual_seed(3)
        actor, critic = Actor(VectorTrunk(4), TwoActions(64)), Critic(VectorTrunk(4), 2)
        observations, actions = torch.randn(samples, 4), torch.arange(samples) % 2
    with torch.no_grad():
        log_probs = actor.head.judge(actor(observations), actions)[0]
        values = critic(observations)
    advantages = scale * (torch.where(actions == 1, 1.0, -1.0) + 0.5) + shift  # not centred: normalising shows
    advantages[: SETTINGS.minibatch] += first
    returns = torch.stack([torch.full((samples,), 2.0), torch.full((samples,), -1.0)], dim=1)
    batch = Batch(observations, actions, log_probs, advantages, returns, values)
    return actor, critic, (Counting(actor.parameters(), 0.1), Counting(critic.parameters(), 0.05)), batch


class InOrder:
    """In place of a generator: what it mixes stays in order, so that it is known which samples share a minibatch."""

    def permutation(self, samples):
        """The samples, or the numbers below a number, as they come."""
        return np.arange(samples) if np.ndim(samples) == 0 else np.array(samples)

    def shuffle(self, samples) -> None:
        """Nothing moves."""

    def spawn(self, count: int) -> list:
        """As many more of its kind."""
        return [InOrder() for _ in range(count)]


def _updated(mine, claim, settings=SETTINGS, rng=None, **changes):
    """The problem after the student's update, and what it returned."""
    actor, critic, optimizers, batch = a_problem(**changes)
    try:
        numbers = mine(actor, critic, optimizers, batch, settings, rng or np.random.default_rng(0))
    except Exception as error:
        raise verdict_on(error, claim, shown(settings.model_dump()), "") from None
    if numbers is None:
        raise Wrong(claim, "", "a dictionary of numbers", "None", Text("return the numbers", "请用 return 返回这些数"))
    return actor, critic, optimizers, batch, numbers


def every_epoch_takes_every_minibatch(mine):
    claim = Text(
        "48 samples, minibatches of 12, 3 epochs: 12 steps of each optimiser",
        "48 个样本、小批量为 12、3 轮：两个优化器各 12 步",
    )
    _, _, optimizers, _, _ = _updated(mine, claim)
    steps = tuple(one.steps for one in optimizers)
    hints = {
        (3, 3): Text("split each epoch into minibatches", "每一轮都要分成小批量"),
        (12, 0): Text("the critic learns as well", "价值网络也要学习"),
        (0, 12): Text("the policy learns as well", "策略网络也要学习"),
        (0, 0): Text("call `step()` of the optimisers", "要调用优化器的 `step()`"),
    }
    once = Text("K epochs: go through the batch several times", "K 轮：同一批数据要用多次")
    hold(claim, steps == (12, 12), "", "(12, 12)", str(steps), hints.get(steps, once))


def better_actions_become_likelier(mine):
    claim = Text("the action with the better advantage becomes likelier", "优势更大的动作概率变大")
    actor, _, _, batch, _ = _updated(mine, claim)
    with torch.no_grad():
        share = float(actor(batch.observations).exp()[:, 1].mean())
    hint = Text("the loss is minimised: is a sign turned round?", "损失是要最小化的：符号反了吗？")
    hold(claim, share > 0.51, "", "> 0.51", share, hint)


def values_come_closer_to_the_returns(mine):
    claim = Text("the values come closer to the returns", "价值更接近回报")
    _, critic, _, batch, _ = _updated(mine, claim)
    with torch.no_grad():
        before = float(((batch.values - batch.returns) ** 2).mean())
        after = float(((critic(batch.observations) - batch.returns) ** 2).mean())
    hold(claim, after < 0.95 * before, "", f"< {0.95 * before:.3f}", after, NEGATED)


def _gap(one, other) -> float:
    """Largest difference between the parameters of two networks."""
    pairs = zip(one.parameters(), other.parameters(), strict=True)
    return max(float((a - b).detach().abs().max()) for a, b in pairs)


def the_generator_gives_the_order(mine):
    claim = Text("the same generator gives the same update", "同样的随机数生成器得到同样的更新")
    first, second = (_updated(mine, claim)[0] for _ in range(2))
    hint = Text("mix by `rng.permutation`, and by nothing else", "只用 `rng.permutation` 打乱次序")
    hold(claim, _gap(first, second) < 1e-6, "", "0", _gap(first, second), hint)
    claim = Text("another generator gives another order", "另一个随机数生成器给出另一种次序")
    gap = _gap(first, _updated(mine, claim, rng=np.random.default_rng(1))[0])
    hint = Text("put the samples into a new order, `rng.permutation(N)`", "用 `rng.permutation(N)` 打乱样本的次序")
    hold(claim, gap > 1e-6, "", "> 0", gap, hint)


def advantages_are_normalised(mine):
    hint = Text("subtract the mean, divide by the deviation, in each minibatch", "每个小批量内减去均值，再除以标准差")
    changes = {
        "scale": (100.0, Text("advantages 100 times as large change nothing", "优势放大 100 倍，结果不变")),
        "shift": (3.0, Text("3 more on every advantage changes nothing", "每个优势都加 3，结果不变")),
        "first": (30.0, Text("30 more on those of one minibatch changes nothing", "某个小批量的优势加 30，结果不变")),
    }
    for name, (value, claim) in changes.items():
        plain = _updated(mine, claim, rng=InOrder())[0]
        changed = _updated(mine, claim, rng=InOrder(), **{name: value})[0]
        hold(claim, _gap(plain, changed) < 1e-3, "", "0", _gap(plain, changed), hint)


def gradients_are_clipped(mine):
    claim = Text("no gradient is longer than max_gradient_norm", "梯度长度不超过 max_gradient_norm")
    small = SETTINGS.model_copy(update={"max_gradient_norm": 0.01})
    _, _, optimizers, _, _ = _updated(mine, claim, small)
    longest = [one.longest for one in optimizers]
    hint = Text(
        "`torch.nn.utils.clip_grad_norm_` of each network before its step",
        "每个网络更新前调用 `torch.nn.utils.clip_grad_norm_`",
    )
    hold(claim, max(longest) <= 0.0101, "", "<= 0.01", max(longest), hint)
    claim = Text("longer gradients are cut to it, policy and values apart", "更长的梯度截到这个长度，两个网络分开截")
    hold(claim, min(longest) >= 0.0099, "", "0.01, 0.01", np.array(longest), hint)


def entropy_is_worth_something(mine):
    claim = Text("with entropy_coef of 5 the policy stays closer to even", "entropy_coef 为 5 时策略更接近均匀")
    shares = []
    for worth in (0.0, 5.0):
        actor, _, _, batch, _ = _updated(mine, claim, SETTINGS.model_copy(update={"entropy_coef": worth}))
        with torch.no_grad():
            shares.append(float(actor(batch.observations).exp()[:, 1].mean()))
    hint = Text(
        "the policy's loss is policy_loss minus settings.entropy_coef times the mean entropy",
        "策略的损失是 policy_loss 减去 settings.entropy_coef 乘平均熵",
    )
    hold(claim, shares[1] < shares[0] - 0.01, "", f"< {shares[0]:.3f}", shares[1], hint)


def it_stops_where_the_policy_has_moved_too_far(mine):
    claim = Text("with target_kl of 0.0001 the policy's epochs end early", "target_kl 为 0.0001 时策略提前停止更新")
    strict = SETTINGS.model_copy(update={"target_kl": 1e-4, "epochs": 30})
    optimizers = _updated(mine, claim, strict)[2]
    hint = Text("stop when approx_kl exceeds 1.5 target_kl", "approx_kl 超过 1.5 倍 target_kl 就停止")
    wanted = Text("fewer than 60 steps", "少于 60 步")
    hold(claim, 0 < optimizers[0].steps < 60, "", wanted, optimizers[0].steps, hint)


def numbers_say_what_happened(mine):
    claim = Text(
        "it returns policy_loss, value_loss, entropy and approx_kl", "返回 policy_loss、value_loss、entropy、approx_kl"
    )
    numbers = _updated(mine, claim)[4]
    wanted = {"policy_loss", "value_loss", "entropy", "approx_kl"}
    is_there = isinstance(numbers, dict) and wanted <= set(numbers)
    hold(claim, is_there, "", ", ".join(sorted(wanted)), numbers)
    finite = all(math.isfinite(float(numbers[name])) for name in wanted)
    hold(claim, finite, "", "", numbers)


def the_divergence_is_a_mean_before_the_step(mine):
    claim = Text(
        "one minibatch, 21 epochs: approx_kl is the mean of r - 1 - ln r after 20 steps",
        "一个小批量、21 轮：approx_kl 是走 20 步之后 r - 1 - ln r 的平均",
    )
    settings = SETTINGS.model_copy(update={"minibatch": 48, "epochs": 20})
    actor, _, _, batch, _ = _updated(mine, claim, settings)
    numbers = _updated(mine, claim, settings.model_copy(update={"epochs": 21}))[4]
    with torch.no_grad():
        change = actor.head.judge(actor(batch.observations), batch.actions)[0] - batch.log_probs
    wanted, told = float((torch.expm1(change) - change).mean()), float(numbers["approx_kl"])
    hint = Text(
        "r is the new probability over the old one; take the mean before the step, over the minibatch",
        "r 是新概率除以旧概率；在更新之前、在小批量上取平均",
    )
    hold(claim, abs(told - wanted) < 0.01 * wanted, "", wanted, told, hint)


def the_batch_stays_as_it_was(mine):
    claim = Text("the batch is the same afterwards", "更新后批数据保持不变")
    _, _, _, fresh = a_problem()
    batch = _updated(mine, claim)[3]
    for field in dataclasses.fields(Batch):
        before, after = getattr(fresh, field.name), getattr(batch, field.name)
        is_same = before is None or bool(torch.equal(before, after))
        hint = Text("work on copies", "请在副本上计算")
        hold(claim, is_same, field.name, copy.copy(before), after, hint)


PROPERTIES = [
    every_epoch_takes_every_minibatch,
    better_actions_become_likelier,
    values_come_closer_to_the_returns,
    the_generator_gives_the_order,
    advantages_are_normalised,
    gradients_are_clipped,
    it_stops_where_the_policy_has_moved_too_far,
    numbers_say_what_happened,
    the_divergence_is_a_mean_before_the_step,
    the_batch_stays_as_it_was,
    entropy_is_worth_something,
]
