"""Compiles every kernel by using it once, with a bar that shows how far it is."""

import numpy as np
from tqdm import tqdm

from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.evaluate import library_env
from dualnav_lite.planners import ARMS, make_planner
from dualnav_lite.scenario import all_scenarios, load_scenario

STEPS = 5
MOTIONS = ("farneback", "forecast", "scan", "none", "truth")


def warm_kernels() -> None:
    """A few steps in every scenario, with every motion method, with the LSTM and with every planner that there is."""
    config, scenarios = Config(), all_scenarios()
    changes = [*({"observation.motion.method": method} for method in MOTIONS), {"predictor": "lstm"}]
    with tqdm(total=len(scenarios) + len(changes) + len(ARMS), unit="part", desc="kernels") as bar:
        for scenario in scenarios.values():
            _drive(DynamicNavVectorEnv(1, config, scenario))
            bar.update()
        for change in changes:
            _drive(DynamicNavVectorEnv(1, with_overrides(config, change), load_scenario("navigation")))
            bar.update()
        for arm in ARMS:
            try:
                planner = make_planner(arm, config)
            except UnusableInput:
                planner = None  # needs a package of requirements-bench.txt
            if planner:
                _drive(library_env(1, config, load_scenario("crowd_crossing"), planner), planner)
            bar.update()


def _drive(env, planner=None) -> None:
    """A few steps, ahead or as the planner says."""
    observations, infos = env.reset(seed=0)
    for _ in range(STEPS):
        actions = planner.act(observations, split_infos(infos, 1)) if planner else np.array([[0.5, 0.1]])
        observations, _, _, _, infos = env.step(actions)
    env.close()
