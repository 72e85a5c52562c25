"""PPO's loop on any vector environment whose rewards are terms: collect, estimate, update, again. No checkpoints.

`train.Trainer` is the same for the robot, with stages, checkpoints and logs.
"""

from collections.abc import Callable

import numpy as np
import torch

from dualnav_lite.collect import collect
from dualnav_lite.policy import Actor, Critic, make_actor
from dualnav_lite.ppo import PPO, Batch, make_optimizers, set_rates, update
from dualnav_lite.rewards import TERMS
from dualnav_lite.rollout import RunningDeviation
from dualnav_lite.trunks import trunk_for


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
