"""Drives kept whole: scans, believed poses, and where every mover really was, an episode at a time."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from tqdm import tqdm

from dualnav_lite.config import Config, UnusableInput, write_atomic
from dualnav_lite.env import split_infos
from dualnav_lite.evaluate import library_arm, library_env
from dualnav_lite.scenario import Scenario, load_scenario

LOG_COLUMNS = ["episode", "scenario", "arm", "seed", "outcome", "frames", "avg_safe_dist", "total_energy"]


@dataclass
class Recording:
    """One episode, a frame for the reset and for each control step.

    Attributes:
        scenario, arm, seed: which drive it is.
        scans: (frames, beams, 2) float32 range [m] and intensity.
        poses: (frames, 3) believed; true_poses: (frames, 3) world frame.
        movers: (frames, M, 2) true middles, world frame [m]; nan where a mover is not there (yet).
        map: (64, 64) float32 in [0, 1], the last map crop.
        summary: what the environment counted (columns of `episodes.csv`); empty for a drive that was cut off.
    """

    scenario: str
    arm: str
    seed: int
    scans: np.ndarray
    poses: np.ndarray
    true_poses: np.ndarray
    movers: np.ndarray
    map: np.ndarray
    summary: dict

    @property
    def name(self) -> str:
        """Stem of its files."""
        return f"{self.scenario}.{self.arm.replace('@', '_')}.{self.seed}"

    def windows(self, frames, depth: int = 10):
        """The last scans at some frames, as a predictor gets them: before the first scan its copies stand.

        Returns:
            scans (w, depth, beams, 2) and believed poses (w, depth, 3).
        """
        rows = np.maximum(np.asarray(frames)[:, None] + np.arange(1 - depth, 1), 0)
        return self.scans[rows], self.poses[rows]


class _Tape:
    """Frames of one world, as they come."""

    def __init__(self):
        self.frames: list[tuple] = []

    def add(self, env, infos, i: int) -> None:
        movers = env.sim.movers
        places = np.where(movers.active[i, :, None], movers.states[i, :, :2], np.nan)
        self.frames.append((infos["scan"][i].copy(), infos["pose"][i].copy(), env.sim.poses[i].copy(), places))

    def cut(self, scenario: str, arm: str, seed: int, crop, summary) -> Recording:
        scans, poses, true_poses, movers = (np.stack(values) for values in zip(*self.frames, strict=True))
        return Recording(scenario, arm, seed, scans, poses, true_poses, movers, crop, summary)


def drive(
    scenario: str | Scenario,
    arm: str,
    seeds: Sequence[int],
    config: Config | None = None,
    num_envs: int = 8,
    most_frames: int = 600,
) -> Iterator[Recording]:
    """One recording a seed, in the order in which the episodes end.

    Args:
        scenario: id, path or `Scenario`.
        arm: a planner or trained policy, as `evaluate` takes them.
        seeds: one episode each.
        config: settings; the defaults if None.
        num_envs: worlds side by side.
        most_frames: a longer episode is cut off there.

    Raises:
        UnusableInput: an unknown arm or scenario.
    """
    scenario = load_scenario(scenario, "pymunk")
    config = config or Config()
    driver = library_arm(arm, config)
    n = min(num_envs, len(seeds))
    env = library_env(n, config, scenario, driver)
    current, waiting = list(seeds[:n]), deque(seeds[n:])
    active, tapes = np.ones(n, bool), [_Tape() for _ in range(n)]
    observations, infos = env.reset(seed=current)
    driver.reset(np.arange(n))
    for i in range(n):
        tapes[i].add(env, infos, i)
    try:
        while active.any():
            worlds = split_infos(infos, n)
            for i in np.flatnonzero(~active):
                worlds[i]["idle"] = True
            observations, _, terminated, truncated, infos = env.step(driver.act(observations, worlds))
            for i in np.flatnonzero(active):
                tapes[i].add(env, infos, i)
            is_over = terminated | truncated
            ended = [i for i in np.flatnonzero(active) if is_over[i] or len(tapes[i].frames) >= most_frames]
            for i in ended:
                summary = {name: values[i] for name, values in infos["summary"].items()} if is_over[i] else {}
                yield tapes[i].cut(scenario.id, arm, current[i], infos["map"][i].copy(), summary)
            active[ended] = False
            fresh = ended[: len(waiting)]
            if not fresh:
                env.is_done[ended] = True  # cut off: stands still from here
                continue
            for i in fresh:
                current[i], active[i], tapes[i] = waiting.popleft(), True, _Tape()
            env.is_done[[i for i in ended if i not in fresh]] = True
            mask = np.isin(np.arange(n), fresh)
            observations, infos = env.reset(seed=current, options={"reset_mask": mask})
            driver.reset(fresh)
            for i in fresh:
                tapes[i].add(env, infos, i)
    finally:
        env.close()


def save(recording: Recording, folder: str | Path) -> None:
    """Write a recording as the article lays it out, with believed and true poses beside the scans.

    `scans/NAME.npy` (frames, beams, 2), `maps/NAME.png` 64 x 64, `movers/NAME.npz` with the rest.
    """
    folder = Path(folder)
    write_atomic(folder / "scans" / f"{recording.name}.npy", lambda file: np.save(file, recording.scans))
    picture = cv2.imencode(".png", np.round(255 * recording.map).astype(np.uint8))[1]
    write_atomic(folder / "maps" / f"{recording.name}.png", picture.tobytes())
    rest = {
        "poses": recording.poses,
        "true_poses": recording.true_poses,
        "movers": recording.movers.astype(np.float32),
        "identity": np.array([recording.scenario, recording.arm, str(recording.seed)]),
    }
    write_atomic(folder / "movers" / f"{recording.name}.npz", lambda file: np.savez_compressed(file, **rest))


def load(folder: str | Path, name: str) -> Recording:
    """The recording with this stem; its summary stands in `logs/` only.

    Raises:
        UnusableInput: a file that is missing or is none of `save`'s.
    """
    folder = Path(folder)
    try:
        scans = np.load(folder / "scans" / f"{name}.npy", allow_pickle=False)
        picture = np.frombuffer((folder / "maps" / f"{name}.png").read_bytes(), np.uint8)
        crop = cv2.imdecode(picture, cv2.IMREAD_GRAYSCALE).astype(np.float32) / 255
        with np.load(folder / "movers" / f"{name}.npz", allow_pickle=False) as rest:
            scenario, arm, seed = rest["identity"].tolist()
            poses, true_poses, movers = (rest[key].astype(float) for key in ("poses", "true_poses", "movers"))
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise UnusableInput(f"{folder}: no recording '{name}': {str(error).splitlines()[0][:120]}") from None
    return Recording(scenario, arm, int(seed), scans, poses, true_poses, movers, crop, {})


def names(folder: str | Path) -> list[str]:
    """Stems of all recordings in a folder."""
    return sorted(path.stem for path in (Path(folder) / "movers").glob("*.npz"))


def record(
    scenarios: Sequence[str],
    arms: Sequence[str],
    seeds: Sequence[int],
    out: str | Path,
    config: Config | None = None,
    progress: bool = True,
) -> pd.DataFrame:
    """Record every arm in every scenario on the same seeds; a log of both objectives stands in `logs/episodes.csv`.

    Args:
        scenarios, arms, seeds, config: as in `drive`.
        out: folder, usually `data`.
        progress: show a bar.

    Returns:
        Rows of the log: `avg_safe_dist` is the episode's mean clearance [m], `total_energy` in joules (article 2.1).
    """
    rows = []
    chosen = [load_scenario(name, "pymunk") for name in scenarios]
    with tqdm(total=len(chosen) * len(arms) * len(seeds), unit="episode", disable=not progress) as bar:
        for scenario in chosen:
            for arm in arms:
                for one in drive(scenario, arm, seeds, config):
                    save(one, out)
                    summary = one.summary
                    means = [summary.get("mean_clearance_m"), summary.get("energy_j")]
                    rows.append(
                        [one.name, one.scenario, arm, one.seed, summary.get("outcome", "cut"), len(one.scans), *means]
                    )
                    bar.update()
    table = pd.DataFrame(rows, columns=LOG_COLUMNS).sort_values(["scenario", "arm", "seed"])
    content = table.round(4).to_csv(index=False, lineterminator="\n")
    write_atomic(Path(out) / "logs" / "episodes.csv", content)
    return table
