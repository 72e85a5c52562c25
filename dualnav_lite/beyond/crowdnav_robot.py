"""This kit's robot in CrowdNav's protocol: wheels, 0.8 m/s, ten decisions a second, and nothing but its lidar."""

from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from dualnav_lite.beyond.crowdnav import (
    GOAL,
    HOLONOMIC,
    KNOWN,
    LIMIT_S,
    RADIUS_M,
    START,
    STEP_S,
    TEST_CASES,
    TEST_SEED,
    Case,
    least_distance,
    make_case,
    run_holonomic,
)
from dualnav_lite.config import Config
from dualnav_lite.drivers import make_driver
from dualnav_lite.interface import split_infos
from dualnav_lite.metrics import exact_interval, wilson_interval
from dualnav_lite.perception import Perception
from dualnav_lite.robot import Robots
from dualnav_lite.scenario import load_scenario
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import Surface

WALLS_M = 6.0  # from the middle to a wall, where walls are added: a hall as large as the kit's own
WORLDS = 25  # side by side; rows do not depend on it
PIECES = 2  # of a control step: 0.05 s, in each of which everybody goes straight (people turn every 0.25 s)
COLUMNS = [
    "setting", "people", "arm", "knows", "plans_with_m", "judged_with_m", "cases", "success_rate", "wilson_low",
    "wilson_high", "exact_low", "exact_high", "collision_rate", "timeout_rate", "mean_time_s", "known_success",
    "known_collision", "known_time_s",
]  # fmt: skip


class CrowdWorlds:
    """The truth of n cases side by side, with what `Perception` reads of a `Simulation`.

    Args:
        cases: with equally many people each.
        config: of the robot.
        walls_m: half the side of a square of walls around it all; None: an open plane, as in the protocol.
    """

    def __init__(self, cases: list[Case], config: Config, walls_m: float | None = None):
        n, people = len(cases), cases[0].positions.shape[1]
        self.config = config
        self._paths = np.stack([case.positions for case in cases])
        self.robots, self.scene = Robots(n, config), Scene.empty(n)
        self.poses = np.tile([*START, 0.5 * np.pi], (n, 1))
        self.goals = np.tile(GOAL, (n, 1))
        self.steps = np.zeros(n, np.int64)
        self.contact_s = np.full((n, 2), np.inf)  # first contact with a hull of 0.3 m, and with its own
        self.arrival_s = np.full(n, np.inf)
        self._reach = RADIUS_M + np.array([RADIUS_M, config.robot.hull_radius_m])
        for i in range(n):
            self.robots.reset(i, TEST_SEED + i, self.poses[i], 1.0)
            if walls_m is not None:
                corners = walls_m * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
                walls = np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)
                self.scene.add_segments(i, walls, Surface.WALL)
            self.scene.add_circles(i, np.zeros((people, 3)), Surface.PERSON)
        self._place_people()

    def _people_at(self, time_s: float) -> np.ndarray:
        """(n, people, 2) where everybody is; they walk straight on between the steps of their cases."""
        share, step = np.modf(min(time_s / STEP_S, self._paths.shape[1] - 1.001) + 1e-9)
        before, after = self._paths[:, int(step)], self._paths[:, int(step) + 1]
        return before + share * (after - before)

    def _place_people(self) -> None:
        people = self._people_at(self.steps[0] * self.config.control_dt_s)
        self.scene.circles[:, : people.shape[1], :2] = people
        self.scene.circles[:, : people.shape[1], 2] = RADIUS_M

    def advance(self, commands) -> None:
        """One control step; contacts and arrivals are noted with their time, and nothing stops."""
        dt = self.config.control_dt_s
        begin_s, before = float(self.steps[0] * dt), self.poses.copy()
        self.robots.drive(before[:, 2], np.asarray(commands, float))
        self.poses = before + self.robots.displacement
        self.robots.odometry(before, self.poses)
        for piece in range(PIECES):
            self._judge_piece(begin_s + piece * dt / PIECES, begin_s + (piece + 1) * dt / PIECES, before, piece)
        self.steps += 1
        self._place_people()

    def _judge_piece(self, from_s: float, to_s: float, before, piece: int) -> None:
        move = (self.poses[:, :2] - before[:, :2]) / PIECES
        start = before[:, :2] + piece * move
        people = self._people_at(from_s)
        ways = self._people_at(to_s) - people - move[:, None]
        closest = least_distance(people - start[:, None], ways).min(axis=1)
        touched = (closest[:, None] < self._reach) & np.isinf(self.contact_s)
        self.contact_s[touched] = to_s
        arrived = np.isinf(self.arrival_s) & (np.hypot(*(start + move - GOAL).T) < RADIUS_M)
        self.arrival_s[arrived] = to_s

    def outcomes(self, hull: int) -> list[tuple[str, float]]:
        """Outcome and time [s] of each case by the hull of column `hull` of `contact_s`."""
        found = []
        for contact, arrival in zip(self.contact_s[:, hull], self.arrival_s, strict=True):
            kind = "collision" if contact <= arrival else "success"
            ended = min(contact, arrival)
            found.append((kind, float(ended)) if ended <= LIMIT_S else ("timeout", LIMIT_S))
        return found


def drive_cases(arm: str, cases: list[Case], config: Config, walls_m=None) -> CrowdWorlds:
    """Let a lidar arm of this kit drive some cases to their end.

    Args:
        arm: as in `drivers.make_driver`.
        cases: with equally many people each.
        config: of the robot and its senses.
        walls_m: as in `CrowdWorlds`.
    """
    worlds, n = CrowdWorlds(cases, config, walls_m), len(cases)
    perception, driver = Perception(n, config), make_driver(arm, config)
    scenario, everybody = load_scenario("navigation"), np.ones(n, bool)
    sim: Any = worlds  # stands in for a `Simulation`
    for i in range(n):
        perception.reset(i, scenario, TEST_SEED + i, sim)
    driver.reset(np.arange(n))
    preferences = np.full(n, 0.5)  # the kit's default
    limits = config.hardware.limits
    while worlds.steps[0] * config.control_dt_s < LIMIT_S:
        percept = perception.sense(sim, everybody, np.zeros(n, bool))
        observations = perception.encode(percept, sim, preferences, slice(None))
        infos = split_infos(percept.infos(worlds.robots, preferences, worlds.arrival_s < np.inf), n)
        commands = np.array(driver.act(observations, infos), float)
        done = (worlds.arrival_s < np.inf) | (worlds.contact_s[:, 1] < np.inf)
        if done.all():
            break
        commands[done] = 0.0
        worlds.advance(np.clip(commands, -limits, limits))
    return worlds


def row_of(setting: str, people: int, arm: str, knows: str, radii, results: list[tuple[str, float]]) -> dict:
    """A row of the table from the outcomes of its cases; `radii` are the hull it plans with and is judged with [m]."""
    n, kinds = len(results), [kind for kind, _ in results]
    successes = kinds.count("success")
    times = [time for kind, time in results if kind == "success"]
    rates = [successes / n, *wilson_interval(successes, n), *exact_interval(successes, n)]
    rest = [kinds.count("collision") / n, kinds.count("timeout") / n, np.mean(times) if times else np.nan]
    known = KNOWN.get((arm, people), (None, None, None))
    return dict(zip(COLUMNS, [setting, people, arm, knows, *radii, n, *rates, *rest, *known], strict=True))


def crowdnav_table(
    people=(5, 10), arms=("ppo", "cv_sampling"), walled=("ppo",), cases: int = TEST_CASES, on_row=None
) -> pd.DataFrame:
    """The protocol's table: its own arms, and this kit's on lidar alone, judged by their hull and by the robot's own.

    Args:
        people: how many, a block of rows each.
        arms: of this kit, as in `drivers.make_driver`.
        walled: arms that also run with walls around, to see whether the open plane is what they fail at.
        cases: test cases, from the first.
        on_row: called with the table after each arm, since the whole takes minutes.
    """
    config, rows = Config(), []
    for count in people:
        drawn = [make_case(TEST_SEED + k, count) for k in tqdm(range(cases), f"{count} people", leave=False)]
        for name, choose in HOLONOMIC.items():
            results = [run_holonomic(case, choose) for case in drawn]
            rows.append(row_of("protocol", count, name, "true positions and velocities", (RADIUS_M, RADIUS_M), results))
        for arm, walls_m in [*((arm, None) for arm in arms), *((arm, WALLS_M) for arm in walled)]:
            worlds = [
                drive_cases(arm, drawn[first : first + WORLDS], config, walls_m)
                for first in tqdm(range(0, cases, WORLDS), f"{count} people, {arm}", leave=False)
            ]
            plans_with, setting = config.robot.hull_radius_m, "protocol" if walls_m is None else "walls added"
            for hull, judged_with in enumerate(dict.fromkeys((RADIUS_M, plans_with))):
                results = [result for block in worlds for result in block.outcomes(hull)]
                rows.append(row_of(setting, count, arm, "lidar", (plans_with, judged_with), results))
            if on_row is not None:
                on_row(pd.DataFrame(rows, columns=COLUMNS))
    return pd.DataFrame(rows, columns=COLUMNS)
