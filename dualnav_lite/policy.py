"""Policies and values: a trunk and a pluggable head, which speaks in commands or in a Gaussian."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from dualnav_lite.config import Hardware
from dualnav_lite.planners.sampling import command_grid
from dualnav_lite.trunks import layer, trunk_for


class CommandGridHead(nn.Module):
    """A categorical distribution over a grid of physical commands.

    Where left and right are both good and straight on is not, two peaks stay two peaks: a Gaussian would average them.
    Outside, actions are continuous: `CommandReader` reads between the grid's points.

    Args:
        features: width of the trunk.
        grid: (rows, columns, 2) v [m/s] and omega [rad/s] of each command.
    """

    def __init__(self, features: int, grid):
        super().__init__()
        self.linear = layer(nn.Linear(features, grid.shape[0] * grid.shape[1]), gain=0.01)
        self.grid_shape = tuple(grid.shape[:2])
        self.register_buffer("commands", torch.as_tensor(np.asarray(grid), dtype=torch.float32).reshape(-1, 2))

    def forward(self, features):
        """(n, commands) log-probabilities."""
        return torch.log_softmax(self.linear(features), dim=1)

    def sample(self, log_probabilities, generator=None):
        """(n,) numbers of drawn commands and (n,) their log-probabilities."""
        actions = torch.multinomial(log_probabilities.exp(), 1, generator=generator)
        return actions[:, 0], log_probabilities.gather(1, actions)[:, 0]

    def judge(self, log_probabilities, actions):
        """(n,) log-probability of each action and (n,) entropy."""
        entropies = -(log_probabilities.exp() * log_probabilities).sum(dim=1)
        return log_probabilities.gather(1, actions.long()[:, None])[:, 0], entropies

    def divergence(self, reference, log_probabilities):
        """(n,) KL from the distributions `reference` to these; both as `forward` gives them."""
        return (reference.exp() * (reference - log_probabilities)).sum(dim=1)

    def physical(self, actions):
        """(n, 2) v [m/s], omega [rad/s] of drawn actions."""
        return self.commands[actions]

    def actions_of(self, physical):
        """(n,) numbers of the commands nearest to physical ones; undoes `physical`."""
        return ((physical[:, None] - self.commands) ** 2).sum(dim=2).argmin(dim=1)


class GaussianHead(nn.Module):
    """A Gaussian with a spread of its own, in units of the action space's half width, scaled to the space.

    Args:
        features: width of the trunk.
        low, high: (k,) bounds of the action space.
    """

    def __init__(self, features: int, low, high):
        super().__init__()
        low, high = torch.as_tensor(low, dtype=torch.float32), torch.as_tensor(high, dtype=torch.float32)
        self.linear = layer(nn.Linear(features, len(low)), gain=0.01)
        self.log_spread = nn.Parameter(torch.zeros(len(low)))
        self.register_buffer("middle", (high + low) / 2)
        self.register_buffer("half_width", (high - low) / 2)

    def forward(self, features):
        """(n, 2 k) means and logarithms of the standard deviations."""
        means = self.linear(features)
        return torch.cat([means, self.log_spread.expand_as(means)], dim=1)

    def sample(self, parameters, generator=None):
        """(n, k) drawn actions and (n,) their log-densities."""
        means, log_spreads = parameters.chunk(2, dim=1)
        noise = torch.randn(means.shape, generator=generator, device=means.device)
        actions = means + log_spreads.exp() * noise
        return actions, self.judge(parameters, actions)[0]

    def judge(self, parameters, actions):
        """(n,) log-density of each action and (n,) entropy."""
        means, log_spreads = parameters.chunk(2, dim=1)
        errors = (actions - means) * torch.exp(-log_spreads)
        densities = -0.5 * errors**2 - log_spreads - 0.5 * math.log(2 * math.pi)
        entropies = log_spreads + 0.5 * math.log(2 * math.pi * math.e)
        return densities.sum(dim=1), entropies.sum(dim=1)

    def divergence(self, reference, parameters):
        """(n,) KL from the distributions `reference` to these; both as `forward` gives them."""
        (m0, s0), (m1, s1) = reference.chunk(2, dim=1), parameters.chunk(2, dim=1)
        return (s1 - s0 + ((2 * s0).exp() + (m0 - m1) ** 2) / (2 * (2 * s1).exp()) - 0.5).sum(dim=1)

    def physical(self, actions):
        """(n, k) actions in the units of the space; what lies outside is for the environment to clip and note."""
        return self.middle + self.half_width * actions

    def actions_of(self, physical):
        """(n, k) actions of physical ones; undoes `physical`."""
        return (physical - self.middle) / self.half_width


class Actor(nn.Module):
    """Trunk and head: from observations to the parameters of a distribution of actions."""

    def __init__(self, trunk: nn.Module, head: nn.Module):
        super().__init__()
        self.trunk, self.head = trunk, head

    def forward(self, observations):
        """Parameters of the head's distributions, a row an observation."""
        return self.head(self.trunk(observations))


def make_actor(observation_shape: Sequence[int], head: str, limits: Sequence[float], grain: str = "fine") -> Actor:
    """An untrained policy.

    Args:
        observation_shape: (C, 64, 64) or (size,).
        head: "commands" or "gaussian".
        limits: greatest value of each action component; the action space is symmetric. For "commands" they are
            v [m/s] and omega [rad/s].
        grain: of an image's first convolution, "fine" or "coarse"; "flat" for a flat observation.
    """
    trunk = trunk_for(observation_shape, grain)
    if head == "commands":
        grid = command_grid(Hardware(max_lin_vel=limits[0], max_ang_vel=limits[1]))
        return Actor(trunk, CommandGridHead(trunk.features, grid))  # type: ignore[arg-type]
    if head == "gaussian":
        return Actor(trunk, GaussianHead(trunk.features, [-one for one in limits], limits))  # type: ignore[arg-type]
    raise ValueError(f"unknown head '{head}'; known: commands, gaussian")


class Critic(nn.Module):
    """One value head a reward term, on a trunk of its own.

    The article's 3.2 wants the critic to predict the total, "or GAE fails"; GAE is linear in the reward, so the terms'
    advantages may be estimated apart, and weights may then depend on preference and charge.
    """

    def __init__(self, trunk: nn.Module, terms: int):
        super().__init__()
        self.trunk = trunk
        self.heads = layer(nn.Linear(trunk.features, terms), gain=1.0)  # type: ignore[arg-type]

    def forward(self, observations):
        """(n, terms) values."""
        return self.heads(self.trunk(observations))
