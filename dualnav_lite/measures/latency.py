"""How long a control step takes by stage, and how many ticks pass until a pop-up box changes the command."""

import time
from collections import defaultdict
from functools import partial

import numpy as np
import pandas as pd

from dualnav_lite.config import Config
from dualnav_lite.env import split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.measures.kept import all_kept, fingerprint
from dualnav_lite.measures.tables import Options
from dualnav_lite.safety import SafetyFilter
from dualnav_lite.scenario import load_scenario
from dualnav_lite.twin import commands_differ

STAGES = ("scan", "map", "guide", "encode", "policy", "filter", "PID", "total")
LATENCY_COLUMNS = ["stage", "p50_ms", "p95_ms", "p99_ms", "n"]
WARM_UP = 50  # control steps that are not counted
STEPS = 5000
EPISODES = 200
BLOCK = 20  # episodes that are kept together
SEEN_M = 0.1  # a beam that differs by more sees the box
TICK_COLUMNS = ["seed", "event_s", "seen_s", "answered_s", "ticks"]


def time_stages(arm: str, seed: int, steps: int) -> dict[str, np.ndarray]:
    """Wall-clock of each stage in every control step of one world [ms]; `total` is what a robot would wait for.

    The stages are timed where they are called, on the library's own objects; what lies between them (tracking,
    infos, reward) is in none, and `total` is their sum but for the wheel loop, which the motors' computer runs.
    """
    config = Config()
    spent: defaultdict[str, float] = defaultdict(float)
    driver, scenario = library_arm(arm, config), load_scenario("navigation")
    env = library_env(1, config, scenario, driver)
    brake = SafetyFilter(config)

    def timed(owner, method: str, stage: str) -> None:
        inner = getattr(owner, method)

        def call(*arguments, **named):
            begin = time.perf_counter()
            result = inner(*arguments, **named)
            spent[stage] += time.perf_counter() - begin
            return result

        setattr(owner, method, call)

    perception = env.perception
    timed(perception.lidar, "scan", "scan")
    for method in ("update", "crops", "plan_grids"):
        timed(perception.mapper, method, "map")
    timed(perception.guide, "update", "guide")
    timed(perception, "encode", "encode")
    timed(env.sim.robots, "drive", "PID")
    rows: dict[str, list[float]] = {stage: [] for stage in STAGES}
    observations, infos = env.reset(seed=seed)
    driver.reset([0])
    for step in range(WARM_UP + steps):
        worlds = split_infos(infos, 1)
        spent.clear()
        begin = time.perf_counter()
        commands = driver.act(observations, worlds)
        spent["policy"] = time.perf_counter() - begin
        begin = time.perf_counter()
        brake(commands, worlds[0]["scan"][None], worlds[0]["twist"][None])
        spent["filter"] = time.perf_counter() - begin
        observations, _, terminated, truncated, infos = env.step(commands)
        spent["total"] = sum(spent[stage] for stage in STAGES if stage not in ("PID", "total"))
        if step >= WARM_UP:
            for stage in STAGES:
                rows[stage].append(1e3 * spent[stage])
        if terminated[0] or truncated[0]:
            seed += 1
            observations, infos = env.reset(seed=seed)
            driver.reset([0])
    env.close()
    return {stage: np.array(values) for stage, values in rows.items()}


def first_answer(arm: str, seed: int) -> list[float]:
    """Row of `TICK_COLUMNS`: the same episode twice side by side, with the boxes and without, until commands differ.

    One tick: the command that is given in the step whose scan shows the box first already differs.
    """
    config = Config()
    driver = library_arm(arm, config)
    env = library_env(2, config, load_scenario("pop_up"), driver)
    observations, infos = env.reset(seed=[seed, seed])
    driver.reset(np.arange(2))
    env.sim.movers.disarm(1)
    seen = np.nan
    while not env.is_done.any():
        actions = np.asarray(driver.act(observations, split_infos(infos, 2)), float)
        now = float(infos["time_s"][0])
        ranges = infos["scan"][:, :, 0]
        if np.isnan(seen) and (np.abs(ranges[0] - ranges[1]) > SEEN_M).any():
            seen = now
        if commands_differ(*actions):
            event = float(env.sim.movers.first_event_s[0])
            env.close()
            return [seed, event, seen, now, round((now - seen) / config.control_dt_s) + 1]
        observations, _, _, _, infos = env.step(actions)
    event = float(env.sim.movers.first_event_s[0])
    env.close()
    return [seed, event, seen, np.nan, np.nan]


def answers(arm: str, seeds) -> pd.DataFrame:
    """Rows of `TICK_COLUMNS` of these seeds."""
    return pd.DataFrame([first_answer(arm, seed) for seed in seeds], columns=TICK_COLUMNS)


def response_ticks(options: Options) -> pd.DataFrame:
    """`response_ticks.csv`: an episode of `pop_up` a row; empty `ticks` where the box was seen and never answered."""
    arm, everything, tasks = options.arm, options.seeds(EPISODES), {}
    for first in range(0, len(everything), BLOCK):
        seeds = everything[first : first + BLOCK]
        tasks[f"{seeds.start}"] = [arm, fingerprint(arm), list(seeds)], partial(answers, arm, seeds)
    table = all_kept(options.out / "response", tasks, options.jobs)
    return table[table.seen_s.notna()].reset_index(drop=True)


def latency_table(options: Options, ticks: pd.DataFrame) -> pd.DataFrame:
    """`latency.csv`: quantiles of each stage [ms], and in the row `response_ticks` those of the ticks.

    An episode without an answer counts as one that took forever, so a quantile can be infinite.
    """
    steps = STEPS if not options.episodes else min(STEPS, 25 * options.episodes)
    table = [
        [stage, *np.percentile(values, [50, 95, 99]), len(values)]
        for stage, values in time_stages(options.arm, options.seed_base, steps).items()
    ]
    waits = np.sort(ticks.ticks.fillna(np.inf).to_numpy())
    ranks = [min(int(np.ceil(share * len(waits))), len(waits)) - 1 for share in (0.5, 0.95, 0.99)]
    table.append(["response_ticks", *(waits[ranks] if len(waits) else [np.nan] * 3), len(waits)])
    return pd.DataFrame(table, columns=LATENCY_COLUMNS)
