"""Checks of lesson 10: numbers worked out by hand, and an update watched from outside on a problem of two actions."""

import copy
import dataclasses
import math

import numpy as np
import torch
from torch import nn

from dualnav_lite import ppo
from dualnav_lite.check.verdict import Text, Wrong, expect, hold, shown, verdict_on
from dualnav_lite.policy import Actor, Critic
from dualnav_lite.ppo import PPO, Batch
from dualnav_lite.trunks import VectorTrunk, layer

# policy_loss(log_probs, old_log_probs, advantages, clip_range)

NEGATED = Text("a loss is made small, the objective large: minus", "损失要最小化，目标函数要最大化：取负号")
NO_CLIP = Text(
    "the gain does not end at the range: clip, and take the smaller of the two products",
    "收益没有在截断范围处封顶：要截断，并取两个乘积中较小的一个",
)
MAXIMUM = Text("take the smaller of the two products, the cautious one", "取两个乘积中较小的一个，即保守的一个")
ONLY_CLIPPED = Text(
    "keep the unclipped product too: where the clipped one is larger, it hides how wrong the policy is",
    "未截断的乘积也要保留：截断后的乘积更大时会掩盖策略的错误",
)
LOG_RATIO = Text("the ratio is exp(log_probs - old_log_probs)", "比值是 exp(log_probs - old_log_probs)")
TURNED = Text("new over old: exp(log_probs - old_log_probs)", "新除以旧：exp(log_probs - old_log_probs)")
SUM = Text("a mean over the samples, not a sum", "对样本取平均，不是求和")


def _losses(ratio: float, advantage: float) -> dict:
    """Arguments with this ratio, for four equal samples."""
    old = math.log(0.2)
    return {
        "log_probs": torch.full((4,), old + math.log(ratio)),
        "old_log_probs": torch.full((4,), old),
        "advantages": torch.full((4,), advantage),
        "clip_range": 0.2,
    }


def _usual(ratio, advantage, right):
    """Answers of the usual mistakes for these numbers."""
    clipped = min(1.2, max(0.8, ratio))
    turned = min(advantage / ratio, advantage * min(1.2, max(0.8, 1.0 / ratio)))
    return [
        (-right, NEGATED),
        (4.0 * right, SUM),
        (-max(ratio * advantage, clipped * advantage), MAXIMUM),
        (-clipped * advantage, ONLY_CLIPPED),
        (-ratio * advantage, NO_CLIP),
        (-turned, TURNED),
        (-math.log(ratio) * advantage, LOG_RATIO),
    ]


def inside_the_range_it_is_the_plain_objective(mine):
    claim = Text("ratio 1.1, advantage 2: minus 2.2", "比值 1.1、优势 2：损失为 -2.2")
    expect(claim, mine, _losses(1.1, 2.0), -2.2, _usual(1.1, 2.0, -2.2), 1e-5)


def a_good_action_gains_no_more_than_the_range(mine):
    claim = Text("ratio 1.5, advantage 2: the gain ends at 1.2", "比值 1.5、优势 2：收益在 1.2 处封顶")
    usual = [(-3.0, NO_CLIP), *_usual(1.5, 2.0, -2.4)]
    expect(claim, mine, _losses(1.5, 2.0), -2.4, usual, 1e-5)


def a_bad_action_is_never_hidden(mine):
    claim = Text("ratio 1.5, advantage -2: the full loss of 3", "比值 1.5、优势 -2：损失为完整的 3")
    expect(claim, mine, _losses(1.5, -2.0), 3.0, [(2.4, ONLY_CLIPPED), *_usual(1.5, -2.0, 3.0)], 1e-5)
    claim = Text("ratio 0.5, advantage -2: the gain ends at 0.8", "比值 0.5、优势 -2：收益在 0.8 处封顶")
    expect(claim, mine, _losses(0.5, -2.0), 1.6, _usual(0.5, -2.0, 1.6), 1e-5)


def it_can_be_differentiated(mine):
    claim = Text("the gradient reaches the log-probabilities", "梯度能传到对数概率")
    given = _losses(1.1, 2.0)
    log_probs = given["log_probs"].clone().requires_grad_(True)
    try:
        loss = mine(log_probs, *list(given.values())[1:])
        loss.backward()
    except Exception as error:
        raise verdict_on(error, claim, "", "loss.backward()") from None
    hold(claim, bool(torch.allclose(log_probs.grad, torch.full((4,), -0.55), atol=1e-4)), "", -0.55, log_probs.grad)


# value_loss(values, returns)

HALF = Text("half the squared error", "平方误差的一半")
SIGN = Text("an error costs: the loss is positive", "有误差就有损失：损失为正")
MEAN_OF_TERMS = Text("a sum over the terms, a mean over the samples", "对各项求和，对样本求平均")


def half_the_squared_error(mine):
    claim = Text("three samples, three terms, squared errors 5, 9 and 0", "三个样本、三个奖励项，平方误差为 5、9、0")
    given = {
        "values": torch.tensor([[0.0, 1.0, 2.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]),
        "returns": torch.tensor([[1.0, 1.0, 0.0], [1.0, 4.0, 1.0], [1.0, 1.0, 1.0]]),
    }
    usual = [
        (14.0 / 3.0, HALF),
        (14.0 / 9.0, MEAN_OF_TERMS),
        (7.0 / 9.0, MEAN_OF_TERMS),
        (7.0, SUM),
        (-7.0 / 3.0, SIGN),
    ]
    expect(claim, mine, given, 7.0 / 3.0, usual, 1e-5)


def no_error_no_loss(mine):
    claim = Text("values that are right cost nothing", "价值完全正确时没有损失")
    given = {"values": torch.ones(5, 2), "returns": torch.ones(5, 2)}
    expect(claim, mine, given, 0.0, [(1.0, SIGN)], 1e-6)


# update(actor, critic, optimizers, batch, settings, rng)


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


def a_problem(samples: int = 48, scale: float = 1.0):
    """Policy, values, optimisers and a batch in which action 1 was better than expected and action 0 worse."""
    with torch.random.fork_rng():
        torch.manual_seed(3)
        actor, critic = Actor(VectorTrunk(4), TwoActions(64)), Critic(VectorTrunk(4), 2)
        observations, actions = torch.randn(samples, 4), torch.arange(samples) % 2
    with torch.no_grad():
        log_probs = actor.head.judge(actor(observations), actions)[0]
        values = critic(observations)
    advantages = scale * (torch.where(actions == 1, 1.0, -1.0) + 0.5)  # not centred: normalising shows
    returns = torch.stack([torch.full((samples,), 2.0), torch.full((samples,), -1.0)], dim=1)
    batch = Batch(observations, actions, log_probs, advantages, returns, values)
    return actor, critic, (Counting(actor.parameters(), 0.1), Counting(critic.parameters(), 0.05)), batch


SETTINGS = PPO(epochs=3, minibatch=12, clip_range=0.2, entropy_coef=0.0, target_kl=10.0, threads=1)


def _updated(mine, claim, settings=SETTINGS, **changes):
    """The problem after the student's update, and what it returned."""
    actor, critic, optimizers, batch = a_problem(**changes)
    try:
        numbers = mine(actor, critic, optimizers, batch, settings, np.random.default_rng(0))
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


def advantages_are_normalised(mine):
    claim = Text(
        "advantages 100 times as large change nothing: they are normalised", "优势放大 100 倍结果不变：要先归一化"
    )
    first, second = (_updated(mine, claim, scale=scale)[0] for scale in (1.0, 100.0))
    pairs = zip(first.parameters(), second.parameters(), strict=True)
    gap = max(float((a - b).detach().abs().max()) for a, b in pairs)
    hint = Text("subtract the mean, divide by the deviation, in each minibatch", "每个小批量内减去均值，再除以标准差")
    hold(claim, gap < 1e-3, "", "0", gap, hint)


def gradients_are_clipped(mine):
    claim = Text("no gradient is longer than max_gradient_norm", "梯度长度不超过 max_gradient_norm")
    small = SETTINGS.model_copy(update={"max_gradient_norm": 0.01})
    _, _, optimizers, _, _ = _updated(mine, claim, small)
    longest = max(one.longest for one in optimizers)
    hint = Text(
        "`torch.nn.utils.clip_grad_norm_` of each network before its step",
        "每个网络更新前调用 `torch.nn.utils.clip_grad_norm_`",
    )
    hold(claim, longest <= 0.0101, "", "<= 0.01", longest, hint)


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


def the_batch_stays_as_it_was(mine):
    claim = Text("the batch is the same afterwards", "更新后批数据保持不变")
    _, _, _, fresh = a_problem()
    batch = _updated(mine, claim)[3]
    for field in dataclasses.fields(Batch):
        before, after = getattr(fresh, field.name), getattr(batch, field.name)
        is_same = before is None or bool(torch.equal(before, after))
        hint = Text("work on copies", "请在副本上计算")
        hold(claim, is_same, field.name, copy.copy(before), after, hint)


CHECKS = {
    "policy_loss": [
        inside_the_range_it_is_the_plain_objective,
        a_good_action_gains_no_more_than_the_range,
        a_bad_action_is_never_hidden,
        it_can_be_differentiated,
    ],
    "value_loss": [half_the_squared_error, no_error_no_loss],
    "update": [
        every_epoch_takes_every_minibatch,
        better_actions_become_likelier,
        values_come_closer_to_the_returns,
        advantages_are_normalised,
        gradients_are_clipped,
        it_stops_where_the_policy_has_moved_too_far,
        numbers_say_what_happened,
        the_batch_stays_as_it_was,
        entropy_is_worth_something,
    ],
}
REFERENCES = {"policy_loss": ppo.policy_loss, "value_loss": ppo.value_loss, "update": ppo.update}
