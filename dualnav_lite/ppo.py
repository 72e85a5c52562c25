"""Proximal policy optimisation from scratch (Schulman et al., "Proximal policy optimization algorithms", 2017).

 #  detail                                                                  source
 1  many worlds, rollouts of a fixed length; nothing waits for an            Huang et al., "The 37 implementation
    episode's end (the article's `t % 512` with t < 500 never updates)       details of PPO", 2022, detail 1
 2  orthogonal weights, zero biases, gain 0.01 before the actions            37 details, 2
 3  Adam with epsilon 1e-5, learning rate falling to zero                    37 details, 3 and 4
 4  GAE; a terminated step has no future, a truncated one is worth the       Schulman et al. 2016; Pardo et al., "Time
    value of its own last observation                                        limits in reinforcement learning", 2018
 5  one value head a reward term; GAE is linear, so the weighted sum of      ARTICLE_NOTES 11; `rollout.gae`
    the terms' advantages is the advantage of the weighted sum
 6  rewards divided by the running deviation of each term's discounted       Engstrom et al., "Implementation matters",
    return, the mean kept                                                    2020; ARTICLE_NOTES 9
 7  minibatches drawn without repetition, in K epochs                        37 details, 6
 8  advantages normalised in each minibatch                                  37 details, 7
 9  clipped surrogate objective (`policy_loss`)                              Schulman et al. 2017, eq. 7
10  plain squared value loss, not clipped                                    Andrychowicz et al., "What matters in
                                                                             on-policy RL", 2021
11  entropy bonus                                                            Schulman et al. 2017, eq. 9
12  gradients clipped to a norm, a network apart                             37 details, 11
13  the policy's epochs end where it has moved too far (KL)                  Dossa et al. 2021; k3 estimator of
                                                                             Schulman, "Approximating KL", 2020
14  two networks, two optimisers, two learning rates; neither waits for      article 3.2 (3e-4 and 1e-3)
    the other, so each has a core
15  a minibatch goes through in micro-batches that fit the cache             same gradient, by linearity of the mean
16  optional: a penalty on the distance (KL) to a reference policy, so       Baker et al., "Video pretraining", 2022
    that a warm start is not forgotten before the values are learned

What the logged numbers mean: `policy_loss` and `value_loss` as minimised; `entropy` [nat]; `approx_kl` [nat] between
the policy that drove and the one after the update; `clip_fraction`, share of samples outside the clip range;
`explained_variance` of the returns by the values that the rollout saw, 1 is perfect, 0 no better than a constant;
`reference_kl` [nat] to the reference policy; `epochs`, how many the KL stop left.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field, PositiveInt

from dualnav_lite.config import Frozen, NonNegative, Positive, Share
from dualnav_lite.policy import Actor, Critic
from dualnav_lite.rollout import Rollout
from dualnav_lite.trunks import Seen, device_of, joined, looked


class PPO(Frozen):
    """Settings of the update; the article's where it names one."""

    learning_rate_actor: Positive = 3e-4  # article 3.2
    learning_rate_critic: Positive = 1e-3  # article 3.2
    gamma: Annotated[float, Field(gt=0, le=1)] = 0.99  # article 3.2
    gae_lambda: Share = 0.95
    epochs: PositiveInt = 4  # the article's K_epochs is 10
    clip_range: Positive = 0.15  # article 3.2
    minibatch: PositiveInt = 512  # the article's batch
    micro_batch: PositiveInt = 64
    entropy_coef: NonNegative = 0.01
    reference_coef: NonNegative = 0.0  # of the KL to the reference policy, where there is one
    max_gradient_norm: Positive = 0.5
    target_kl: Positive = 0.02
    weigh_scaled: bool = False  # weights multiply scaled terms (importance) or raw ones (the environment's reward)
    estimator: Literal["gae", "returns"] = "gae"  # `returns`: lambda 1, the article's 'PPO2'
    threads: Annotated[int, Field(ge=1, le=2)] = 2  # 2: policy and values learn side by side


@dataclass
class Batch:
    """A rollout, flattened to samples.

    Attributes:
        observations: N of them, (N, ...) or as the networks' trunks take them (`trunks.Seen`); rows of either go into
            the networks: `actor(observations[rows])`.
        actions, log_probs: as drawn; advantages: (N,); returns, values: (N, terms);
        reference: (N, ...) distribution parameters of the reference policy, or None.
    """

    observations: torch.Tensor | Seen
    actions: torch.Tensor
    log_probs: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor
    values: torch.Tensor
    reference: torch.Tensor | None = None

    @classmethod
    def of(
        cls, rollout: Rollout, settings: PPO, actor: Actor, deviations=None, reference: Actor | None = None
    ) -> "Batch":
        """Samples of a rollout with their advantages and returns, on the actor's device and as its trunk takes them."""
        gae_lambda = 1.0 if settings.estimator == "returns" else settings.gae_lambda
        advantages, returns = rollout.estimate(settings.gamma, gae_lambda, deviations, settings.weigh_scaled)
        device = device_of(actor)
        seen = joined([looked(actor, one) for one in rollout.observations])
        drawn = [torch.from_numpy(np.concatenate(part)).to(device) for part in (rollout.actions, rollout.log_probs)]
        values = torch.from_numpy(np.concatenate(rollout.values)).float()
        scalars = [torch.from_numpy(advantages), torch.from_numpy(returns), values]
        batch = cls(seen, *drawn, *(part.to(device) for part in scalars))
        if reference is not None:
            with torch.no_grad():
                batch.reference = torch.cat([reference(part) for part in batch.observations.split(256)])
        return batch


def policy_loss(log_probs, old_log_probs, advantages, clip_range: float):
    """Clipped surrogate objective, negated, a mean over the samples (detail 9).

    L = -mean min(r A, clip(r, 1 - eps, 1 + eps) A) with r = pi(a|s) / pi_old(a|s).
    """
    ratio = torch.exp(log_probs - old_log_probs)
    clipped = torch.clamp(ratio, 1.0 - clip_range, 1.0 + clip_range)
    return -torch.minimum(ratio * advantages, clipped * advantages).mean()


def value_loss(values, returns):
    """Half the squared error, summed over the terms, a mean over the samples (detail 10)."""
    return 0.5 * ((values - returns) ** 2).sum(dim=1).mean()


def normalised(advantages):
    """Advantages with mean 0 and deviation 1 (detail 8)."""
    return (advantages - advantages.mean()) / (advantages.std(unbiased=False) + 1e-8)


def explained_variance(values, returns) -> float:
    """1 - var(returns - values) / var(returns), over samples and terms."""
    spread = returns.var(dim=0, unbiased=False).sum()
    return float(1.0 - (returns - values).var(dim=0, unbiased=False).sum() / (spread + 1e-8))


def update_policy(actor: Actor, optimizer, batch: Batch, settings: PPO, rng) -> dict[str, float]:
    """K epochs on the policy; what was measured, means over the minibatches of the last epoch that was begun."""
    numbers: dict[str, float] = {}
    for epoch in range(settings.epochs):
        sums: dict[str, float] = {}
        minibatches = _minibatches(len(batch.log_probs), settings.minibatch, rng)
        for rows in minibatches:
            advantages = normalised(batch.advantages[rows])
            optimizer.zero_grad(set_to_none=True)
            found = dict.fromkeys(("policy_loss", "entropy", "approx_kl", "clip_fraction", "reference_kl"), 0.0)
            for part in torch.arange(len(rows)).split(settings.micro_batch):
                chosen, share = rows[part], len(part) / len(rows)
                parameters = actor(batch.observations[chosen])
                log_probs, entropies = actor.head.judge(parameters, batch.actions[chosen])
                old = batch.log_probs[chosen]
                loss = policy_loss(log_probs, old, advantages[part], settings.clip_range)
                total = loss - settings.entropy_coef * entropies.mean()
                if batch.reference is not None:
                    distance = actor.head.divergence(batch.reference[chosen], parameters).mean()
                    total = total + settings.reference_coef * distance
                    found["reference_kl"] += share * distance.item()
                (share * total).backward()
                log_ratio = (log_probs - old).detach()
                found["policy_loss"] += share * loss.item()
                found["entropy"] += share * entropies.mean().item()
                found["approx_kl"] += share * (torch.expm1(log_ratio) - log_ratio).mean().item()
                outside = torch.expm1(log_ratio).abs() > settings.clip_range
                found["clip_fraction"] += share * outside.float().mean().item()
            _finite("policy loss", found["policy_loss"])
            for name, value in found.items():
                sums[name] = sums.get(name, 0.0) + value / len(minibatches)
            if found["approx_kl"] > 1.5 * settings.target_kl:
                return {**found, "epochs": epoch + 1}
            torch.nn.utils.clip_grad_norm_(actor.parameters(), settings.max_gradient_norm)
            optimizer.step()
        numbers = {**sums, "epochs": epoch + 1}
    return numbers


def update_values(critic: Critic, optimizer, batch: Batch, settings: PPO, rng) -> dict[str, float]:
    """K epochs on the value heads; the loss of the last one."""
    mean = 0.0
    for _ in range(settings.epochs):
        minibatches, mean = _minibatches(len(batch.log_probs), settings.minibatch, rng), 0.0
        for rows in minibatches:
            optimizer.zero_grad(set_to_none=True)
            for chosen in rows.split(settings.micro_batch):
                share = len(chosen) / len(rows)
                loss = share * value_loss(critic(batch.observations[chosen]), batch.returns[chosen])
                loss.backward()
                mean += loss.item() / len(minibatches)
            _finite("value loss", mean)
            torch.nn.utils.clip_grad_norm_(critic.parameters(), settings.max_gradient_norm)
            optimizer.step()
    return {"value_loss": mean, "explained_variance": explained_variance(batch.values, batch.returns)}


def update(actor: Actor, critic: Critic, optimizers, batch: Batch, settings: PPO, rng, only_values: bool = False):
    """Learn from one batch.

    Args:
        actor, critic: trained in place.
        optimizers: one for each (`make_optimizers`).
        batch: samples of one rollout.
        settings: see `PPO`.
        rng: numpy generator for the minibatches; policy and values draw from its two children, so the result is the
            same with one thread and with two.
        only_values: leave the policy as it is, as after a warm start whose values are still unknown.

    Returns:
        dict of the numbers listed in this file's head.

    Raises:
        FloatingPointError: a loss that is no number, named.
    """
    for_policy, for_values = rng.spawn(2)
    values_job = partial(update_values, critic, optimizers[1], batch, settings, for_values)
    if only_values:
        return values_job()
    policy_job = partial(update_policy, actor, optimizers[0], batch, settings, for_policy)
    if settings.threads == 1:
        return {**policy_job(), **values_job()}
    with ThreadPoolExecutor(2) as pool:
        results = [one.result() for one in (pool.submit(policy_job), pool.submit(values_job))]
    return {**results[0], **results[1]}


def make_optimizers(actor: Actor, critic: Critic, settings: PPO):
    """Adam for the policy and for the values (details 3 and 14)."""
    return (
        torch.optim.Adam(actor.parameters(), lr=settings.learning_rate_actor, eps=1e-5),
        torch.optim.Adam(critic.parameters(), lr=settings.learning_rate_critic, eps=1e-5),
    )


def set_rates(optimizers, settings: PPO, share: float) -> None:
    """Give both optimisers this share of their learning rates (detail 3)."""
    for optimizer, rate in zip(optimizers, (settings.learning_rate_actor, settings.learning_rate_critic), strict=True):
        for group in optimizer.param_groups:
            group["lr"] = rate * share


def _minibatches(samples: int, size: int, rng) -> list[torch.Tensor]:
    """Rows of each minibatch, all samples once, in a new order."""
    order = torch.from_numpy(rng.permutation(samples))
    return list(order.split(size))


def _finite(name: str, value: float) -> None:
    if not np.isfinite(value):
        raise FloatingPointError(f"the {name} is {value}")
