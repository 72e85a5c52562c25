"""How long a stress run will take here: a few steps of every arm are timed first."""

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dualnav_lite.cases import all_cases, load_case
from dualnav_lite.chunks import arm_name
from dualnav_lite.config import Config
from dualnav_lite.env import split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.scenario import Scenario, load_scenario

if TYPE_CHECKING:
    from dualnav_lite.stress import Plan

WARM_UP, TIMED = 5, 40  # control steps
SHORT_STEPS = 150  # of a short run, about; measured: 109 (`low_light`) to 160 (`crowd_crossing`) with `ppo`
SEED = 1_000_000
AROUND_S = 40  # starts of kernels, tables, figures


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


def steps_of(scenario: Scenario) -> float:
    """Control steps of a run, about."""
    return scenario.dispatcher.duration_s / Config().control_dt_s if scenario.dispatcher else SHORT_STEPS


def paces(arms: Sequence[str]) -> dict[str, float]:
    """Processor time of a control step with each arm [s]; what cannot drive is left out."""
    found = {}
    for arm in dict.fromkeys(arms):
        with contextlib.suppress(Exception):  # what is wrong with an arm is said where it is chosen
            found[arm] = seconds_per_step(arm)
    return found


def seconds_of(given: Mapping[str, Any], pace: Mapping[str, float]) -> float:
    """Processor time of a case [s] by what `Plan.parameters` gives it and the pace of its arms."""
    steps = sum(steps_of(load_scenario(name)) for name in load_case(given["case"]).scenarios) * given["episodes"]
    return steps * sum(pace.get(arm, 0.0) for arm in given["arms"])


def duration(seconds: float) -> str:
    """A time that a person waits.

    >>> duration(40), duration(760), duration(9000)
    ('a minute', '13 minutes', '2.5 hours')
    """
    minutes = round(seconds / 60)
    return f"{seconds / 3600:.1f} hours" if minutes > 90 else f"{minutes} minutes" if minutes > 1 else "a minute"


def estimate(plan: "Plan", pace: Mapping[str, float]) -> str:
    """One line that says how long a plan takes on its workers, and which arm takes the most."""
    total = sum(seconds_of(plan.parameters(name), pace) for name in all_cases())
    alone = {
        arm: sum(seconds_of(given, {arm: pace[arm]}) for given in map(plan.parameters, all_cases()))
        for arm in pace
    }  # fmt: skip
    dearest = max(alone, key=lambda arm: alone[arm])
    workers, share = ("the cluster", 1) if plan.cluster else (f"{plan.jobs} processes", plan.jobs)
    return (
        f"{len(pace)} arms: about {duration(AROUND_S + total / share)} on {workers}, less what is already there "
        f"({total / 3600:.1f} hours of processor time; {arm_name(dearest)} {alone[dearest] / max(total, 1e-9):.0%})"
    )
