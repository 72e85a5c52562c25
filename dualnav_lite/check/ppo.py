"""Checks of lesson 10's losses: numbers worked out by hand."""

import math

import torch

from dualnav_lite import ppo
from dualnav_lite.check import ppo_update
from dualnav_lite.check.verdict import Text, expect, hold, verdict_on

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


CHECKS = {
    "policy_loss": [
        inside_the_range_it_is_the_plain_objective,
        a_good_action_gains_no_more_than_the_range,
        a_bad_action_is_never_hidden,
        it_can_be_differentiated,
    ],
    "value_loss": [half_the_squared_error, no_error_no_loss],
    "update": ppo_update.PROPERTIES,
}
REFERENCES = {"policy_loss": ppo.policy_loss, "value_loss": ppo.value_loss, "update": ppo.update}
