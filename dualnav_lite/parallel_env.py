"""`ParallelVectorEnv`: the worlds of one `DynamicNavVectorEnv`, shared out over worker processes."""

import contextlib
import multiprocessing
import pickle
import signal
from collections.abc import Sequence
from ctypes import c_byte
from functools import partial
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import CloudpickleWrapper, batch_space

from dualnav_lite.config import Config, UnusableInput, load_config
from dualnav_lite.interface import action_box, checked_actions, checked_reset, observation_box
from dualnav_lite.scenario import resolve_scenarios
from dualnav_lite.vector_env import DynamicNavVectorEnv

BYTES_PER_WORLD = 1 << 20  # of the memory that steps travel through; a larger step goes through the pipe instead
STOP_SECONDS = 5.0  # until a worker that does not end by itself is ended
RESULTS = ("observations", "rewards", "terminations", "truncations")


class ParallelVectorEnv(gymnasium.vector.VectorEnv):
    """Same worlds, same bytes as `DynamicNavVectorEnv` with the same arguments, on several cores.

    Neighbouring worlds share a worker. Observations, rewards, ends and infos are those of one process, except for what
    masked infos (`episode`, `final_obs`, `final_info`) hold outside their mask. Every step returns new arrays. Workers
    are spawned, so a script that makes one needs the usual `if __name__ == "__main__":`, and start-up costs seconds:
    for training, not for a look at the world.

    Args:
        num_envs: number of worlds n.
        workers: number of processes, at most n.
        config, scenario, autoreset and the rest: as in `DynamicNavVectorEnv`.

    Raises:
        UnusableInput: a config or scenario that cannot be used; more workers than worlds.
        RuntimeError: a worker raised something or died; every worker is ended then.
    """

    def __init__(self, num_envs: int, workers: int = 2, config: Any = None, scenario: Any = None, **settings):
        if not 1 <= workers <= num_envs:
            raise UnusableInput(f"workers must be 1 to {num_envs} for {num_envs} worlds, got {workers}")
        self.config = config if isinstance(config, Config) else load_config(config)
        self.num_envs = num_envs
        self.scenarios = resolve_scenarios(self.config, scenario)
        self.single_action_space, self.single_observation_space = action_box(self.config), observation_box(self.config)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        mode = AutoresetMode.SAME_STEP if settings.get("autoreset", True) else AutoresetMode.DISABLED
        self.metadata = {"render_modes": [], "autoreset_mode": mode}
        edges = [num_envs * k // workers for k in range(workers + 1)]
        self.shares = [slice(a, b) for a, b in pairwise(edges)]
        self._is_done = np.ones(num_envs, bool)
        self._has_begun = False
        self.processes: list[multiprocessing.process.BaseProcess] = []
        self._pipes: list[Any] = []
        self._board: dict[tuple, np.ndarray] | None = None
        self._start(settings)

    def _start(self, settings) -> None:
        """Start the workers and wait until each has built its worlds."""
        context = multiprocessing.get_context("spawn")
        self._memory = context.RawArray(c_byte, BYTES_PER_WORLD * self.num_envs)
        for share in self.shares:
            count = share.stop - share.start
            worlds: Any = partial(DynamicNavVectorEnv, count, self.config, self.scenarios, **settings)
            make = CloudpickleWrapper(worlds)  # parts made in a notebook travel too
            ours, theirs = context.Pipe()
            process = context.Process(
                target=_work,
                args=(theirs, make, self._memory, share, self.num_envs),
                daemon=True,
                name=f"worlds-{share.start}",
            )
            process.start()
            theirs.close()
            self.processes.append(process)
            self._pipes.append(ours)
        self._collect()

    def _ask(self, requests: Sequence[tuple]) -> list:
        """One answer from each worker, all of them working at once."""
        if not self._pipes:
            raise gymnasium.error.ClosedEnvironmentError("the environment is closed")
        for pipe, request in zip(self._pipes, requests, strict=True):
            with contextlib.suppress(BrokenPipeError):  # it died; `_collect` says so
                pipe.send(request)
        return self._collect()

    def _collect(self) -> list:
        """Answers of all workers; one clear error, and no worker left, where one failed."""
        answers, failure = [], None
        for index, pipe in enumerate(self._pipes):
            try:
                answer = pipe.recv()
            except (EOFError, ConnectionError):
                answer = RuntimeError(f"died (exit code {self._exit_code(index)})")
            if isinstance(answer, Exception) and failure is None:
                failure = index, answer
            answers.append(answer)
        if failure is not None:
            index, error = failure
            self._stop()
            if isinstance(error, UnusableInput):
                raise error
            share = self.shares[index]
            raise RuntimeError(
                f"the worker of worlds {share.start} to {share.stop - 1} failed: {type(error).__name__}: {error}"
            ) from error
        return answers

    def _exit_code(self, index: int) -> int | None:
        self.processes[index].join(STOP_SECONDS)
        return self.processes[index].exitcode

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None):
        """As `DynamicNavVectorEnv.reset`."""
        mask, seeds, preferences = checked_reset(self.num_envs, seed, options, self._has_begun)
        requests = [("reset", mask[share], seeds[share], preferences[share]) for share in self.shares]
        results = self._joined(self._ask(requests))
        self._has_begun = True
        self._is_done[mask] = False
        return results.pop("observations"), results

    def step(self, actions):
        """As `DynamicNavVectorEnv.step`."""
        actions = checked_actions(actions, self.num_envs)
        if self._is_done.all():
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        infos = self._joined(self._ask([("step", actions[share]) for share in self.shares]), keep_board=True)
        observations, rewards, terminations, truncations = (infos.pop(name) for name in RESULTS)
        if self.metadata["autoreset_mode"] == AutoresetMode.DISABLED:
            self._is_done |= terminations | truncations
        return observations, rewards, terminations, truncations, infos

    def _joined(self, answers: list[tuple], keep_board: bool = False) -> dict[str, Any]:
        """Results and infos of all worlds on memory of their own."""
        arrays, extras = zip(*answers, strict=True)
        if None in arrays:
            steady = nested({path: view.copy() for path, view in self._board.items()})
        else:
            steady = joined_infos([nested(found) for found in arrays], self.shares)
            if keep_board:
                self._board = board(self._memory, self.num_envs, arrays[0])
        return steady | joined_infos(extras, self.shares)

    def close_extras(self, **kwargs) -> None:
        """End the workers; safe to call twice."""
        self._stop()

    def _stop(self) -> None:
        for pipe in self._pipes:
            with contextlib.suppress(OSError):
                pipe.send(("close",))
        for process in self.processes:
            process.join(STOP_SECONDS)
            if process.is_alive():
                process.terminate()
                process.join()
        for pipe in self._pipes:
            pipe.close()
        self._pipes, self.processes = [], []


def joined_infos(parts: Sequence[dict[str, Any]], shares: Sequence[slice]) -> dict[str, Any]:
    """One dictionary of (n, ...) arrays from those of the shares; zeros, False or None where a share lacks a key."""
    joined = {}
    for key in dict.fromkeys(name for part in parts for name in part):
        found = [part.get(key) for part in parts]
        example = next(value for value in found if value is not None)
        if isinstance(example, dict):
            joined[key] = joined_infos([value or {} for value in found], shares)
            continue
        empty = None if example.dtype == object else 0
        blanks = [np.full((share.stop - share.start, *example.shape[1:]), empty, example.dtype) for share in shares]
        joined[key] = np.concatenate([b if value is None else value for value, b in zip(found, blanks, strict=True)])
    return joined


def flat(infos: dict[str, Any], path: tuple = ()) -> dict[tuple, np.ndarray]:
    """The arrays of nested dictionaries by their paths."""
    found: dict[tuple, np.ndarray] = {}
    for key, value in infos.items():
        found |= flat(value, (*path, key)) if isinstance(value, dict) else {(*path, key): value}
    return found


def nested(arrays: dict[tuple, np.ndarray]) -> dict[str, Any]:
    """The inverse of `flat`."""
    infos: dict[str, Any] = {}
    for (*blocks, key), value in arrays.items():
        target = infos
        for block in blocks:
            target = target.setdefault(block, {})
        target[key] = value
    return infos


def board(memory, num_envs: int, arrays: dict[tuple, np.ndarray]) -> dict[tuple, np.ndarray] | None:
    """(n, ...) arrays on shared memory, like those of a share; both sides lay them out alike. None: no room."""
    views, start = {}, 0
    for path, array in arrays.items():
        shape = (num_envs, *array.shape[1:])
        stop = start + int(np.prod(shape)) * array.itemsize
        if stop > len(memory):
            return None
        views[path] = np.ndarray(shape, array.dtype, memory, start)
        start = -(-stop // 64) * 64
    return views


def _work(pipe, make: CloudpickleWrapper, memory, share: slice, num_envs: int) -> None:
    """A worker: builds its worlds, then answers requests until it is told to close or the other side is gone.

    An answer is (arrays by path, masked infos); the arrays of every step but the first stand on the board instead.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then closes us
    worlds: list[Any] = []
    views: dict[tuple, np.ndarray] | None = None

    def begin() -> None:
        worlds.append(make())

    with contextlib.suppress(EOFError, ConnectionError):
        pipe.send(_tried(begin))
        while (request := pipe.recv())[0] != "close":
            answer = _tried(_answer, worlds[0], request)
            if isinstance(answer, tuple) and request[0] == "step":
                arrays, masked = answer
                if views is None:
                    views = board(memory, num_envs, arrays)
                else:
                    for path, view in views.items():
                        view[share] = arrays[path]
                    answer = None, masked
            pipe.send(answer)


def _tried(call, *arguments):
    """What the call returns, or the exception it raised, in a form that can be pickled."""
    try:
        return call(*arguments)
    except Exception as error:
        try:
            return pickle.loads(pickle.dumps(error))
        except Exception:
            return RuntimeError(f"{type(error).__name__}: {error}")


def _answer(worlds: DynamicNavVectorEnv, request: tuple) -> tuple[dict[tuple, np.ndarray], dict[str, Any]]:
    """What a request gives: arrays that are always there, by path, and infos that come with a mask."""
    results: dict[str, Any] = {}
    if request[0] == "step":
        *found, infos = worlds.advance(request[1])
        results = dict(zip(RESULTS, found, strict=True))
    else:
        _, mask, seeds, preferences = request
        if mask.any():
            options = {"reset_mask": mask} | ({} if None in preferences else {"preference": preferences})
            results["observations"], infos = worlds.reset(seed=seeds, options=options)
        else:
            results["observations"], infos = worlds.observations, worlds.present_infos()
    masked = {key: value for key, value in infos.items() if key.startswith("_") or f"_{key}" in infos}
    steady = {key: value for key, value in infos.items() if key not in masked}
    return flat(results | steady), masked
