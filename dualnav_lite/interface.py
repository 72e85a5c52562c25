"""What goes into an environment and comes out of it: spaces, checks, infos a world at a time."""

from typing import Any

import gymnasium
import numpy as np

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.encoder import num_channels


def action_box(config: Config) -> gymnasium.spaces.Box:
    """Physical actions (v [m/s], omega [rad/s]) within the hardware limits."""
    limits = config.hardware.limits.astype(np.float32)
    return gymnasium.spaces.Box(-limits, limits, dtype=np.float32)


def observation_box(config: Config) -> gymnasium.spaces.Box:
    """The image of `encoder.CHANNELS` with the range of each channel."""
    channels = num_channels(config.observation)
    low = np.zeros((channels, 64, 64), np.float32)
    low[1:3] = -1.0
    return gymnasium.spaces.Box(low, np.ones_like(low), dtype=np.float32)


def checked_actions(actions, num_envs: int) -> np.ndarray:
    """The actions as an array; `ValueError` unless they are (n, 2) finite real numbers."""
    actions = np.asarray(actions)
    if actions.shape != (num_envs, 2):
        raise ValueError(f"actions must have shape ({num_envs}, 2) (v [m/s], omega [rad/s]), got {actions.shape}")
    if actions.dtype.kind not in "iuf" or not np.isfinite(actions).all():
        raise ValueError(f"actions must be finite real numbers, got {actions.dtype} {actions.tolist()}")
    return actions


def checked_seed(seed) -> int:
    """A seed as Python's int; `UnusableInput` unless it is a whole number of at least 0."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise UnusableInput(f"a seed must be a whole number of at least 0, got {seed!r}")
    return int(seed)


def checked_reset(num_envs: int, seed, options: dict[str, Any] | None, has_begun: bool):
    """What a reset asks for, world by world.

    Returns:
        mask (n,) bool of worlds to reset, n seeds or None, n preferences or None.

    Raises:
        UnusableInput: an unknown option; a seed that is none.
        ValueError: a mask, seeds or preferences that do not fit n worlds; a first reset that leaves worlds out.
    """
    options = options or {}
    unknown = set(options) - {"reset_mask", "preference"}
    if unknown:
        raise UnusableInput(f"reset: unknown option '{min(unknown)}'; known: preference, reset_mask")
    mask = np.asarray(options.get("reset_mask", np.ones(num_envs, bool)), bool)
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(f"reset_mask must be ({num_envs},) with at least one True, got {mask!r}")
    if not has_begun and not mask.all():
        raise ValueError("the first reset must reset every world")
    if seed is not None and np.ndim(seed) == 0:
        seed = [checked_seed(seed) + i for i in range(num_envs)]
    asked = [None] * num_envs if seed is None else seed
    seeds = [None if one is None else checked_seed(one) for one in asked]
    if len(seeds) != num_envs:
        raise ValueError(f"reset: {num_envs} worlds need as many seeds, got {len(seeds)}")
    preference = options.get("preference")
    if preference is None:
        return mask, seeds, [None] * num_envs
    preference = np.broadcast_to(np.asarray(preference, float), num_envs)
    if not ((preference >= 0) & (preference <= 1)).all():
        raise ValueError(f"a preference lies in [0, 1], got {preference.tolist()}")
    return mask, seeds, preference.tolist()


def last_observations(observations, ended) -> np.ndarray:
    """(n,) objects: copies of the observations of the worlds that ended, (n,) bool, None elsewhere."""
    last = np.full(len(observations), None, dtype=object)
    for i in np.flatnonzero(ended):
        last[i] = observations[i].copy()
    return last


def restarted_infos(ended: dict[str, Any], fresh: dict[str, Any], final_obs, mask) -> dict[str, Any]:
    """Infos of a step after which some worlds began anew (Gymnasium's same-step autoreset).

    Args:
        ended: infos of the step; fresh: of the worlds as they stand now.
        final_obs: (n,) `last_observations`.
        mask: (n,) bool, where it did.

    Returns:
        The fresh ones with the step's rewards and summary, and what the ended episodes last showed in `final_*`.
    """
    of_the_step = ("reward_terms", "vector_reward", "reward_weights", "clipped", "summary", "_summary")
    kept = {key: ended[key] for key in of_the_step if key in ended}
    final_info = {key: value for key, value in ended.items() if key not in ("summary", "_summary")}
    final = {"final_obs": final_obs, "_final_obs": mask, "final_info": final_info, "_final_info": mask}
    return {**fresh, **kept, **final}


def split_infos(infos: dict[str, Any], num_envs: int) -> list[dict[str, Any]]:
    """One info dictionary a world, from a dictionary of arrays; keys with a mask go to the worlds in it only."""
    split: list[dict[str, Any]] = [{} for _ in range(num_envs)]
    for key, values in infos.items():
        if not key.startswith("_"):
            mask = infos.get(f"_{key}")
            for i, value in enumerate(_rows(values, num_envs)):
                if mask is None or mask[i]:
                    split[i][key] = value
    return split


def _rows(values, num_envs: int) -> list:
    """What stands for each world: Python's numbers, arrays, or a dictionary of those."""
    if not isinstance(values, dict):
        return values.tolist() if values.ndim == 1 else list(values)
    parts = {key: _rows(part, num_envs) for key, part in values.items() if not key.startswith("_")}
    return [{key: part[i] for key, part in parts.items()} for i in range(num_envs)]
