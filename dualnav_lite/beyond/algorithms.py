"""PPO, DQN and SAC on the same worlds, observation, reward and budget: the article's choice of a learner, asked (2.1).

The article says: DQN's few actions make a robot jerk; SAC explores too much at first and runs into walls; PPO does
neither. All three learn plain navigation here from 46 numbers (36 sectors of the scan and the ten bands), so that a
comparison takes minutes, not days. With images the article's sentence on high dimensions could come out differently;
that is not measured here. PPO and DQN are this kit's, SAC is Stable-Baselines3's (`requirements-bench.txt`).
"""

import tempfile
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.dqn import DQN, train_dqn
from dualnav_lite.encoder import BANDS, read_bands
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.episodes import OUTCOMES, SEEDS
from dualnav_lite.evaluate import evaluate
from dualnav_lite.metrics import mean_interval, wilson_interval
from dualnav_lite.ppo import PPO
from dualnav_lite.ppo_loop import learn_ppo
from dualnav_lite.survival import survived

WORLDS, STEPS, SECTORS, HIDDEN = 8, 60_000, 36, 128
SCENARIO, TUNING_SEED = "navigation", SEEDS["tuning"].start + 60_000
OVERRIDES: dict[str, Any] = {"observation.motion.method": "none", "observation.intensity": False}
# The nine commands of DQN: v [m/s] and omega [rad/s]; the article names four (ahead, left, right, stop).
ACTIONS = np.array([[v, omega] for v in (0.0, 0.4, 0.8) for omega in (-1.0, 0.0, 1.0)])
PPO_SETTINGS = PPO(
    learning_rate_actor=1e-3, learning_rate_critic=1e-3, epochs=10, minibatch=256, micro_batch=256, clip_range=0.2,
    entropy_coef=0.0, threads=1,
)  # fmt: skip
DQN_SETTINGS = DQN(learning_rate=5e-4, train_every=4, target_rate=0.01, exploration=0.3)
COLUMNS = [
    "algorithm", "training_seed", "train_steps", "learning_collisions", "learning_collisions_early",
    "learning_goals", "learning_episodes", "episodes", "survived", "survival_rate", "wilson_low", "wilson_high",
    "collisions", "timeouts", "accel_rms", "accel_low", "accel_high", "turns_a_second", "turns_low", "turns_high",
]  # fmt: skip


def features(observations, scans) -> np.ndarray:
    """(n, 46) float32: nearness exp(-range / m) of 36 sectors, from straight behind on, and the ten bands.

    Args:
        observations: (n, C, 64, 64); scans: (n, beams, 2) ranges [m] and intensities, 0 for a lost beam.
    """
    scans = np.asarray(scans)
    ranges = np.where(scans[..., 1] > 0, scans[..., 0], np.inf)
    nearest = ranges.reshape(len(scans), SECTORS, -1).min(axis=2)
    return np.concatenate([np.exp(-nearest), read_bands(np.asarray(observations))], axis=1).astype(np.float32)


class SectorWorlds(gymnasium.vector.VectorEnv):
    """The kit's worlds with 46 numbers as observation and, if wanted, a few commands as actions.

    Args:
        num_envs: number of worlds.
        discrete: actions are numbers of `ACTIONS`, as DQN wants them; else v and omega.

    Attributes:
        endings: (step, outcome) of each episode that ended.
    """

    def __init__(self, num_envs: int, discrete: bool = False):
        self._env = DynamicNavVectorEnv(num_envs, with_overrides(Config(), OVERRIDES), SCENARIO)
        self.num_envs, self._discrete = num_envs, discrete
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.single_observation_space = gymnasium.spaces.Box(-1.0, 1.0, (SECTORS + len(BANDS),), np.float32)
        box = self._env.single_action_space
        self.limits = self._env.config.hardware.limits
        self.single_action_space = gymnasium.spaces.Discrete(len(ACTIONS)) if discrete else box
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.endings: list[tuple[int, str]] = []
        self._steps = 0

    def reset(self, *, seed=None, options=None):
        """First observations and infos."""
        observations, infos = self._env.reset(seed=seed, options=options)
        return features(observations, infos["scan"]), infos

    def step(self, actions):
        """One step of every world; `final_obs` are features too."""
        commands = ACTIONS[np.asarray(actions)] if self._discrete else actions
        observations, reward, terminated, truncated, infos = self._env.step(commands)
        self._steps += self.num_envs
        ended = terminated | truncated
        if ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(ended):
                final[i] = features(infos["final_obs"][i][None], infos["final_info"]["scan"][i][None])[0]
                self.endings.append((self._steps, str(infos["summary"]["outcome"][i])))
            infos["final_obs"] = final
        return features(observations, infos["scan"]), reward, terminated, truncated, infos


class SectorDriver:
    """A trained learner at the wheel: what `evaluate` wants of an arm."""

    needs_truth = needs_full_map = False

    def __init__(self, choose: Callable[[np.ndarray], np.ndarray], training_seed: int):
        self._choose, self.training_seed = choose, training_seed

    def own_config(self, config: Config) -> Config:
        """The settings it was trained under."""
        return with_overrides(config, OVERRIDES)

    def reset(self, indices) -> None:
        """Nothing is remembered."""

    def act(self, observations, infos) -> np.ndarray:
        """(n, 2) v [m/s], omega [rad/s]."""
        return np.asarray(self._choose(features(observations, np.stack([info["scan"] for info in infos]))), float)


def learn_by_ppo(steps: int, seed: int) -> tuple[SectorWorlds, Callable]:
    """The worlds that PPO learned in, and its choice."""
    env = SectorWorlds(WORLDS)
    actor = learn_ppo(env, PPO_SETTINGS, steps, seed, 128)

    def choose(seen):
        with torch.no_grad():
            return actor.head.physical(actor(torch.from_numpy(seen)).chunk(2, dim=1)[0]).numpy()

    return env, choose


def learn_by_dqn(steps: int, seed: int) -> tuple[SectorWorlds, Callable]:
    """The worlds that DQN learned in, and its choice."""
    env = SectorWorlds(WORLDS, discrete=True)
    network = train_dqn(env, DQN_SETTINGS, steps, seed, hidden=HIDDEN)
    return env, lambda seen: ACTIONS[network.best(seen)]


def learn_by_sac(steps: int, seed: int) -> tuple[SectorWorlds, Callable]:
    """The worlds that SB3's SAC learned in, and its choice; entropy weight tuned by itself, as it ships."""
    from dualnav_lite.peer_ppo import Worlds  # raises `UnusableInput` where SB3 is not installed

    from stable_baselines3 import SAC  # isort: skip

    env = SectorWorlds(WORLDS)
    model = SAC(
        "MlpPolicy", Worlds(env, env.limits, np.random.default_rng(seed)), learning_rate=1e-3, buffer_size=100_000,
        learning_starts=2_000, batch_size=128, train_freq=1, gradient_steps=WORLDS // DQN_SETTINGS.train_every,
        seed=seed, device="cpu", policy_kwargs={"net_arch": [HIDDEN, HIDDEN]},
    )  # fmt: skip
    model.learn(steps)
    return env, lambda seen: np.clip(model.predict(seen, deterministic=True)[0], -1.0, 1.0) * env.limits


LEARNERS: dict[str, Callable] = {"ppo": learn_by_ppo, "dqn": learn_by_dqn, "sac": learn_by_sac}


def row_of(algorithm: str, seed: int, steps: int, endings, rows: pd.DataFrame) -> dict:
    """A row: what happened while learning (early: its first third), and 200 episodes afterwards; 95 % intervals."""
    kinds = [OUTCOMES[outcome] for _, outcome in endings]
    early = sum(OUTCOMES[outcome] == "collision" for step, outcome in endings if 3 * step <= steps)
    n, good = len(rows), int(survived(rows).sum())
    found = rows.outcome.map(OUTCOMES)
    turns = rows.omega_sign_changes.astype(float) / rows.time_s
    learning = [kinds.count("collision"), early, kinds.count("survived"), len(endings)]
    rates = [n, good, good / n, *wilson_interval(good, n), (found == "collision").sum(), (found == "timeout").sum()]
    values = [algorithm, seed, steps, *learning, *rates, *mean_interval(rows.accel_rms), *mean_interval(turns)]
    return dict(zip(COLUMNS, values, strict=True))


def algorithms_table(
    seeds: Sequence[int] = (0, 1, 2),
    steps: int = STEPS,
    episodes: int = 200,
    on_row: Callable[[pd.DataFrame], None] = lambda table: None,
) -> pd.DataFrame:
    """Every learner with every seed, judged on the same tuning seeds; SAC is left out where SB3 is missing."""
    rows: list[dict] = []
    for seed in seeds:
        for algorithm, learn in LEARNERS.items():
            try:
                env, choose = learn(steps, seed)
            except UnusableInput:
                continue
            driver = SectorDriver(choose, seed)
            with tempfile.TemporaryDirectory() as folder:
                judged = evaluate(
                    [algorithm], [SCENARIO], range(TUNING_SEED, TUNING_SEED + episodes), folder, progress=False,
                    make_planner=lambda arm, config, driver=driver: driver,
                )  # fmt: skip
            rows.append(row_of(algorithm, seed, steps, env.endings, judged))
            on_row(pd.DataFrame(rows, columns=COLUMNS))
    return pd.DataFrame(rows, columns=COLUMNS)
