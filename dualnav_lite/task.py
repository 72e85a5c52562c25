"""When an episode ends, how it is called, and which goal is open: the rules of short and of three-hour runs."""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.journal import Journal, outcome_of_contact, outcome_of_long_run
from dualnav_lite.semantics import Surface
from dualnav_lite.simulation import Simulation


@dataclass
class Ends:
    """What the last control step decided, (n,) bool each; `clearance` is the hull's gap then [m]."""

    collided: np.ndarray
    flat: np.ndarray
    reached: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    clearance: np.ndarray


class Task:
    """Goals, time limits and outcomes of n worlds.

    A short run has one goal. A long run has a dispatcher, who issues a goal a period; a goal issued while another is
    open queues. While none is open, and for a while after each contact, a world is idle: it is commanded to stand.

    Attributes:
        idle: (n,) worlds where no goal is open, or a contact is being sorted out; a new array each step.
        outcomes, reasons: (n,) texts of the last finished episode of each world.
    """

    def __init__(self, num_envs: int, control_dt_s: float):
        n = num_envs
        self._dt = control_dt_s
        self._radius = np.zeros(n)
        self._limit_s = np.full(n, np.inf)
        self._is_long = np.zeros(n, bool)
        self._period_s = np.full(n, np.inf)
        self._num_goals = np.ones(n, np.int64)
        self._reached = np.zeros(n, np.int64)
        self._penalty_steps = np.zeros(n, np.int64)
        self.idle = np.zeros(n, bool)
        self.outcomes = np.full(n, "", dtype=object)
        self.reasons = np.full(n, "", dtype=object)

    def reset(self, world: int, sim: Simulation) -> None:
        """Take over the rules of a world's new scenario."""
        scenario, layout = sim.scenarios[world], sim.layouts[world]
        self._radius[world] = scenario.goal_radius_m
        self._limit_s[world] = layout.time_limit_s
        self._is_long[world] = scenario.dispatcher is not None
        self._period_s[world] = scenario.dispatcher.period_s if scenario.dispatcher else np.inf
        self._num_goals[world] = len(layout.goals)
        self._reached[world] = self._penalty_steps[world] = 0
        self.idle[world] = False
        self.outcomes[world] = self.reasons[world] = ""

    def _is_idle(self, times_s) -> np.ndarray:
        issued = np.minimum((times_s / self._period_s + 1e-9).astype(np.int64) + 1, self._num_goals)
        return (self._penalty_steps > 0) | (self._is_long & (self._reached >= issued))

    def judge(self, sim: Simulation, active, journal: Journal) -> Ends:
        """How the step just made ended for each active world; a contact outranks an arrival in the same step."""
        distance = np.hypot(sim.goals[:, 0] - sim.poses[:, 0], sim.goals[:, 1] - sim.poses[:, 1])
        collided = active & (sim.contacts != Surface.NOTHING)
        flat = active & (sim.robots.battery <= 0.0)
        reached = active & ~self.idle & ~collided & (distance <= self._radius)
        terminated = flat | (~self._is_long & (collided | reached))
        truncated = active & ~terminated & (sim.times_s >= self._limit_s - 1e-9)
        journal.goals += reached
        journal.contacts += collided
        # pymunk has already pushed hulls apart that touched; a contact leaves no clearance.
        clearance = np.where(collided, 0.0, sim.clearance)
        ends = Ends(collided, flat, reached, terminated, truncated, clearance)
        for i in np.flatnonzero(terminated | truncated):
            self.outcomes[i], self.reasons[i] = self._outcome(i, sim, ends, journal)
        return ends

    def _outcome(self, i: int, sim: Simulation, ends: Ends, journal: Journal) -> tuple[str, str]:
        if self._is_long[i] and not ends.flat[i]:
            goals, contacts = int(journal.goals[i]), int(journal.contacts[i])
            return outcome_of_long_run(sim.scenarios[i], goals, float(sim.robots.battery[i]), contacts)
        if ends.collided[i]:
            return outcome_of_contact(sim.contacts[i]), ""
        if ends.flat[i]:
            return "flat_battery", ""
        return ("goal", "") if ends.reached[i] else ("timeout", "")

    def follow(self, sim: Simulation, ends: Ends, active) -> list[int]:
        """Open the next goals of long runs and carry robots away from what they touched.

        Returns:
            The worlds whose robot must be told its goal.
        """
        self._penalty_steps = np.maximum(self._penalty_steps - active, 0)
        told = []
        for i in np.flatnonzero(self._is_long & active & ~ends.terminated & (ends.collided | ends.reached)).tolist():
            if ends.collided[i]:
                sim.replace_robot(i)
                self._penalty_steps[i] = round(sim.scenarios[i].dispatcher.contact_penalty_s / self._dt)
            if ends.reached[i]:
                self._reached[i] += 1
                if self._reached[i] < self._num_goals[i]:
                    sim.set_goal(i, sim.layouts[i].goals[self._reached[i]])
            sim.path_length[i] = sim.measure_paths()[i]
            told.append(i)
        was_idle, self.idle = self.idle, self._is_idle(sim.times_s)
        # The dispatcher sees where the robot is when it issues a goal, so odometry's drift starts anew.
        told += np.flatnonzero(was_idle & ~self.idle & active).tolist()
        return told
