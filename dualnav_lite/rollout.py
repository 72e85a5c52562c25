"""Fixed-length rollouts over parallel worlds, and what was better than expected in them (GAE)."""

from dataclasses import dataclass, field

import numpy as np


def gae(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    """Generalised advantage estimates and the returns that the value heads learn.

    delta_t = r_t + gamma (1 - terminated_t) V(s'_t) - V(s_t);  A_t = delta_t + gamma lambda (1 - ended_t) A_{t+1}.
    A terminated step has no future; a truncated one has, so the value of the state it ended in counts, but the
    advantages of the next episode do not. Everything is linear in rewards and values, so the terms of a vector reward
    may be estimated side by side and summed afterwards.

    Args:
        rewards, values: (steps, n) or (steps, n, terms); values are V(s_t).
        next_values: the same shape, V of the state that each step led to: of the *last* observation of an episode
            where it ended, never of the first one of the next.
        terminated, truncated: (steps, n) bool.
        gamma: discount; gae_lambda: 0 trusts the values alone (one step), 1 the rewards alone.

    Returns:
        advantages and returns (advantages + values), float64 arrays of the shape of `rewards`.

    Raises:
        ValueError: shapes that do not fit each other.

    Source: Schulman et al., "High-dimensional continuous control using generalized advantage estimation", 2016, eq. 16.
    """
    rewards, values, next_values, terminated, truncated = _checked(rewards, values, next_values, terminated, truncated)
    deltas = rewards + gamma * np.where(terminated, 0.0, next_values) - values
    carry = gamma * gae_lambda * ~(terminated | truncated)
    advantages = np.empty_like(deltas)
    running = np.zeros_like(deltas[0])
    for t in reversed(range(len(deltas))):
        running = deltas[t] + carry[t] * running
        advantages[t] = running
    return advantages, advantages + values


def gae_reference(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    """`gae` as the paper defines it: from every step on, a sum of (gamma lambda)^l delta until the episode ends."""
    rewards, values, next_values, terminated, truncated = _checked(rewards, values, next_values, terminated, truncated)
    advantages = np.zeros_like(rewards)
    for index in np.ndindex(rewards.shape):
        start, rest = index[0], index[1:]
        factor = 1.0
        for t in range(start, len(rewards)):
            here = (t, *rest)
            flags = (t, rest[0], *([0] * (len(rest) - 1)))
            future = 0.0 if terminated[flags] else next_values[here]
            advantages[index] += factor * (rewards[here] + gamma * future - values[here])
            if terminated[flags] or truncated[flags]:
                break
            factor *= gamma * gae_lambda
    return advantages, advantages + values


def _checked(rewards, values, next_values, terminated, truncated):
    """The arguments of `gae` as arrays, the flags with a last axis of one where the rewards have terms."""
    rewards, values, next_values = (np.asarray(a, np.float64) for a in (rewards, values, next_values))
    terminated, truncated = np.asarray(terminated, bool), np.asarray(truncated, bool)
    if rewards.ndim not in (2, 3) or not rewards.shape == values.shape == next_values.shape:
        raise ValueError(
            "rewards, values and next_values must share a shape (steps, n) or (steps, n, terms), got "
            f"{rewards.shape}, {values.shape}, {next_values.shape}"
        )
    if terminated.shape != rewards.shape[:2] or truncated.shape != rewards.shape[:2]:
        raise ValueError(
            f"terminated and truncated must be {rewards.shape[:2]}, got {terminated.shape}, {truncated.shape}"
        )
    if rewards.ndim == 3:
        terminated, truncated = terminated[..., None], truncated[..., None]
    return rewards, values, next_values, terminated, truncated


class RunningDeviation:
    """Standard deviation of the discounted return of each reward term, over all steps seen so far.

    Rewards divided by it give the value heads targets of one size, whatever the units. The mean is kept: taking it
    away, as the article's 4.1 does, makes always safe and always unsafe worth the same.

    Args:
        num_envs: worlds n whose returns are followed.
        terms: number of reward terms.
        gamma: discount.

    Source: the reward scaling of OpenAI baselines' VecNormalize; Engstrom et al., "Implementation matters", 2020.
    """

    def __init__(self, num_envs: int, terms: int, gamma: float = 0.99):
        self._gamma = gamma
        self._returns = np.zeros((num_envs, terms))
        self.count = 0.0
        self.mean = np.zeros(terms)
        self.square_sum = np.zeros(terms)  # of the distances to the mean

    def update(self, rewards, ended) -> None:
        """Take in one step.

        Args:
            rewards: (n, terms).
            ended: (n,) bool; the returns of these worlds begin anew.
        """
        self._returns = self._returns * self._gamma + rewards
        n, batch_mean = len(rewards), self._returns.mean(axis=0)
        gap, total = batch_mean - self.mean, self.count + n
        # Chan et al. 1979, eq. 2.1: the sums of two samples into that of their union.
        self.square_sum += ((self._returns - batch_mean) ** 2).sum(axis=0) + gap**2 * self.count * n / total
        self.mean += gap * n / total
        self.count = total
        self._returns[ended] = 0.0

    @property
    def deviations(self) -> np.ndarray:
        """(terms,) standard deviations; 1 for a term that never varied."""
        found = np.sqrt(self.square_sum / max(self.count, 1.0))
        return np.where(found > 1e-8, found, 1.0)

    def restart(self) -> None:
        """Begin all returns anew, as when every world is reset."""
        self._returns[:] = 0.0

    def state_dict(self) -> dict:
        """What a checkpoint keeps; taken where all worlds are reset, so running returns are not part of it."""
        return {"count": self.count, "mean": self.mean.tolist(), "square_sum": self.square_sum.tolist()}

    def load_state_dict(self, state: dict) -> None:
        """Go on from a checkpoint."""
        self.count = float(state["count"])
        self.mean, self.square_sum = np.array(state["mean"]), np.array(state["square_sum"])
        self.restart()


@dataclass
class Rollout:
    """What n worlds did in a fixed number of steps; every list gets one entry a step.

    Attributes:
        observations: (n, ...) float32, what the policy saw.
        actions: (n, ...) what its distribution gave, before the head turned it into a command.
        log_probs: (n,) of those actions when they were drawn.
        rewards: (n, terms), unscaled and unweighted.
        weights: (n, terms) of the terms.
        values, next_values: (n, terms), as `gae` wants them.
        terminated, truncated: (n,) bool.
    """

    observations: list[np.ndarray] = field(default_factory=list)
    actions: list[np.ndarray] = field(default_factory=list)
    log_probs: list[np.ndarray] = field(default_factory=list)
    rewards: list[np.ndarray] = field(default_factory=list)
    weights: list[np.ndarray] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    next_values: list[np.ndarray] = field(default_factory=list)
    terminated: list[np.ndarray] = field(default_factory=list)
    truncated: list[np.ndarray] = field(default_factory=list)

    def add(self, **step) -> None:
        """Append one step; every field must be there."""
        if set(step) != set(vars(self)):
            raise ValueError(f"a step lacks or has too much of {sorted(set(step) ^ set(vars(self)))}")
        for name, value in step.items():
            getattr(self, name).append(value)

    def __len__(self) -> int:
        return len(self.rewards)

    def estimate(self, gamma: float, gae_lambda: float, deviations=None, weigh_scaled: bool = True):
        """Scalar advantages for the policy and returns for each value head.

        Args:
            gamma, gae_lambda: as in `gae`.
            deviations: (terms,) by which the rewards are divided for the value heads; None for ones.
            weigh_scaled: weights multiply scaled terms, so that they mean importance whatever the units; else raw
                terms, so that the sum is the environment's reward.

        Returns:
            advantages (steps * n,) and returns (steps * n, terms) float32, step-major.
        """
        rewards, weights = np.stack(self.rewards), np.stack(self.weights)
        deviations = np.ones(rewards.shape[-1]) if deviations is None else np.asarray(deviations)
        advantages, returns = gae(
            rewards / deviations,
            np.stack(self.values),
            np.stack(self.next_values),
            np.stack(self.terminated),
            np.stack(self.truncated),
            gamma,
            gae_lambda,
        )
        if not weigh_scaled:
            weights = weights * deviations
        summed = (advantages * weights).sum(axis=-1)
        return summed.reshape(-1).astype(np.float32), returns.reshape(-1, returns.shape[-1]).astype(np.float32)
