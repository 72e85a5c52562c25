"""How long a stress run will take here: a few steps of every arm are timed first."""

import time

import numpy as np

from dualnav_lite.cases import all_cases
from dualnav_lite.config import Config
from dualnav_lite.env import split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.scenario import load_scenario
from dualnav_lite.stress import Plan

WARM_UP, TIMED = 5, 40  # control steps
SHORT_STEPS = 150  # of a short run, about; measured: 109 (`low_light`) to 160 (`crowd_crossing`) with `ppo`
SEED = 1_000_000


def seconds_per_step(arm: str) -> float:
    """Processor time of one world's control step with an arm at the wheel [s]."""
    config, scenario = Config(), load_scenario("navigation")
    driver = library_arm(arm, config)
    env = library_env(8, config, scenario, driver)
    observations, infos = env.reset(seed=SEED)
    driver.reset(np.arange(env.num_envs))
    for step in range(WARM_UP + TIMED):
        if step == WARM_UP:
            begin = time.process_time()
        observations, _, _, _, infos = env.step(driver.act(observations, split_infos(infos, env.num_envs)))
    env.close()
    return (time.process_time() - begin) / (TIMED * env.num_envs)


def estimate(plan: Plan) -> str:
    """One line that says how many hours a plan takes on its workers, and which arm takes the most."""
    short = sum(len(case.scenarios) for case in all_cases().values() if not case.is_long)
    long_steps = [
        load_scenario(name).dispatcher.duration_s / Config().control_dt_s
        for case in all_cases().values()
        if case.is_long
        for name in case.scenarios
    ]
    seconds = {}
    for arm in plan.arms:
        steps = float(short * plan.episodes * SHORT_STEPS)
        steps += sum(long_steps) * plan.long_runs if arm in plan.long_arms else 0
        seconds[arm] = steps * seconds_per_step(arm)
    dearest = max(seconds, key=lambda arm: seconds[arm])
    total, workers = sum(seconds.values()), "the cluster" if plan.cluster else f"{plan.jobs} processes"
    hours = total / 3600 / (1 if plan.cluster else plan.jobs)
    spent = f"{total / 3600:.1f} hours of processor time"
    return (
        f"{len(seconds)} arms: about {hours:.1f} hours on {workers} ({spent}; {dearest} {seconds[dearest] / total:.0%})"
    )
