"""Stable-Baselines3's PPO on the same worlds, images, rewards and budget: the peer our own is held against.

Needs `requirements-bench.txt`; nothing else does. Its policy has our convolutions, its own Gaussian head (SB3 has no
grid of commands), its own value head on shared or separate features, and its own update. Rewards are divided by the
running deviation of the return (`VecNormalize`), as ours are.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dualnav_lite.chunks import sha256
from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.curriculum import Training, resolved_config, scenarios_of
from dualnav_lite.parallel_env import ParallelVectorEnv
from dualnav_lite.ppo import PPO
from dualnav_lite.trunks import ImageTrunk
from dualnav_lite.vector_env import DynamicNavVectorEnv

try:
    from gymnasium import spaces
    from stable_baselines3 import PPO as StablePPO
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
    from stable_baselines3.common.vec_env import VecEnv, VecNormalize
except ImportError:
    raise UnusableInput("Stable-Baselines3 is not installed: python -m pip install -r requirements-bench.txt") from None


class Worlds(VecEnv):
    """A vector environment of ours as SB3 wants it; actions in [-1, 1] are scaled to the hardware's limits."""

    def __init__(self, env, limits, rng):
        self._env, self._limits, self._rng = env, np.asarray(limits), rng
        box = env.single_observation_space
        super().__init__(env.num_envs, spaces.Box(box.low, box.high), spaces.Box(-1.0, 1.0, (2,), np.float32))

    def reset(self):
        """Observations of fresh worlds."""
        return self._env.reset(seed=self._rng.integers(1_000_000, size=self.num_envs).tolist())[0]

    def step_async(self, actions):
        """Keep the actions for `step_wait`."""
        self._actions = np.clip(actions, -1.0, 1.0) * self._limits

    def step_wait(self):
        """Observations, rewards, ends and infos, with the last observation of every episode that ended."""
        observations, rewards, terminated, truncated, infos = self._env.step(self._actions)
        ended = terminated | truncated
        lines: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(ended):
            lines[i] = {
                "terminal_observation": infos["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
            }
        return observations, np.asarray(rewards, np.float32), ended, lines

    def close(self):
        """End the worlds."""
        self._env.close()

    def get_attr(self, attr_name, indices=None):
        """The vector environment's attribute, once a world."""
        return [getattr(self._env, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name, value, indices=None):
        """Refused."""
        raise TypeError(f"'{attr_name}' cannot be set: worlds are made as they are")

    def env_method(self, method_name, *args, indices=None, **kwargs):
        """Refused."""
        raise TypeError(f"'{method_name}' cannot be called: worlds have no methods of their own")

    def env_is_wrapped(self, wrapper_class, indices=None):
        """Nothing is wrapped."""
        return [False] * self.num_envs


class Features(BaseFeaturesExtractor):
    """Our convolutions and bands as SB3's features."""

    def __init__(self, observation_space, grain: str):
        super().__init__(observation_space, ImageTrunk.features)
        # SB3 draws weights of its own, only in the ordinary layout; `train_stable` brings back the fast one.
        self.trunk = ImageTrunk(observation_space.shape[0], grain).to(memory_format=torch.contiguous_format)

    def forward(self, observations):
        """(n, HIDDEN) features."""
        return self.trunk(observations)


def train_stable(training: Training, path: Path, home: Path, workers: int = 1) -> dict[str, float]:
    """Train SB3's PPO with the settings of a training's last stage; the policy goes to `path` (.zip).

    Returns:
        `steps`, `seconds` and `steps_per_s` of the whole loop.
    """
    stage, config = training.stages[-1], resolved_config(training)
    ppo: PPO = stage.ppo
    rng = np.random.default_rng(training.seed)
    scenarios = scenarios_of(stage, home)
    if workers > 1:
        env: Any = ParallelVectorEnv(training.worlds, workers, config, scenarios)
    else:
        env = DynamicNavVectorEnv(training.worlds, config, scenarios)
    worlds = VecNormalize(Worlds(env, config.hardware.limits, rng), norm_obs=False, norm_reward=True, gamma=ppo.gamma)
    model = StablePPO(
        "MlpPolicy",
        worlds,
        learning_rate=lambda left: left * ppo.learning_rate_actor,
        n_steps=stage.rollout_steps,
        batch_size=ppo.minibatch,
        n_epochs=ppo.epochs,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=0.0,  # its bonus of 0.01 makes a Gaussian wider and wider
        max_grad_norm=ppo.max_gradient_norm,
        target_kl=ppo.target_kl,
        seed=training.seed,
        device="cpu",
        policy_kwargs={
            "features_extractor_class": Features,
            "features_extractor_kwargs": {"grain": training.grain},
            "share_features_extractor": False,
            "net_arch": [],
            "normalize_images": False,
        },
    )
    model.policy.to(memory_format=torch.channels_last)
    begin = time.perf_counter()
    model.learn(stage.steps)
    seconds = time.perf_counter() - begin
    path.parent.mkdir(parents=True, exist_ok=True)
    model.save(path)
    worlds.close()
    return {"steps": stage.steps, "seconds": seconds, "steps_per_s": stage.steps / seconds}


class StableDriver:
    """A policy of SB3 at the wheel, with the mean of its Gaussian: what `evaluate` wants of an arm."""

    needs_truth = needs_full_map = False

    def __init__(self, path: str, overrides: dict[str, Any], training_seed: int | None = None):
        self._model = StablePPO.load(path, device="cpu")
        self._overrides, self.training_seed = overrides, training_seed
        self.fingerprint = sha256(Path(path).read_bytes())
        self._limits = Config().hardware.limits

    def reset(self, indices) -> None:
        """Nothing is remembered."""

    def own_config(self, config: Config) -> Config:
        """The settings it was trained under."""
        return with_overrides(config, self._overrides)

    def act(self, observations, infos=None) -> np.ndarray:
        """(n, 2) v [m/s], omega [rad/s]."""
        actions, _ = self._model.predict(np.asarray(observations, np.float32), deterministic=True)
        return np.clip(actions, -1.0, 1.0).astype(float) * self._limits
