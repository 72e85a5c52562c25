"""Arms x scenarios x seeds to rows: resumable, the same bytes for any number of worlds and workers."""

import io
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import joblib
import numpy as np
import pandas as pd
from tqdm import tqdm

from dualnav_lite.chunks import PARTS_MARK, Chunk, arm_name, merged, plan_chunks, run_json, sha256
from dualnav_lite.config import Config, UnusableInput, with_overrides, write_atomic
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.episodes import COLUMNS, rows_to_csv
from dualnav_lite.planners import ARMS
from dualnav_lite.planners import make_planner as library_planner
from dualnav_lite.scenario import Scenario, load_scenario
from dualnav_lite.survival import read_episodes
from dualnav_lite.workers import pool

LITTLE = 60  # episodes that take no longer than the start of worker processes; measured: 2.5 s each against 0.09 s
WORLDS = 25  # side by side; a step of `ppo` costs 350 us with 8, 330 with 25, no less with 50
LONG_RUN = 700  # episodes that take as long as one of three hours


class _Crash(Exception):
    """Something raised while worlds were running; knows how far the first of them had come."""

    def __init__(self, steps: int, error: Exception):
        super().__init__(f"{type(error).__name__}: {error}")
        self.steps = steps


def _run_worlds(chunk: Chunk, seeds, config, num_envs, make_planner, make_env) -> list[dict]:
    """Rows of some seeds, run side by side; a world takes the next seed when its episode ends."""
    planner = make_planner(chunk.arm, config)
    num_envs = min(num_envs, len(seeds))
    env = make_env(num_envs, config, chunk.scenario, planner)
    current, waiting = list(seeds[:num_envs]), deque(seeds[num_envs:])
    active, steps, rows = np.ones(num_envs, bool), np.zeros(num_envs, int), {}
    try:
        observations, infos = env.reset(seed=current)
        worlds = split_infos(infos, num_envs)
        planner.reset(np.arange(num_envs))
        while active.any():
            actions = np.array(planner.act(observations, worlds))
            if actions.shape == (num_envs, 2):
                actions[~active] = 0.0
            observations, _, terminations, truncations, infos = env.step(actions)
            worlds = split_infos(infos, num_envs)
            steps += active
            ended = np.flatnonzero(active & (terminations | truncations))
            for i in ended:
                rows[current[i]] = _row(chunk, planner, current[i], worlds[i])
            active[ended] = False
            fresh = ended[: len(waiting)]
            if len(fresh):
                for i in fresh:
                    current[i], steps[i], active[i] = waiting.popleft(), 0, True
                mask = np.isin(np.arange(num_envs), fresh)
                observations, infos = env.reset(seed=current, options={"reset_mask": mask})
                started = split_infos(infos, num_envs)
                worlds = [started[i] if mask[i] else worlds[i] for i in range(num_envs)]
                planner.reset(fresh)
            for i in np.flatnonzero(~active):
                worlds[i]["idle"] = True  # no seed is left for it, so nobody need think about it
    except UnusableInput:
        raise
    except Exception as error:
        raise _Crash(int(steps[0]), error) from error
    finally:
        env.close()
    return [rows[seed] for seed in seeds]


def _row(chunk: Chunk, planner, seed: int, info: dict) -> dict:
    """The row of an episode that just ended, from what its world counted."""
    row = dict.fromkeys(COLUMNS) | {name: value for name, value in info["summary"].items() if name in COLUMNS}
    return row | _identity(chunk, planner, seed) | {"preference": info["preference"]}


def _identity(chunk: Chunk, planner, seed: int) -> dict:
    """The columns that say which episode a row is about."""
    training_seed = getattr(planner, "training_seed", None)
    return {"scenario": chunk.scenario.id, "arm": arm_name(chunk.arm), "training_seed": training_seed, "seed": seed}


def run_episodes(chunk: Chunk, seeds, config, num_envs, make_planner, make_env) -> list[dict]:
    """Rows of some seeds of a chunk; an episode in which something raises becomes a row with outcome `error`.

    Halves are run again after a crash, down to the one episode that raises alone, so that a row never depends on its
    neighbours. `UnusableInput` is nobody's episode and ends the evaluation.
    """
    try:
        return _run_worlds(chunk, seeds, config, num_envs, make_planner, make_env)
    except _Crash as crash:
        if len(seeds) > 1:
            halves = seeds[: len(seeds) // 2], seeds[len(seeds) // 2 :]
            return [
                row for half in halves for row in run_episodes(chunk, half, config, num_envs, make_planner, make_env)
            ]
        planner = make_planner(chunk.arm, config)
        preference = None if config.preference == "drawn" else config.preference
        failed = {"preference": preference, "outcome": "error", "steps": crash.steps, "reason": str(crash)[:300]}
        return [dict.fromkeys(COLUMNS) | _identity(chunk, planner, seeds[0]) | failed]


def _chunk_csv(chunk, *settings) -> tuple[Chunk, bytes]:
    """A chunk with the content of its file; what a worker process computes."""
    return chunk, rows_to_csv(run_episodes(chunk, chunk.seeds, *settings))


def _workers_worth(todo: Sequence[Chunk], jobs: int) -> int:
    """How many processes these chunks are worth; the rows are the same for any number."""
    work = sum(len(chunk.seeds) * (LONG_RUN if chunk.scenario.dispatcher else 1) for chunk in todo)
    return 1 if work <= LITTLE else max(1, min(jobs, len(todo)))


def library_arm(arm_id: str, config: Config):
    """A planner, or a trained policy (`drivers.make_driver`).

    `ARM::FOLDER` is that arm in worlds with a student's encoder and rewards (`status --export` writes the folder).
    """
    base, mark, folder = arm_id.partition(PARTS_MARK)
    if mark:
        from dualnav_lite.check import lesson_of
        from dualnav_lite.parts import IN_WORLDS, fingerprint_of, load_parts

        driver = library_arm(base, config)
        driver.parts = load_parts(folder, [lesson_of(exercise) for exercise in IN_WORLDS])
        driver.fingerprint = sha256(getattr(driver, "fingerprint", "") + fingerprint_of(folder))
        return driver
    if arm_id.partition("@")[0] in ARMS:
        return library_planner(arm_id, config)
    from dualnav_lite.drivers import make_driver

    return make_driver(arm_id, config)


def library_env(num_envs: int, config: Config, scenario: Scenario, planner) -> DynamicNavVectorEnv:
    """The worlds a planner is run in, with the privileges that it declares and the settings it was trained under."""
    if hasattr(planner, "own_config"):
        config = planner.own_config(config)
    parts = getattr(planner, "parts", {})
    return DynamicNavVectorEnv(
        num_envs,
        config,
        scenario,
        truth=planner.needs_truth,
        full_map=planner.needs_full_map,
        encoder=parts.get("encode_state"),
        reward_function=parts.get("reward_terms"),
        autoreset=False,
    )


def evaluate(
    arms: Sequence[str],
    scenarios: Sequence[str],
    seeds: Sequence[int],
    out: str | Path,
    *,
    config: Config | None = None,
    overrides: dict | None = None,
    preference: float | None = None,
    jobs: int = 1,
    shard: tuple[int, int] = (1, 1),
    cluster: str = "",
    num_envs: int = WORLDS,
    progress: bool = True,
    make_planner=library_arm,
    make_env=library_env,
) -> pd.DataFrame:
    """Rows of every arm in every scenario on the same seeds; finished chunks in `out` are not run again.

    Writes `chunks/*.csv` whole or not at all, `run.json` (resolved settings and hashes) and, once every chunk of every
    shard is there, `episodes.csv`, sorted by scenario, arm, training seed, preference and seed. The bytes depend on the
    arms, scenarios, seeds and config alone: not on `jobs`, `num_envs`, `shard`, `cluster`, or on how often the run was
    killed.

    Args:
        arms: ids that `make_planner` knows.
        scenarios: ids of `stress_tests/scenarios`, or paths of scenario files.
        seeds: one episode each, usually a slice of `episodes.SEEDS["test"]`.
        out: results folder.
        config: settings; the defaults if None.
        overrides: dotted config keys to change, as in `config.with_overrides`.
        preference: 0 all safety to 1 all thrift; the config's if None.
        jobs: worker processes of this machine.
        shard: (k, n) runs every n-th chunk from the k-th, counted from 1.
        cluster: address of a Dask scheduler whose workers take the place of `jobs`, as in `workers.pool`.
        num_envs: worlds side by side in a process.
        make_planner: (arm, config) -> planner with `act`, `reset`, `needs_truth`, `needs_full_map` and, where trained,
            `training_seed` and `fingerprint`. Another factory than the library's wants another `out`.
        make_env: (num_envs, config, scenario, planner) -> vector env without autoreset.

    Returns:
        Rows of `episodes.csv`; of the chunks that exist where other shards are still missing.

    Raises:
        UnusableInput: unknown arm, scenario or key; no or repeated seeds; a shard that is none; a folder that refuses.
    """
    index, count = shard
    if not 1 <= index <= count:
        raise UnusableInput(f"shard must be k/n with 1 <= k <= n, got {index}/{count}")
    seeds = [int(seed) for seed in seeds]  # numpy's as well
    if not seeds or len(set(seeds)) != len(seeds):
        raise UnusableInput(f"seeds must be distinct and at least one, got {len(seeds)} ({len(set(seeds))} distinct)")
    names = [arm_name(arm) for arm in dict.fromkeys(arms)]
    if len(set(names)) < len(names):
        raise UnusableInput(f"one folder of parts at a time: the rows of several could not be told apart; got {names}")
    changes = dict(overrides or {}) | ({} if preference is None else {"preference": preference})
    config = with_overrides(config or Config(), changes)
    loaded = [load_scenario(name, config.simulator) for name in dict.fromkeys(scenarios)]
    fingerprints = {arm: getattr(make_planner(arm, config), "fingerprint", "") for arm in dict.fromkeys(arms)}
    chunks = plan_chunks(fingerprints, loaded, seeds, config, Path(out))
    write_atomic(Path(out) / "run.json", run_json(fingerprints, loaded, seeds, config))

    mine = chunks[index - 1 :: count]
    todo = [chunk for chunk in mine if not chunk.is_done()]
    calls = [joblib.delayed(_chunk_csv)(chunk, config, num_envs, make_planner, make_env) for chunk in todo]
    total = sum(len(chunk.seeds) for chunk in mine)
    bar = tqdm(total=total, initial=total - sum(len(c.seeds) for c in todo), unit="episode", disable=not progress)
    with bar, pool(_workers_worth(todo, jobs), cluster) as parallel:
        for chunk, content in parallel(calls):
            write_atomic(chunk.path, content)
            bar.update(len(chunk.seeds))

    finished = [chunk for chunk in chunks if chunk.is_done()]
    content = merged(finished)
    if len(finished) == len(chunks):
        write_atomic(Path(out) / "episodes.csv", content)
    return read_episodes(io.BytesIO(content))
