"""Time series of single runs: what a figure shows and a row of `episodes.csv` cannot."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from dualnav_lite import rewards
from dualnav_lite.config import Config
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.scenario import Scenario, load_scenario


def drive(
    arm: str, scenario: str | Scenario, seed: int, render_mode: str | None = None, config: Config | None = None
) -> Iterator[tuple[DynamicNavVectorEnv, dict[str, Any]]]:
    """The environment of one episode and the infos of its world, after the reset and after each step."""
    config = config or Config()
    driver = library_arm(arm, config)
    scenario = load_scenario(scenario, "pymunk")
    env = library_env(1, config, scenario, driver)
    env.render_mode = render_mode
    observations, infos = env.reset(seed=seed)
    driver.reset([0])
    worlds = split_infos(infos, 1)
    yield env, worlds[0]
    while not env.is_done[0]:
        observations, _, _, _, infos = env.step(driver.act(observations, worlds))
        worlds = split_infos(infos, 1)
        yield env, worlds[0]
    env.close()


def picture(arm: str, scenario: str, seed: int, until_s: float = np.inf) -> np.ndarray:
    """(H, W, 3) uint8 view of an episode at a time, or at its end if that comes first."""
    run = drive(arm, scenario, seed, "rgb_array")
    env = next(env for env, info in run if info["time_s"] >= until_s or env.is_done[0])
    return env.render()[0]


def step_trace(arm: str, scenario: str, seed: int) -> tuple[pd.DataFrame, DynamicNavVectorEnv]:
    """Every step of a short run (time, pose, twist, clearance, weighted rewards) and its environment at the end."""
    table, env = [], None
    for env, info in drive(arm, scenario, seed):
        weighted = np.array(info["vector_reward"]) * np.array(info["reward_weights"])
        table.append([
            info["time_s"], *env.sim.poses[0], info["twist"][0], info["twist"][1], env.sim.clearance[0], *weighted,
        ])  # fmt: skip
    names = ["time_s", "x", "y", "heading", "v", "omega", "clearance_m", *rewards.TERMS]
    return pd.DataFrame(table, columns=names), env
