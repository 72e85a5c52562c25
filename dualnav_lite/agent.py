"""The article's agent: its names, its call and its loop (3.2), on this kit's PPO."""

import numpy as np
import torch

from dualnav_lite.config import Hardware
from dualnav_lite.policy import Critic, make_actor
from dualnav_lite.ppo import PPO, Batch, make_optimizers, update
from dualnav_lite.rollout import Rollout
from dualnav_lite.trunks import trunk_for


class ExperienceBuffer:
    """The article's buffer: transitions of one world, pushed as they come."""

    def __init__(self, head):
        self._head = head
        self.rollout = Rollout()
        self.states: list[np.ndarray] = []
        self.next_states: list[np.ndarray | None] = []

    def push(self, state, action, log_prob, reward, done, truncated=False, next_state=None) -> None:
        """Keep one transition.

        Args:
            state: (...) observation; action: physical, as `select_action` gave it; log_prob: with it.
            reward: a number, or an array of terms whose plain sum is the reward.
            done: the episode ended here, for good or by its time limit.
            truncated: it was the time limit; then `next_state`, the last observation, is needed for its value.
        """
        if truncated and next_state is None:
            raise ValueError("a truncated step needs next_state: its value stands for the future that was cut off")
        action = self._head.actions_of(torch.as_tensor(np.asarray(action), dtype=torch.float32)[None])
        reward = np.atleast_1d(np.asarray(reward, float))[None]
        self.states.append(np.asarray(state, np.float32))
        self.next_states.append(None if next_state is None else np.asarray(next_state, np.float32))
        self.rollout.add(
            observations=self.states[-1][None],
            actions=action.numpy(),
            log_probs=np.array([log_prob], np.float32),
            rewards=reward,
            weights=np.ones_like(reward),
            values=np.zeros_like(reward),
            next_values=np.zeros_like(reward),
            terminated=np.array([bool(done) and not truncated]),
            truncated=np.array([bool(truncated)]),
        )

    def __len__(self) -> int:
        return len(self.rollout)


class PPOAgent:
    """The article's agent (3.2): its call and its loop work; what is inside is `ppo`.

    Args:
        state_dim: (3, 64, 64), (4, 64, 64), or the size of a vector.
        action_dim: number of action components; 2 (v, omega) for images.
        lr_actor, lr_critic, gamma, K_epochs, eps_clip: the article's names for settings of `PPO`.
        action_high: (action_dim,) bounds of the action space, symmetric; the article's hardware limits for images.
        head: "commands" (a grid of v and omega) or "gaussian"; commands for images if not given.
        terms: length of the rewards that are pushed.
        seed: of the weights and of every draw.
    """

    def __init__(
        self,
        state_dim,
        action_dim: int,
        lr_actor: float = 3e-4,
        lr_critic: float = 1e-3,
        gamma: float = 0.99,
        K_epochs: int = 10,
        eps_clip: float = 0.15,
        *,
        action_high=None,
        head: str | None = None,
        terms: int = 1,
        seed: int = 0,
    ):
        shape = (state_dim,) if isinstance(state_dim, int) else tuple(state_dim)
        self.settings = PPO(
            learning_rate_actor=lr_actor,
            learning_rate_critic=lr_critic,
            gamma=gamma,
            epochs=K_epochs,
            clip_range=eps_clip,
        )
        limits = Hardware().limits.tolist() if len(shape) == 3 else [1.0] * action_dim
        limits = limits if action_high is None else [float(one) for one in action_high]
        if len(limits) != action_dim:
            raise ValueError(f"action_dim is {action_dim}, but there are {len(limits)} action bounds")
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            self.actor = make_actor(shape, head or ("commands" if len(shape) == 3 else "gaussian"), limits)
            self.critic = Critic(trunk_for(shape), terms)
        self.optimizers = make_optimizers(self.actor, self.critic, self.settings)
        self.buffer = ExperienceBuffer(self.actor.head)
        self._generator = torch.Generator().manual_seed(seed)
        self._rng = np.random.default_rng(seed)

    def select_action(self, state):
        """A drawn physical action (action_dim,) and its log-probability, for one observation."""
        with torch.no_grad():
            parameters = self.actor(torch.from_numpy(np.asarray(state, np.float32))[None])
            action, log_prob = self.actor.head.sample(parameters, self._generator)
            return self.actor.head.physical(action)[0].numpy(), float(log_prob[0])

    def update(self) -> dict[str, float]:
        """Learn from the buffer and empty it; the numbers listed at the head of `ppo`."""
        buffer, rollout = self.buffer, self.buffer.rollout
        following = buffer.states[1:] + buffer.states[-1:]
        after = [one if last is None else last for last, one in zip(buffer.next_states, following, strict=True)]
        with torch.no_grad():
            for states, values in ((buffer.states, rollout.values), (after, rollout.next_values)):
                parts = [self.critic(part) for part in torch.from_numpy(np.stack(states)).split(256)]
                values[:] = list(torch.cat(parts).numpy()[:, None])
        batch = Batch.of(rollout, self.settings, self.actor)
        numbers = update(self.actor, self.critic, self.optimizers, batch, self.settings, self._rng)
        self.buffer = ExperienceBuffer(self.actor.head)
        return numbers
