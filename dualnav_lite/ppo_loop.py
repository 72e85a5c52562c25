"""PPO's loop on any vector environment: drive to learn (`collect`), estimate, update, again (`learn_ppo`).

`train.Trainer` is the same loop for the robot, with stages, checkpoints and logs.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch

from dualnav_lite.policy import Actor, Critic, make_actor
from dualnav_lite.ppo import PPO, Batch, make_optimizers, set_rates, update
from dualnav_lite.rewards import TERMS
from dualnav_lite.rollout import Rollout, RunningDeviation
from dualnav_lite.trunks import looked, trunk_for


def collect(
    env, actor: Actor, critic: Critic, observations, steps: int, generator, deviation: RunningDeviation, on_step
):
    """Let the policy drive every world for some steps (detail 1 of `ppo`).

    Args:
        env: vector environment with same-step autoreset; `infos["vector_reward"]` and `infos["reward_weights"]` are
            used where they exist, else the reward is the one term.
        observations: (n, ...) where the worlds stand.
        generator: torch generator that draws the actions, on the networks' device.
        deviation: of the terms' returns; takes in every step.
        on_step: called with the infos of each step.

    Returns:
        `Rollout`, and the observations after it.
    """
    rollout, seen = Rollout(), [looked(actor, observations)]
    last_seen: dict[int, Any] = {}  # by step, where episodes were cut short
    for step in range(steps):
        with torch.no_grad():
            actions, log_probs = actor.head.sample(actor(seen[-1]), generator)
        after, rewards, terminated, truncated, infos = env.step(actor.head.physical(actions).cpu().numpy())
        after = np.asarray(after, np.float32)
        if truncated.any():
            last = np.stack([np.asarray(one, np.float32) for one in infos["final_obs"][truncated]])
            last_seen[step] = looked(actor, last)
        vector = infos.get("vector_reward", np.asarray(rewards)[:, None])
        deviation.update(vector, terminated | truncated)
        rollout.add(
            observations=observations,
            actions=actions.cpu().numpy(),
            log_probs=log_probs.cpu().numpy(),
            rewards=vector,
            weights=infos.get("reward_weights", np.ones_like(vector)),
            values=None,
            next_values=None,
            terminated=np.asarray(terminated),
            truncated=np.asarray(truncated),
        )
        observations = after
        seen.append(looked(actor, after))
        on_step(infos)
    values = values_of(critic, [*seen, *last_seen.values()])
    rollout.values, rollout.next_values = values[:steps], [one.copy() for one in values[1 : steps + 1]]
    for step, last_values in zip(last_seen, values[steps + 1 :], strict=True):
        rollout.next_values[step][rollout.truncated[step]] = last_values
    return rollout, observations


def values_of(critic: Critic, seen: Sequence) -> list[np.ndarray]:
    """(n, terms) values of each of several sets of observations; both cores look at them."""

    @torch.no_grad()
    def valued(one):
        return critic(one).cpu().numpy()

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(valued, seen))


def learn_ppo(
    env,
    settings: PPO,
    steps: int,
    seed: int = 0,
    length: int = 64,
    on_step: Callable = lambda infos, share: None,
) -> Actor:
    """A policy that learned from `steps` steps over all worlds; rates fall to zero.

    Args:
        env: vector environment with same-step autoreset, vectors as observations, a box as actions.
        settings: of the update.
        seed: of weights, draws and the worlds' first episodes.
        length: steps of each world between updates.
        on_step: called with the infos of each step and the share of the training that is done.
    """
    size, limits = env.single_observation_space.shape, env.single_action_space.high.tolist()
    per_update = env.num_envs * length
    updates = max(1, steps // per_update)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        actor, critic = make_actor(size, "gaussian", limits), Critic(trunk_for(size), len(TERMS))
    optimizers, rng = make_optimizers(actor, critic, settings), np.random.default_rng(seed)
    generator, deviation = (
        torch.Generator().manual_seed(seed),
        RunningDeviation(env.num_envs, len(TERMS), settings.gamma),
    )
    observations, _ = env.reset(seed=rng.integers(1_000_000, size=env.num_envs).tolist())
    for number in range(updates):
        share = number / updates

        def note(infos, share=share):
            on_step(infos, share)

        rollout, observations = collect(env, actor, critic, observations, length, generator, deviation, note)
        set_rates(optimizers, settings, 1.0 - share)
        update(actor, critic, optimizers, Batch.of(rollout, settings, actor, deviation.deviations), settings, rng)
    return actor
