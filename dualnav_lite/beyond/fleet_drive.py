"""What the cross-agent term can do for a policy that is already trained: it chooses among the policy's commands.

The article (4.5) adds 0.3 r_cross to a reward. No reward can change a policy that no longer learns, so here it is used
where it can act: each robot weighs its policy's 99 commands by how predictable they would make it to its neighbours.
r_cross of a command is minus the mean distance between where a neighbour expects the robot in the next 2 s (straight on
at its present speed) and where the command would take it. The weight multiplies it, 0 leaves the policy as it is.
Whether anybody predicts better is then measured from the lidar, by `fleet.CrossTerm`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from dualnav_lite.command_reader import CommandReader
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.drivers import make_driver
from dualnav_lite.episodes import SEEDS
from dualnav_lite.fleet import CrossTerm, FleetWorlds, draw_layout
from dualnav_lite.interface import split_infos
from dualnav_lite.metrics import mean_interval, wilson_interval
from dualnav_lite.motion import STEPS, TIMES_S
from dualnav_lite.perception import Perception
from dualnav_lite.scenario import Scenario, load_scenario

WEIGHTS = (0.0, 0.1, 0.3, 1.0)
NATS_A_METRE = 10.0  # what a metre off the expected way counts at weight 1, in log-probability; fixed beforehand
ARM, FIRST_SEED = "ppo", SEEDS["test"].start
FLEETS = 10  # side by side; rows do not depend on it
COLUMNS = [
    "scenario", "robots", "arm", "cross_weight", "runs", "robots_arrived", "arrived_rate", "wilson_low", "wilson_high",
    "hit_robot", "hit_other", "timeouts", "all_arrived_rate", "all_low", "all_high", "deviation_m", "deviation_low",
    "deviation_high", "mean_time_s", "energy_j_per_robot",
]  # fmt: skip


def ways_of(commands) -> np.ndarray:
    """(n, STEPS, 2) where robots at the origin are in the next 2 s if they keep each of (n, 2) commands [m]."""
    commands = np.asarray(commands, float)
    turn = commands[:, 1:] * TIMES_S
    half = 0.5 * turn
    chord = commands[:, :1] * TIMES_S * np.sinc(half / np.pi)
    return np.stack([chord * np.cos(half), chord * np.sin(half)], axis=-1)


def cross_of_commands(grid, twist) -> np.ndarray:
    """(commands,) r_cross of each command of a grid (k, 2) for a robot that moves with `twist` (2,) now [m]."""
    expected = np.stack([twist[0] * TIMES_S, np.zeros(STEPS)], axis=1)  # a neighbour sees a velocity, not a turn
    return -np.linalg.norm(ways_of(grid) - expected, axis=2).mean(axis=1)


class ConsiderateDriver:
    """A policy whose commands are weighed by the cross-agent term while a neighbour is in radio range.

    Args:
        arm: a policy that speaks in probabilities of a grid of commands, as in `drivers.make_driver`.
        config: of the robots.
        weight: of the term; 0 is the policy as it is.
    """

    def __init__(self, arm: str, config: Config, weight: float):
        self._policy, self.weight = make_driver(arm, config), weight
        grid = getattr(self._policy, "card", {}).get("grid")
        if grid is None:
            raise UnusableInput(f"arm '{arm}' gives no probabilities of commands, so there is nothing to choose among")
        self._commands = np.asarray(grid, float).reshape(-1, 2)
        self._reader = CommandReader(grid, self._policy.card["memory"])

    def reset(self, indices) -> None:
        """Forget the past of these robots."""
        self._reader.reset(indices)

    def act(self, observations, infos, has_neighbour) -> np.ndarray:
        """(n, 2) commands; `has_neighbour` (n,) bool says whose are weighed."""
        commands = np.zeros((len(observations), 2))
        asked = np.flatnonzero([not info["idle"] for info in infos])
        if not len(asked):
            return commands
        chances = np.array(self._policy.output(np.asarray(observations)[asked]), float)
        for row, robot in enumerate(asked):
            if self.weight > 0 and has_neighbour[robot]:
                cross = cross_of_commands(self._commands, infos[robot]["twist"])
                chances[row] *= np.exp(self.weight * NATS_A_METRE * (cross - cross.max()))
                chances[row] /= max(chances[row].sum(), 1e-30)
        commands[asked] = self._reader(chances, asked)
        return commands


def drive_fleets(scenario: Scenario, seeds: Sequence[int], config: Config, arm: str, weight: float) -> list[dict]:
    """Let fleets drive to their end; a dictionary a fleet with outcomes, deviations [m], times [s], energies [J]."""
    worlds = FleetWorlds([draw_layout(scenario, config, seed) for seed in seeds], scenario, config)
    n, each = len(worlds.poses), worlds.robots_each
    sim: Any = worlds
    perception, driver, cross = Perception(n, config), ConsiderateDriver(arm, config, weight), CrossTerm()
    for row in range(n):
        perception.reset(row, scenario, worlds.layouts[row // each].seed * 4 + row % each, sim)
    driver.reset(np.arange(n))
    preference = np.full(n, 0.5)
    deviations: list[list[float]] = [[] for _ in seeds]
    times, energy = np.zeros(n), np.zeros(n)
    while (worlds.outcomes == "").any():
        under_way = worlds.outcomes == ""
        percept = perception.sense(sim, np.ones(n, bool), np.zeros(n, bool))
        for row, term in enumerate(cross(worlds, percept)):
            if term < 0 and under_way[row]:
                deviations[row // each].append(-float(term))
        images = perception.encode(percept, sim, preference, slice(None))
        infos = split_infos(percept.infos(worlds.robots, preference, worlds.outcomes != ""), n)
        near = np.array([any(under_way[other] for other in worlds.nearby_robots(row)) for row in range(n)])
        worlds.advance(driver.act(images, infos, near))
        times += under_way * config.control_dt_s
        energy += under_way * worlds.robots.energy_j
    return [
        {
            "outcomes": worlds.outcomes[k * each : (k + 1) * each].tolist(),
            "deviation_m": float(np.mean(deviations[k])) if deviations[k] else np.nan,
            "times": times[k * each : (k + 1) * each],
            "energy": energy[k * each : (k + 1) * each],
        }
        for k in range(len(seeds))
    ]


def row_of(scenario: Scenario, arm: str, weight: float, runs: list[dict]) -> dict:
    """A row of the table; robots with Wilson's interval, whole fleets too, the deviation with 1.96 standard errors."""
    outcomes = [one for run in runs for one in run["outcomes"]]
    n, arrived = len(outcomes), outcomes.count("goal")
    whole = sum(all(one == "goal" for one in run["outcomes"]) for run in runs)
    deviations = np.array([run["deviation_m"] for run in runs if np.isfinite(run["deviation_m"])])
    hits = [outcomes.count("hit_robot"), sum(one.startswith("hit_") and one != "hit_robot" for one in outcomes)]
    times = [t for run in runs for t, one in zip(run["times"], run["outcomes"], strict=True) if one == "goal"]
    energies = np.concatenate([run["energy"] for run in runs])
    begin = [scenario.id, scenario.fleet.robots, arm, weight, len(runs), arrived, arrived / n]
    middle = [*wilson_interval(arrived, n), *hits, outcomes.count("timeout"), whole / len(runs)]
    end = [*mean_interval(deviations), np.mean(times) if times else np.nan, energies.mean()]
    return dict(zip(COLUMNS, [*begin, *middle, *wilson_interval(whole, len(runs)), *end], strict=True))


def fleet_table(
    robots: Sequence[int] = (2, 3, 4),
    weights: Sequence[float] = WEIGHTS,
    runs: int = 20,
    on_row: Callable[[pd.DataFrame], None] = lambda table: None,
) -> pd.DataFrame:
    """The policy in fleets of several sizes, with each weight of the cross-agent term, on the same seeds."""
    base, config, rows = load_scenario("fleet_crossing"), Config(), []
    for count in robots:
        scenario = base.model_copy(update={"fleet": base.fleet.model_copy(update={"robots": count})})
        for weight in weights:
            found: list[dict] = []
            seeds = range(FIRST_SEED, FIRST_SEED + runs)
            for first in tqdm(range(0, runs, FLEETS), f"{count} robots, weight {weight}", leave=False):
                found += drive_fleets(scenario, seeds[first : first + FLEETS], config, ARM, weight)
            rows.append(row_of(scenario, ARM, weight, found))
            on_row(pd.DataFrame(rows, columns=COLUMNS))
    return pd.DataFrame(rows, columns=COLUMNS)
