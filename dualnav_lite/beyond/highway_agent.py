"""This kit's PPO in the second world, unchanged: it parks a car, and drives through traffic by a preference."""

import tempfile
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
import torch

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import evaluate
from dualnav_lite.highway import HighwayVectorEnv
from dualnav_lite.highway.tasks import TrafficTask
from dualnav_lite.metrics import mean_interval, wilson_interval
from dualnav_lite.pareto import safe_distance
from dualnav_lite.policy import Actor
from dualnav_lite.ppo import PPO
from dualnav_lite.ppo_loop import learn_ppo
from dualnav_lite.scenario import load_scenario
from dualnav_lite.survival import survived

WORLDS, LENGTH, STEPS = 16, 128, 200_000  # side by side; steps of each between updates; of all worlds
# Vectors of 14 and 32 numbers learn ten times faster than images, so rates and epochs are higher than for the robot. In
# traffic a run is 150 steps long and its end must count at its beginning.
_FAST = PPO(
    learning_rate_actor=3e-3, learning_rate_critic=3e-3, epochs=10, minibatch=256, micro_batch=256, clip_range=0.2,
    entropy_coef=0.0, target_kl=0.03, threads=1,
)  # fmt: skip
SETTINGS = {"parking": _FAST, "traffic": _FAST.model_copy(update={"learning_rate_actor": 1e-3, "gamma": 0.998})}
PREFERENCES = (0.0, 0.5, 1.0)
COLUMNS = [
    "scenario", "arm", "training_seed", "train_steps", "preference", "episodes", "survival_rate", "wilson_low",
    "wilson_high", "collisions", "timeouts", "safe_dist_m", "safe_low", "safe_high", "energy_kj", "energy_low",
    "energy_high", "mean_time_s",
]  # fmt: skip


def config_of(scenario: str, preference="drawn") -> Config:
    """The kit's configuration with `simulator: highway`."""
    return Config(simulator="highway", scenario=scenario, preference=preference)


def train_car(
    scenario: str,
    steps: int = STEPS,
    seed: int = 0,
    preference="drawn",
    on_step: Callable = lambda infos, share: None,
) -> Actor:
    """Let the kit's PPO, unchanged, learn a scenario of cars; the policy.

    Args:
        scenario: "parking" or "traffic".
        steps: over all worlds.
        seed: of weights, draws and the worlds' first episodes.
        preference: one number, or "drawn" so that one policy covers the front.
        on_step: called with the infos of each step and the share of the training that is done.
    """
    env = HighwayVectorEnv(WORLDS, config_of(scenario, preference))
    actor = learn_ppo(env, SETTINGS[scenario], steps, seed, LENGTH, on_step)
    env.close()
    return actor


class CarDriver:
    """A policy at the wheel of a car, with the mean of its Gaussian: what `evaluate` wants of an arm."""

    needs_truth = needs_full_map = False

    def __init__(self, actor: Actor, training_seed: int | None = None):
        self._actor, self.training_seed = actor, training_seed

    def reset(self, indices) -> None:
        """Nothing is remembered."""

    def act(self, observations, infos=None) -> np.ndarray:
        """(n, 2) acceleration [m/s2], steering [rad]."""
        with torch.no_grad():
            means = self._actor(torch.from_numpy(np.asarray(observations, np.float32))).chunk(2, dim=1)[0]
            return self._actor.head.physical(means).numpy().astype(float)


class Follower:
    """A planner for traffic: keeps its lane and a time gap to the car ahead (the intelligent driver model's gap law).

    Source: Treiber, Hennecke, Helbing, "Congested traffic states", Phys. Rev. E 62 (2000), eq. 3 and 4.
    """

    needs_truth = needs_full_map = False
    top_speed, gap_s, least_m, acceleration, braking = TrafficTask.top_speed, 1.5, 2.0, 1.5, 3.0

    def reset(self, indices) -> None:
        """Nothing is remembered."""

    def act(self, observations, infos=None) -> np.ndarray:
        """(n, 2) acceleration [m/s2], steering [rad], from the observation alone."""
        seen = np.asarray(observations, float)
        speed, offset, heading = 10.0 * (seen[:, 0] + 1.5), 2.0 * seen[:, 1], seen[:, 2] / 5.0
        cars = seen[:, 7:-1].reshape(len(seen), -1, 4)
        gaps = 30.0 * np.arctanh(np.clip(cars[..., 0], -0.999999, 0.999999)) - 5.0
        in_lane = (cars[..., 3] > 0) & (np.abs(4.0 * cars[..., 1]) < 2.5) & (gaps > -5.0) & (cars[..., 0] > 0)
        gap = np.where(in_lane, np.maximum(gaps, 0.1), np.inf)
        nearest = gap.argmin(axis=1)[:, None]
        gap, closing = gap.min(axis=1), -5.0 * np.take_along_axis(cars[..., 2], nearest, axis=1)[:, 0]
        wanted = self.least_m + speed * self.gap_s
        wanted = wanted + np.maximum(speed * closing / (2.0 * np.sqrt(self.acceleration * self.braking)), -wanted)
        pull = 1.0 - (speed / self.top_speed) ** 4 - (wanted / gap) ** 2
        return np.stack([np.clip(self.acceleration * pull, -4.0, 4.0), -0.02 * offset - 0.5 * heading], axis=1)


def judge(driver, scenario: str, preference: float, episodes: int, first: int = SEEDS["test"].start) -> pd.DataFrame:
    """Rows of `episodes.csv` of one driver from a seed on, by the same `evaluate` that judges the robot's arms."""

    def make_env(num_envs, config, task, planner):
        return HighwayVectorEnv(num_envs, config, task, autoreset=False)

    with tempfile.TemporaryDirectory() as folder:
        return evaluate(
            [getattr(driver, "name", "ppo")], [scenario], range(first, first + episodes), folder,
            config=config_of(scenario, preference), progress=False, make_planner=lambda arm, config: driver,
            make_env=make_env,
        )  # fmt: skip


def row_of(rows: pd.DataFrame, arm: str, steps: int | None) -> dict:
    """One row of the table from the episodes of one driver at one preference; means with 1.96 standard errors."""
    n, good = len(rows), int(survived(rows).sum())
    first = rows.iloc[0]
    kinds = [rows.outcome.str.startswith("hit_").sum(), (rows.outcome == "timeout").sum()]
    measured = [*mean_interval(safe_distance(rows)), *mean_interval(rows.energy_j / 1e3), rows.time_s.mean()]
    begin = [first.scenario, arm, first.training_seed, steps, first.preference, n, good / n, *wilson_interval(good, n)]
    return dict(zip(COLUMNS, [*begin, *kinds, *measured], strict=True))


def train_stable_car(scenario: str, steps: int, seed: int, preference="drawn"):
    """Stable-Baselines3's PPO with the same settings, network and worlds: a driver. Needs `requirements-bench.txt`."""
    from dualnav_lite.peer_ppo import Worlds  # raises `UnusableInput` where it is not installed

    from stable_baselines3 import PPO as StablePPO  # isort: skip
    from stable_baselines3.common.vec_env import VecNormalize  # isort: skip

    env, settings = HighwayVectorEnv(WORLDS, config_of(scenario, preference)), SETTINGS[scenario]
    limits = env.limits
    worlds = VecNormalize(Worlds(env, limits, np.random.default_rng(seed)), norm_obs=False, gamma=settings.gamma)
    model = StablePPO(
        "MlpPolicy", worlds, learning_rate=lambda left: left * settings.learning_rate_actor, n_steps=LENGTH,
        batch_size=settings.minibatch, n_epochs=settings.epochs, gamma=settings.gamma, gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range, ent_coef=0.0, max_grad_norm=settings.max_gradient_norm,
        target_kl=settings.target_kl, seed=seed, device="cpu",
    )  # fmt: skip
    model.learn(steps)

    class StableCar(CarDriver):
        """SB3's policy at the wheel."""

        def __init__(self):
            self.training_seed, self.name = seed, "stable_baselines3"

        def act(self, observations, infos=None):
            """(n, 2) acceleration [m/s2], steering [rad]."""
            actions, _ = model.predict(np.asarray(observations, np.float32), deterministic=True)
            return np.clip(actions, -1.0, 1.0).astype(float) * limits

    return StableCar()


def highway_table(
    scenario: str,
    seeds: Sequence[int] = (0,),
    steps: int = STEPS,
    episodes: int = 100,
    peers: bool = True,
    on_row: Callable[[pd.DataFrame], None] = lambda table: None,
) -> pd.DataFrame:
    """Our PPO, SB3's where it is installed, and a planner in traffic, on the same seeds at each preference.

    Parking is learned and asked at the default preference, traffic learned with drawn ones and asked at 0, 0.5 and 1.
    """
    rows: list[dict] = []
    is_traffic = load_scenario(scenario).cars.task == "traffic"
    preferences, taught = (PREFERENCES, "drawn") if is_traffic else ((0.5,), 0.5)

    def add(driver, arm, budget):
        for preference in preferences if budget else (0.5,):
            rows.append(row_of(judge(driver, scenario, preference, episodes), arm, budget))
            on_row(table())

    def table() -> pd.DataFrame:
        found = pd.DataFrame(rows, columns=COLUMNS)
        return found.astype({"training_seed": "Int64", "train_steps": "Int64"})

    if is_traffic:
        add(Follower(), "follower", None)
    for seed in seeds:
        add(CarDriver(train_car(scenario, steps, seed, taught), seed), "ppo", steps)
        if peers:
            try:
                add(train_stable_car(scenario, steps, seed, taught), "stable_baselines3", steps)
            except UnusableInput:
                peers = False  # the table is whole without the peer
    return table()
