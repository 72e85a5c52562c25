"""The reward of a step of every world: what the terms need is read off the simulation, the terms are `rewards`'."""

from collections.abc import Callable

import numpy as np

from dualnav_lite import rewards
from dualnav_lite.config import Rewards
from dualnav_lite.perception import Percept, true_movers
from dualnav_lite.simulation import Simulation
from dualnav_lite.task import Ends


class RewardModel:
    """Terms of n worlds, by the library's `reward_terms` or a student's.

    Args:
        num_envs: n.
        settings: form and weights.
        hull_radius: of the robot [m].
        function: a student's `reward_terms`, called a world at a time; None for the library's.
    """

    def __init__(self, num_envs: int, settings: Rewards, hull_radius: float, function: Callable | None = None):
        self._num_envs, self._settings, self._hull_radius, self._function = num_envs, settings, hull_radius, function
        self._window = rewards.WindowScore(num_envs) if settings.form == "article_fixed" else None

    def reset(self, world: int) -> None:
        """Forget the last episode of a world."""
        if self._window is not None:
            self._window.reset([world])

    def terms(self, sim: Simulation, percept: Percept, way, ends: Ends, active) -> dict[str, np.ndarray]:
        """The five terms, (n,) each, 0 where a world is not active.

        Args:
            sim, percept: after the step.
            way: (n,) twice, the way to the goal before and after [m], 0 where none is open.
            ends: what the step ended.
            active: (n,) bool.

        Raises:
            ValueError: a student's function returns other terms.
        """
        transition = self._transition(sim, percept, way, ends)
        if self._function is None:
            terms = rewards.reward_terms(transition, self._settings)
        else:
            terms = self._terms_of_student(transition)
        if self._window is not None:
            terms = self._window(terms, active)
        return {name: np.where(active, values, 0.0) for name, values in terms.items()}

    def _transition(self, sim: Simulation, percept: Percept, way, ends: Ends) -> rewards.Transition:
        true_velocity = predicted_velocity = np.zeros((self._num_envs, 2))
        if self._function is not None or self._settings.form != "repaired":  # the repaired form does not read them
            true_velocity, predicted_velocity = rewards.matched_velocities(percept.prediction, *true_movers(sim))
        twist = sim.robots.twist
        return rewards.Transition(
            clearance=ends.clearance,
            min_range=percept.scans[:, :, 0].min(axis=1),
            action=twist,
            mover_velocity=true_velocity,
            predicted_velocity=predicted_velocity,
            intrusion=rewards.predicted_intrusion(twist, percept.prediction, self._hull_radius),
            energy_j=sim.robots.energy_j,
            reference_j=np.full(self._num_envs, sim.robots.reference_joules),
            path_before=way[0],
            path_after=way[1],
            goal_distance=np.hypot(*(sim.goals - sim.poses[:, :2]).T),
            reached=ends.reached,
            collided=ends.collided,
            flat_battery=ends.flat,
        )

    def _terms_of_student(self, transition: rewards.Transition) -> dict[str, np.ndarray]:
        found = []
        for i in range(self._num_envs):
            terms = self._function(rewards.Transition(**{k: v[i] for k, v in vars(transition).items()}))
            if set(terms) != set(rewards.TERMS):
                raise ValueError(f"reward_terms must return {', '.join(rewards.TERMS)}; got {', '.join(sorted(terms))}")
            found.append(terms)
        return {name: np.array([float(terms[name]) for terms in found]) for name in rewards.TERMS}
