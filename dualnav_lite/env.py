"""`DynamicNavEnv`: one world behind Gymnasium's interface. `vector_env` holds many at once."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from dualnav_lite.config import Config, load_config
from dualnav_lite.interface import checked_seed, split_infos
from dualnav_lite.vector_env import DynamicNavVectorEnv

__all__ = ["DynamicNavEnv", "DynamicNavVectorEnv", "split_infos"]


class OneWorld(gymnasium.Env):
    """One world of a vector environment without autoreset, behind Gymnasium's interface.

    Args:
        worlds: the vector environment, of one world.
    """

    def __init__(self, worlds):
        self.worlds, self.config, self.render_mode = worlds, worlds.config, worlds.render_mode
        self.action_space = worlds.single_action_space
        self.observation_space = worlds.single_observation_space
        self.reward_space = worlds.reward_space
        self.episode_safe_dists: list[float] = []  # least clearance of each finished episode [m] (article 3.2)
        self.episode_energy_costs: list[float] = []  # energy of each finished episode [J]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode; the same seed gives the same bytes. `options`: `preference` in [0, 1]."""
        seed = None if seed is None else checked_seed(seed)
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(1_000_000)) if seed is None else seed
        observations, infos = self.worlds.reset(seed=drawn, options=options)
        return observations[0], split_infos(infos, 1)[0]

    def step(self, action):
        """Advance by one control step: observation, reward, terminated, truncated, info."""
        action = np.asarray(action)
        if action.shape != (2,):
            raise ValueError(f"an action must have shape (2,) (v [m/s], omega [rad/s]), got {action.shape}")
        observations, reward, terminated, truncated, infos = self.worlds.step(action[None])
        info = split_infos(infos, 1)[0]
        if "summary" in info:
            self.episode_safe_dists.append(float(info["summary"]["min_clearance_m"]))
            self.episode_energy_costs.append(float(info["summary"]["energy_j"]))
        return observations[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self):
        """(H, W, 3) uint8 picture of the world."""
        return self.worlds.render()[0]


class DynamicNavEnv(OneWorld):
    """A mobile robot that must reach its goal among people and sudden obstacles, and spend little energy.

    ## Observation
    `Box((C, 64, 64), float32)`, C = 4 with the intensity channel, else 3: ego-centred, heading up, 0.1 m a cell.
    0 semantic map [0, 1], 1 motion [-1, 1], 2 bands with the robot's own state [-1, 1] (`encoder.BANDS`), 3 lidar
    intensity [0, 1].

    ## Action
    `Box(2, float32)`: v in [-0.8, 0.8] m/s, omega in [-1.2, 1.2] rad/s, counter-clockwise positive, ten times a second.
    Out-of-range actions are clipped and noted in `info["clipped"]`; a wrong shape or NaN raises `ValueError`.

    ## Reward
    Weighted sum of five terms (safe, dynamic, energy, goal, terminal; `rewards.py`): `info["reward_terms"]`,
    `info["vector_reward"]`, `info["reward_weights"]`. `info["preference"]`, painted into the observation, shifts the
    weights from safety (0) to thrift (1).

    ## Episode
    `terminated`: goal reached (within 0.4 m), contact, flat battery. `truncated`: out of time (twice the shortest path
    at `hardware.max_lin_vel`, and 15 s). The last step's `info["summary"]` holds the columns of `episodes.csv`;
    `info["episode"]` is left to Gymnasium's `RecordEpisodeStatistics`. A long run (`battery`) lasts three hours, with a
    goal every 20 s and no end at a contact.

    ## Scenarios
    navigation, pop_up, crowd_crossing, crowd_reactive, low_light, battery, comms_dropout and their variants: see
    `stress_tests/scenarios/`.

    Args:
        config_path: a config file, written with its defaults if missing; or None.
        config: a `Config`, instead of a file.
        scenario, truth, full_map, encoder, reward_function, predictor, render_mode, render_theme: as in
            `DynamicNavVectorEnv`.

    Example:
        >>> env = DynamicNavEnv(scenario="navigation")
        >>> observation, info = env.reset(seed=1)
        >>> observation, reward, terminated, truncated, info = env.step([0.5, 0.0])
        >>> observation.shape
        (4, 64, 64)
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(self, config_path: str | Path | None = None, *, config: Config | None = None, **settings):
        super().__init__(DynamicNavVectorEnv(1, config or load_config(config_path), autoreset=False, **settings))
