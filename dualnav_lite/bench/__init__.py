"""Speed of what students and training wait for, medians, with other simulators in the same room and run."""

import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dualnav_lite.bench import peers
from dualnav_lite.bench.learning import learning_rows
from dualnav_lite.bench.rows import NOT_INSTALLED, Row, row_line, rows_csv
from dualnav_lite.chunks import CHUNK_LONG_RUNS
from dualnav_lite.config import Config, with_overrides, write_atomic
from dualnav_lite.interface import split_infos
from dualnav_lite.layout import Layout, generate
from dualnav_lite.lidar import Lidar
from dualnav_lite.parallel_env import ParallelVectorEnv
from dualnav_lite.planners import make_planner
from dualnav_lite.scenario import Scenario, load_scenario
from dualnav_lite.simulation import Simulation
from dualnav_lite.vector_env import DynamicNavVectorEnv

SEED = 1_000_014  # a layout in which all six people found a place
BENCH_ROOM = {
    "id": "bench",
    "title": "A furnished room with six people",
    "title_zh": "六人家具房间",
    "room": {
        "size_m": {"low": 10, "high": 10},
        "walled_share": 1.0,
        "furniture": {"low": 8, "high": 8},
        "pushable_boxes": {"low": 0, "high": 0},
    },
    "people": {"count": {"low": 6, "high": 6}, "forklift_share": 0.0},
}
SCAN, STEP, FLOW_STEP = "scan of 1080 beams", "full step without optical flow", "full step with Farneback flow"
ACTION = (0.3, 0.4)  # a circle of 0.75 m
BLOCK = 30  # control steps a timing covers, so that what happens every third step is in each
LONG_RUN_STEPS = 108_000
BUSY_BELOW = 0.95  # share of a core; less means that something else runs


def seconds_per_call(call: Callable[[], object], seconds: float, block: int = 1) -> float:
    """Median time of a call [s]: blocks are timed after a tenth of the time was spent on warming up."""
    end = time.perf_counter() + 0.1 * seconds
    while time.perf_counter() < end:
        call()
    times: list[float] = []
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        for _ in range(block):
            call()
        times.append((time.perf_counter() - start) / block)
    return statistics.median(times)


def lidar_rows(scenario: Scenario, config: Config, seconds: float) -> list[Row]:
    """Scans a second in the furnished room, clean and as the robot gets them."""
    sim, lidar = Simulation(1, config), Lidar(config.lidar, 1)
    sim.reset(0, scenario, SEED)
    noise = np.full(1, 300.0), np.zeros(1, np.uint64), np.zeros(1, np.int64)
    clean = 1 / seconds_per_call(lambda: lidar.cast(sim.poses, sim.scene), seconds, 20)
    noisy = 1 / seconds_per_call(lambda: lidar.scan(sim.poses, sim.scene, *noise), seconds, 20)
    return [
        Row(SCAN, clean, "/s"),
        Row("scan with noise, intensity and labels", noisy, "/s", 20_000, 80_000),
    ]


def steps_per_second(env, seconds: float) -> float:
    """Control steps of all worlds together a second, driving in circles; resets at contacts fall out by the median."""
    env.reset(seed=[SEED] * env.num_envs)
    actions = np.tile(ACTION, (env.num_envs, 1))
    rate = env.num_envs / seconds_per_call(lambda: env.step(actions), seconds, BLOCK)
    env.close()
    return rate


def step_rows(scenario: Scenario, config: Config, seconds: float) -> list[Row]:
    """Full control steps a second and core: physics, scan, map, motion, guide, encoding, reward, info.

    SPEC 11's targets are held against 8 worlds, as training and `evaluate` drive them; what one world alone reaches
    stands beside it.
    """
    rows = []
    for method, what, target, aim in (("farneback", FLOW_STEP, 1_500, 3_000), ("forecast", STEP, 5_000, 10_000)):
        settings = with_overrides(config, {"observation.motion.method": method})
        alone = steps_per_second(DynamicNavVectorEnv(1, settings, scenario), seconds)
        together = steps_per_second(DynamicNavVectorEnv(8, settings, scenario), seconds)
        rows += [Row(what, alone, "/s"), Row(f"{what}, 8 worlds", together, "/s", target, aim)]
    return rows


def process_rows(scenario: Scenario, config: Config, seconds: float) -> list[Row]:
    """Full control steps a second of many worlds, in one process and in two."""
    rows = []
    for num_envs in (8, 16, 32):
        alone = steps_per_second(DynamicNavVectorEnv(num_envs, config, scenario), seconds)
        rows.append(Row(f"{STEP}, {num_envs} worlds, 1 process", alone, "/s"))
        shared = steps_per_second(ParallelVectorEnv(num_envs, 2, config, scenario), seconds)
        rows.append(Row(f"{STEP}, {num_envs} worlds, 2 processes", shared, "/s"))
    return rows


def ir_sim_seconds(layout: Layout, config: Config, seconds: float) -> dict[str, float]:
    """Time of ir-sim's step (robot, people, scan) and of its scan alone [s]."""
    room = peers.IrSim(layout, config)
    step = seconds_per_call(lambda: room.step(ACTION), seconds)
    return {STEP: step, SCAN: seconds_per_call(room.scan, seconds)}


def navground_seconds(layout: Layout, config: Config, seconds: float) -> dict[str, float]:
    """Time of navground's scan [s]."""
    return {SCAN: seconds_per_call(peers.Navground(layout, config).turn, seconds)}


def peer_rows(scenario: Scenario, config: Config, seconds: float, ours: dict[str, float]) -> list[Row]:
    """The same room, people and beams in other simulators, and how many times faster we are.

    Args:
        ours: our own rates of the rows `STEP` and `SCAN`; one world, one core, as theirs.
    """
    layout, rows = generate(scenario, config, SEED), []
    for package, measure, limits in (
        ("ir-sim", ir_sim_seconds, {STEP: (15, 100), SCAN: (None, None)}),
        ("navground", navground_seconds, {SCAN: (None, None)}),
    ):
        version = peers.version(package)
        found = measure(layout, config, seconds) if version else {}
        for what, (target, aim) in limits.items():
            rate = 1 / found[what] if found else None
            ratio = ours[what] / rate if rate else None
            rows.append(Row(f"{what}: {package}", rate, "/s", peer=f"{package} {version or NOT_INSTALLED}"))
            rows.append(
                Row(f"{what}: we against {package}", ratio, "x", target, aim, f"{package} {version or NOT_INSTALLED}")
            )
    return rows


def start_row() -> Row:
    """Time from starting Python to the first observation, in a fresh process with compiled kernels [s]."""
    code = "from dualnav_lite.env import DynamicNavEnv; DynamicNavEnv(scenario='navigation').reset(seed=1)"
    times = []
    for _ in range(4):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        times.append(time.perf_counter() - start)
    seconds = statistics.median(times[1:])  # the first one may compile
    return Row("start of Python to first observation", seconds, "s", 3.0, smaller_is_better=True)


def long_run_row(config: Config, seconds: float, num_envs: int) -> Row:
    """Three hours with A* at the wheel, `num_envs` runs side by side, from the first minutes [s a run and core]."""
    env = DynamicNavVectorEnv(num_envs, config, load_scenario("battery"))
    driver = make_planner("astar", config)
    observations, infos = env.reset(seed=SEED)
    driver.reset(np.arange(num_envs))

    def step():
        nonlocal observations, infos
        observations, _, _, _, infos = env.step(driver.act(observations, split_infos(infos, num_envs)))

    # Blocks of a minute, so that each holds driving and waiting for the next goal.
    total = LONG_RUN_STEPS * seconds_per_call(step, seconds, 600) / num_envs
    which = "alone" if num_envs == 1 else f"one of {num_envs} side by side"
    return Row(f"three-hour run with A*, {which}, extrapolated", total, "s", 60.0, 15.0, smaller_is_better=True)


def run(out: Path, *, seconds: float = 2.0, with_peers: bool = True) -> list[Row]:
    """Measure everything, print the table as it grows and write `bench.csv` into `out`.

    Args:
        out: results folder.
        seconds: time spent on each row.
        with_peers: also measure the packages of `requirements-bench.txt` that are installed.
    """
    config, scenario = Config(), Scenario.model_validate(BENCH_ROOM)
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; medians", flush=True)
    rows: list[Row] = []

    def show(found: list[Row]) -> None:
        rows.extend(found)
        for row in found:
            print(row_line(row), flush=True)

    wall, cpu = time.perf_counter(), time.process_time()
    show(lidar_rows(scenario, config, seconds))
    show(step_rows(scenario, config, seconds))
    share = (time.process_time() - cpu) / (time.perf_counter() - wall)
    if share < BUSY_BELOW:
        print(f"busy machine: this process got {share:.0%} of a core, so every figure here is too low", flush=True)
    show(process_rows(scenario, config, seconds))
    show([start_row()] + [long_run_row(config, seconds, num_envs) for num_envs in (1, CHUNK_LONG_RUNS)])
    if with_peers:
        show(peer_rows(scenario, config, seconds, {row.what: row.value for row in rows if row.value}))
    show(learning_rows(config, min(2, os.cpu_count() or 1), with_peers))
    write_atomic(Path(out) / "bench.csv", rows_csv(rows))
    return rows
