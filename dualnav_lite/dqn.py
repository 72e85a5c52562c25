"""Deep Q-learning from scratch, for a choice among a few actions (Mnih et al., "Human-level control", Nature, 2015).

 #  detail                                                                  source
 1  a network gives the value Q(s, a) of every action at once; the policy    Mnih et al. 2015
    takes the best, or with a falling probability epsilon any
 2  transitions are kept and drawn again at random (experience replay), so   Lin, "Self-improving reactive agents", 1992
    that a minibatch is not one episode's neighbouring steps
 3  the target r + gamma Q'(s', a') comes from a second network that         Mnih et al. 2015; the slow way of following
    follows slowly                                                           by Lillicrap et al., "DDPG", 2016
 4  a' is chosen by the first network and valued by the second; one network  van Hasselt, Guez, Silver, "Double
    doing both believes its own luckiest error                               Q-learning", 2016
 5  a terminated step has no future; a truncated one is worth the value of   Pardo et al., "Time limits in
    its own last observation                                                 reinforcement learning", 2018
 6  Huber loss: one wild target does not throw the network                   Mnih et al. 2015 (clipped errors)
 7  actions that do not exist in a state are never drawn nor valued          streets end; a mask says where

What it cannot do is the reason why the kit drives by PPO: a command lies between the few that exist, so a robot on DQN
jerks from one to the next (`beyond algorithms` measures how much).
"""

from collections.abc import Callable

import numpy as np
import torch
from pydantic import PositiveInt
from torch import nn

from dualnav_lite.config import Frozen, Positive, Share


class DQN(Frozen):
    """Settings of the learner."""

    learning_rate: Positive = 5e-4
    gamma: Share = 0.99
    buffer: PositiveInt = 100_000  # transitions kept
    minibatch: PositiveInt = 128
    train_every: PositiveInt = 4  # steps of the worlds, taken together, between two minibatches
    learning_starts: PositiveInt = 2_000
    target_rate: Share = 0.005  # share by which the second network follows the first after each minibatch
    epsilon_end: Share = 0.05
    exploration: Share = 0.4  # share of the steps in which epsilon falls from 1 to its end
    max_gradient_norm: Positive = 10.0


class QNetwork(nn.Module):
    """Values of all actions.

    Args:
        observation_shape: (size,).
        actions: how many there are.
        mask: maps (n, ...) observations to (n, actions) bool, which of them exist; None: all.
        hidden: width of the two hidden layers.
    """

    def __init__(self, observation_shape, actions: int, mask: Callable | None = None, hidden: int = 128):
        super().__init__()
        self.actions, self._mask = actions, mask
        first, second = nn.Linear(observation_shape[0], hidden), nn.Linear(hidden, hidden)
        self.layers = nn.Sequential(first, nn.ReLU(), second, nn.ReLU(), nn.Linear(hidden, actions))

    def forward(self, observations):
        """(n, actions) values; -inf for those that do not exist."""
        values = self.layers(observations)
        if self._mask is not None:
            values = values.masked_fill(~self._mask(observations), -torch.inf)
        return values

    def best(self, observations) -> np.ndarray:
        """(n,) the best action of each of (n, ...) observations, an array."""
        with torch.no_grad():
            return self(torch.from_numpy(np.asarray(observations, np.float32))).argmax(dim=1).numpy()


class ReplayBuffer:
    """The last transitions, drawn at random (detail 2); the oldest make room."""

    def __init__(self, size: int, observation_shape):
        self.observations = np.zeros((size, *observation_shape), np.float32)
        self.next_observations = np.zeros_like(self.observations)
        self.actions = np.zeros(size, np.int64)
        self.rewards = np.zeros(size, np.float32)
        self.terminated = np.zeros(size, bool)
        self.count, self._next = 0, 0

    def add(self, observations, actions, rewards, next_observations, terminated) -> None:
        """Keep n transitions; `next_observations` are those the step led to, the last ones where an episode ended."""
        size = len(self.actions)
        at = (self._next + np.arange(len(actions))) % size
        for kept, values in (
            (self.observations, observations),
            (self.actions, actions),
            (self.rewards, rewards),
            (self.next_observations, next_observations),
            (self.terminated, terminated),
        ):
            kept[at] = values
        self._next = int((self._next + len(actions)) % size)
        self.count = min(self.count + len(actions), size)

    def draw(self, size: int, rng) -> tuple[torch.Tensor, ...]:
        """A minibatch: observations, actions, rewards, next observations, terminated."""
        rows = rng.integers(self.count, size=size)
        kept = (self.observations, self.actions, self.rewards, self.next_observations, self.terminated)
        return tuple(torch.from_numpy(values[rows]) for values in kept)


def td_target(values, slow_values, rewards, terminated, gamma: float):
    """What Q(s, a) should have been: r + gamma (1 - terminated) Q'(s', argmax_a Q(s', a)) (details 3 to 5).

    Args:
        values, slow_values: (n, actions) tensors, Q(s', .) and Q'(s', .); -inf for actions that do not exist.
        rewards: (n,) r.
        terminated: (n,) bool.

    Returns:
        (n,) tensor.

    Source: van Hasselt, Guez, Silver 2016, eq. 4.
    """
    following = slow_values.gather(1, values.argmax(dim=1, keepdim=True))[:, 0]
    return rewards + gamma * torch.where(terminated, torch.zeros_like(following), following)


def update(network: QNetwork, target: QNetwork, optimizer, minibatch, settings: DQN, targets=td_target) -> float:
    """Learn from one minibatch and let the target follow; the loss. `targets` stands in for `td_target`."""
    observations, actions, rewards, next_observations, terminated = minibatch
    with torch.no_grad():
        following = network(next_observations), target(next_observations)
        wanted = targets(*following, rewards, terminated, settings.gamma)
    values = network(observations).gather(1, actions[:, None])[:, 0]
    loss = nn.functional.smooth_l1_loss(values, wanted)
    if not torch.isfinite(loss):
        raise FloatingPointError(f"the loss is {loss.item()}")
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), settings.max_gradient_norm)
    optimizer.step()
    with torch.no_grad():
        for slow, fast in zip(target.parameters(), network.parameters(), strict=True):
            slow.lerp_(fast, settings.target_rate)
    return loss.item()


def explore(network: QNetwork, observations, epsilon: float, rng, mask: Callable | None = None) -> np.ndarray:
    """(n,) actions: the best one, or with probability epsilon any that exists (detail 1)."""
    actions = network.best(observations)
    is_random = rng.random(len(actions)) < epsilon
    odds = rng.random((len(actions), network.actions))
    if mask is not None:
        odds = np.where(mask(torch.from_numpy(np.asarray(observations, np.float32))).numpy(), odds, -1.0)
    return np.where(is_random, odds.argmax(axis=1), actions)


def train_dqn(
    env,
    settings: DQN,
    steps: int,
    seed: int = 0,
    mask=None,
    hidden: int = 128,
    on_step=lambda infos, share: None,
    targets: Callable = td_target,
) -> QNetwork:
    """Learn in a vector environment with same-step autoreset and discrete actions.

    Args:
        env: its `reset` gives (n, ...) float32 observations; `infos["final_obs"]` holds the last ones.
        settings: see `DQN`.
        steps: over all worlds.
        seed: of weights, draws and the worlds' first episodes.
        mask, hidden: as in `QNetwork`.
        on_step: called with the infos of each step and the share of the training that is done.
        targets: in place of `td_target`.

    Returns:
        The network; `best` is its policy.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    observations, _ = env.reset(seed=seed)
    shape, actions = observations.shape[1:], int(env.single_action_space.n)
    network, target = (QNetwork(shape, actions, mask, hidden) for _ in range(2))
    target.load_state_dict(network.state_dict())
    optimizer = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    buffer, due = ReplayBuffer(settings.buffer, shape), 0.0
    for done in range(0, steps, env.num_envs):
        share = done / steps
        epsilon = max(settings.epsilon_end, 1.0 - (1.0 - settings.epsilon_end) * share / settings.exploration)
        chosen = explore(network, observations, epsilon, rng, mask)
        after, rewards, terminated, truncated, infos = env.step(chosen)
        led_to = np.array(after, np.float32)
        for i in np.flatnonzero(terminated | truncated):
            led_to[i] = infos["final_obs"][i]
        buffer.add(observations, chosen, rewards, led_to, terminated)
        observations = np.asarray(after, np.float32)
        if buffer.count >= settings.learning_starts:
            due += env.num_envs / settings.train_every
            while due >= 1.0:
                update(network, target, optimizer, buffer.draw(settings.minibatch, rng), settings, targets)
                due -= 1.0
        on_step(infos, share)
    return network
