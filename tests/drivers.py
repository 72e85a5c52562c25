"""Scripted drivers for tests: a few lines each, no planner of the kit."""

import numpy as np


def seek(infos, speed=0.8):
    """Turn towards the goal and drive; (n, 2) commands from an infos dictionary of arrays."""
    bearing = np.arctan2(infos["goal_robot"][:, 1], infos["goal_robot"][:, 0])
    return np.stack([np.where(np.abs(bearing) < 0.5, speed, 0.0), np.clip(2 * bearing, -1.2, 1.2)], axis=1)


def run_episodes(env, seeds, driver=seek, preference=None):
    """One episode a seed, dealt to worlds as they finish; {seed: (row, bytes of the last observation)}."""
    waiting, found, n = list(seeds), {}, env.num_envs
    options = {} if preference is None else {"preference": preference}
    first = waiting[:n] + [waiting[-1]] * max(0, n - len(waiting))
    wanted = [True] * min(n, len(waiting)) + [False] * max(0, n - len(waiting))
    waiting = waiting[n:]
    current = list(first)
    _, infos = env.reset(seed=first, options=options)
    while any(wanted):
        observations, _, terminated, truncated, infos = env.step(driver(infos))
        ended = [i for i in range(n) if wanted[i] and (terminated[i] or truncated[i])]
        mask = np.zeros(n, bool)
        for i in ended:
            summary = {key: values[i] for key, values in infos["summary"].items()}
            found[current[i]] = (summary, observations[i].tobytes())
            if waiting:
                current[i] = waiting.pop(0)
                mask[i] = True
            else:
                wanted[i] = False
        if mask.any():
            _, infos = env.reset(seed=current, options={**options, "reset_mask": mask})
    return found
