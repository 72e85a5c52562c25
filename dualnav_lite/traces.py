"""Time series of single runs: what a figure shows and a row of `episodes.csv` cannot."""

import numpy as np
import pandas as pd

from dualnav_lite import rewards
from dualnav_lite.config import Config
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.measures.tables import Options
from dualnav_lite.scenario import load_scenario

TRACE_COLUMNS = ["arm", "time_s", "battery", "goals", "contacts"]
EVERY_STEPS = 600  # a simulated minute


def drive(arm: str, scenario: str, seed: int, render_mode: str | None = None):
    """The environment of one episode and the infos of its world, after the reset and after each step."""
    config = Config()
    driver = library_arm(arm, config)
    env = library_env(1, config, load_scenario(scenario), driver)
    env.render_mode = render_mode
    observations, infos = env.reset(seed=seed)
    driver.reset([0])
    yield env, split_infos(infos, 1)[0]
    while not env.is_done[0]:
        observations, _, _, _, infos = env.step(driver.act(observations, split_infos(infos, 1)))
        yield env, split_infos(infos, 1)[0]
    env.close()


def picture(arm: str, scenario: str, seed: int, until_s: float = np.inf) -> np.ndarray:
    """(H, W, 3) uint8 view of an episode at a time, or at its end if that comes first."""
    run = drive(arm, scenario, seed, "rgb_array")
    env = next(env for env, info in run if info["time_s"] >= until_s or env.is_done[0])
    return env.render()[0]


def battery_trace(options: Options) -> pd.DataFrame:
    """Charge, goals and contacts of one long run an arm, once a simulated minute."""
    table = []
    for arm in options.arms or ("ppo", "ppo_filter", "astar@max_speed=0.5", "astar@max_speed=0.8"):
        for step, (env, info) in enumerate(drive(arm, "battery", options.seed_base)):
            if step % EVERY_STEPS == 0 or env.is_done[0]:
                counts = int(env.journal.goals[0]), int(env.journal.contacts[0])
                table.append([arm, float(info["time_s"]), float(info["battery"]), *counts])
            if options.episodes and step >= options.episodes * EVERY_STEPS:
                break
    return pd.DataFrame(table, columns=TRACE_COLUMNS)


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
