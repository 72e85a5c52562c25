"""The same worlds on two cores: same bytes as in one process, fresh arrays, clean ends, one clear error."""

import os
import signal

import gymnasium
import numpy as np
import pytest

from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.parallel_env import ParallelVectorEnv, joined_infos
from dualnav_lite.rewards import TERMS
from dualnav_lite.vector_env import DynamicNavVectorEnv

WORLDS = 3  # an odd number, so that the shares differ


def fast_end_config():
    """A battery so small that episodes end within a few steps, at different times."""
    return with_overrides(Config(), {"power.capacity_wh": 0.01})


@pytest.fixture(scope="module")
def pair():
    """One process and two, same worlds, with autoreset; module-wide since workers take seconds to start."""
    settings = {"config": fast_end_config(), "scenario": "pop_up", "full_map": True}
    one, two = DynamicNavVectorEnv(WORLDS, **settings), ParallelVectorEnv(WORLDS, 2, **settings)
    yield one, two
    two.close()


def assert_same(ours, theirs, mask=None, path="infos"):
    """Equal bytes in nested dictionaries; under a mask only the worlds in it."""
    if isinstance(ours, dict):
        assert list(ours) == list(theirs), path
        for key, value in ours.items():
            assert_same(value, theirs[key], ours.get(f"_{key}", mask), f"{path}.{key}")
        return
    assert ours.dtype == theirs.dtype, path
    assert ours.shape == theirs.shape, path
    rows = range(len(ours)) if mask is None else np.flatnonzero(mask)
    for i in rows:
        np.testing.assert_array_equal(ours[i], theirs[i], err_msg=f"{path}[{i}]")


def actions_of(step):
    return np.column_stack([np.full(WORLDS, 0.6), 0.8 * np.sin(0.3 * step + np.arange(WORLDS))])


def test_two_processes_give_the_bytes_of_one_through_resets_and_ends(pair):
    one, two = pair
    for ours, theirs in zip(one.reset(seed=40), two.reset(seed=40), strict=True):
        assert_same(ours, theirs)
    ended = 0
    for step in range(60):
        found = one.step(actions_of(step)), two.step(actions_of(step))
        for ours, theirs in zip(*found, strict=True):
            assert_same(ours, theirs)
        ended += int((found[0][2] | found[0][3]).sum())
    assert ended >= 3


def test_steps_share_no_memory_with_the_ones_before(pair):
    _, two = pair
    first, _ = two.reset(seed=7)
    kept = first.copy()
    second, *_, infos = two.step(actions_of(0))
    scan = infos["scan"].copy()
    third, *_ = two.step(actions_of(1))
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(infos["scan"], scan)
    assert not np.shares_memory(second, third)
    third[:] = infos["scan"][:] = 9.0  # a caller may write into what it got
    assert two.step(actions_of(2))[0].max() <= 1.0


def test_a_list_of_seeds_and_a_preference_reach_the_right_worlds(pair):
    one, two = pair
    options = {"preference": [0.1, 0.5, 0.9]}
    for ours, theirs in zip(
        one.reset(seed=[5, 3, 5], options=options), two.reset(seed=[5, 3, 5], options=options), strict=True
    ):
        assert_same(ours, theirs)
    assert one.reset(seed=1)[1]["preference"].tolist() == two.reset(seed=1)[1]["preference"].tolist() == [0.5] * 3


def test_wrong_actions_and_seeds_are_refused_and_the_worlds_live_on(pair):
    _, two = pair
    two.reset(seed=1)
    for wrong in (np.zeros((2, 2)), np.zeros(2), np.full((WORLDS, 2), np.nan)):
        with pytest.raises(ValueError, match="actions must"):
            two.step(wrong)
    with pytest.raises(ValueError, match="seeds"):
        two.reset(seed=[1, 2])
    with pytest.raises(UnusableInput, match="colour"):
        two.reset(options={"colour": "red"})
    assert len(two.step(actions_of(0))[0]) == WORLDS


def test_without_autoreset_an_ended_share_waits_for_the_others_and_is_reset_by_mask():
    settings = {"config": fast_end_config(), "scenario": "navigation", "autoreset": False}
    one, two = DynamicNavVectorEnv(2, **settings), ParallelVectorEnv(2, 2, **settings)
    try:
        with pytest.raises(gymnasium.error.ResetNeeded):
            two.step(np.zeros((2, 2)))
        with pytest.raises(ValueError, match="every world"):
            two.reset(seed=1, options={"reset_mask": np.array([True, False])})
        one.reset(seed=11), two.reset(seed=11)
        alone = 0
        while True:
            found = one.step(np.full((2, 2), 0.5)), two.step(np.full((2, 2), 0.5))
            for ours, theirs in zip(*found, strict=True):
                assert_same(ours, theirs)
            alone += one.is_done.sum() == 1
            if one.is_done.all():
                break
        assert alone > 0, "both worlds ended in the same step: choose another seed"
        for env in (one, two):
            with pytest.raises(gymnasium.error.ResetNeeded):
                env.step(np.zeros((2, 2)))
        options = {"reset_mask": np.array([False, True])}
        for ours, theirs in zip(one.reset(seed=12, options=options), two.reset(seed=12, options=options), strict=True):
            assert_same(ours, theirs)
    finally:
        two.close()


def test_what_a_worker_raises_is_one_clear_error_and_no_process_stays():
    def broken(transition):
        if transition.goal_distance > 0:
            raise KeyError("a student's slip")
        return dict.fromkeys(TERMS, 0.0)

    env = ParallelVectorEnv(2, 2, scenario="navigation", reward_function=broken)
    workers = list(env.processes)
    env.reset(seed=1)
    with pytest.raises(RuntimeError, match=r"worker of worlds 0 to 0 failed: KeyError: .*student's slip"):
        env.step(np.zeros((2, 2)))
    assert not any(worker.is_alive() for worker in workers)
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.step(np.zeros((2, 2)))
    env.close()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_worker_is_one_clear_error():
    env = ParallelVectorEnv(2, 2, scenario="navigation")
    env.reset(seed=1)
    os.kill(env.processes[1].pid, signal.SIGKILL)
    env.processes[1].join()
    with pytest.raises(RuntimeError, match=r"worlds 1 to 1 failed: .*died \(exit code -9\)"):
        env.step(np.zeros((2, 2)))
    env.close()
    env.close()


def test_unusable_settings_are_told_at_once():
    with pytest.raises(UnusableInput, match=r"workers must be 1 to 2 .* got 3"):
        ParallelVectorEnv(2, 3)
    with pytest.raises(UnusableInput, match=r"nowhere.*navigation"):
        ParallelVectorEnv(2, 2, scenario="nowhere")


def test_a_key_that_one_share_lacks_is_blank_there():
    parts = [
        {"a": np.ones(2), "_b": np.array([True, False]), "b": {"c": np.array(["x", ""], object)}},
        {"a": np.zeros(1)},
    ]
    joined = joined_infos(parts, [slice(0, 2), slice(2, 3)])
    assert joined["a"].tolist() == [1, 1, 0]
    assert joined["_b"].tolist() == [True, False, False]
    assert joined["b"]["c"].tolist() == ["x", "", None]
