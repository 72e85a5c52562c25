"""What happened in each episode, summed as it goes: the measured columns of `episodes.csv`."""

import numpy as np

from dualnav_lite.rewards import TERMS
from dualnav_lite.scenario import Scenario
from dualnav_lite.semantics import CONTACT_OUTCOME, Surface

TURN_NOISE_RAD_S = 0.05  # a command that turns less than this has no direction


def outcome_of_contact(surface: int) -> str:
    """Outcome of an episode that ended by touching a surface."""
    return CONTACT_OUTCOME[Surface(surface)]


def outcome_of_long_run(scenario: Scenario, goals: int, charge: float, contacts: int) -> tuple[str, str]:
    """Outcome and reason of a run that lasted its whole time (SPEC 8, battery: the article's column)."""
    rules = scenario.dispatcher
    if contacts > rules.max_contacts:
        return "too_many_contacts", f"{contacts} contacts, at most {rules.max_contacts}"
    if charge < rules.min_charge:
        return "low_charge", f"{charge:.3f} of the charge left, at least {rules.min_charge}"
    if goals < rules.min_goals:
        return "few_goals", f"{goals} goals, at least {rules.min_goals}"
    return "survived", ""


class Journal:
    """Running sums of n episodes; every attribute is an (n,) array."""

    def __init__(self, num_envs: int):
        self.preference = np.zeros(num_envs)
        self.steps = np.zeros(num_envs, np.int64)
        self.path_m = np.zeros(num_envs)
        self.min_clearance_m = np.full(num_envs, np.inf)
        self.clearance_sum = np.zeros(num_envs)
        self.energy_j = np.zeros(num_envs)
        self.goals = np.zeros(num_envs, np.int64)
        self.contacts = np.zeros(num_envs, np.int64)
        self.acceleration_sum = np.zeros(num_envs)
        self.turn_sign = np.zeros(num_envs)
        self.turn_changes = np.zeros(num_envs, np.int64)
        self.reward_sums = np.zeros((num_envs, len(TERMS)))

    def reset(self, world: int, preference: float, clearance: float) -> None:
        """Start counting anew for one world."""
        for values in vars(self).values():
            values[world] = 0
        self.preference[world] = preference
        self.min_clearance_m[world] = clearance

    def record(self, active, path, clearance, energy, acceleration_square, twists, rewards) -> None:
        """Add one control step of the active worlds.

        Args:
            active: (n,) bool.
            path: (n,) metres driven in the step; clearance: (n,) [m]; energy: (n,) [J].
            acceleration_square: (n,) mean (dv/dt)^2; twists: (n, 2); rewards: (n, 5) terms, unweighted.
        """
        rows = slice(None) if active.all() else active
        gap = np.maximum(clearance, 0.0)[rows]
        turn = np.where(np.abs(twists[rows, 1]) > TURN_NOISE_RAD_S, np.sign(twists[rows, 1]), 0.0)
        before = self.turn_sign[rows]
        self.steps[rows] += 1
        self.path_m[rows] += path[rows]
        self.min_clearance_m[rows] = np.minimum(self.min_clearance_m[rows], gap)
        self.clearance_sum[rows] += gap
        self.energy_j[rows] += energy[rows]
        self.acceleration_sum[rows] += acceleration_square[rows]
        self.turn_changes[rows] += turn * before < 0
        self.turn_sign[rows] = np.where(turn != 0, turn, before)
        self.reward_sums[rows] += rewards[rows]

    def summary(self, dt: float, battery, events, first_event_s, contact, outcomes, reasons) -> dict[str, np.ndarray]:
        """The columns of `episodes.csv` that the environment measures, as (n,) arrays.

        Args:
            dt: control step [s].
            battery, events, first_event_s: (n,) from the simulation.
            contact: (n,) `Surface` touched last.
            outcomes, reasons: (n,) texts.
        """
        steps = np.maximum(self.steps, 1)
        sums = {f"r_{name}": self.reward_sums[:, k].copy() for k, name in enumerate(TERMS)}
        return {
            "preference": self.preference.copy(),
            "outcome": outcomes.copy(),
            "collided_with": np.array([Surface(s).name.lower() if s else "" for s in contact], dtype=object),
            "events": events.copy(),
            "first_event_s": first_event_s.copy(),
            "steps": self.steps.copy(),
            "time_s": self.steps * dt,
            "path_m": self.path_m.copy(),
            "min_clearance_m": self.min_clearance_m.copy(),
            "mean_clearance_m": self.clearance_sum / steps,
            "energy_j": self.energy_j.copy(),
            "battery_end": battery.copy(),
            "goals": self.goals.copy(),
            "contacts": self.contacts.copy(),
            "accel_rms": np.sqrt(self.acceleration_sum / steps),
            "omega_sign_changes": self.turn_changes.copy(),
            **sums,
            "reason": reasons.copy(),
        }
