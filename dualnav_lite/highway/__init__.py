"""highway-env as a second world (`simulator: highway`): cars behind the interface that the robot has.

The physics, the roads and the other drivers are highway-env's (Leurent, "An environment for autonomous driving
decision-making", 2018). Observation, reward terms, preference, seeds, episode rows and autoreset are this kit's, so
PPO, `evaluate` and every table run on it unchanged. Nothing of the core imports this file.
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from dualnav_lite import rewards, streams
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.env import OneWorld
from dualnav_lite.geometry import to_robot, wrap_angle
from dualnav_lite.highway.cars import (
    CarTransition,
    car_terms,
    gaps,
    kinetic_energy,
    predicted_intrusion,
    step_energy,
    time_gap,
)
from dualnav_lite.highway.tasks import HALF, TASKS
from dualnav_lite.interface import checked_actions, checked_reset, last_observations, restarted_infos
from dualnav_lite.journal import Journal, outcome_of_contact
from dualnav_lite.scenario import Scenario, load_scenario
from dualnav_lite.semantics import Surface

DT_S = 0.2  # five decisions a second


def highway_scenario(config: Config, scenario: str | Scenario | None) -> Scenario:
    """The one scenario asked for, else the configured one; `UnusableInput` where it is none of cars."""
    return load_scenario(scenario or config.scenario, "highway")


class HighwayVectorEnv(gymnasium.vector.VectorEnv):
    """Many cars, each in a world of its own, behind the interface of `DynamicNavVectorEnv`.

    Observations are (n, size) float32 vectors, the preference last; actions are physical: acceleration [m/s2] and
    steering angle [rad]. Rewards, `infos["reward_terms"]`, `["vector_reward"]`, `["reward_weights"]`, `["summary"]`,
    preferences, seeds and autoreset are as there; the charge is always full.

    Args:
        num_envs: number of worlds n.
        config: with `simulator: highway`.
        scenario: "parking", "traffic" or a `Scenario` with `cars`; the config's if None.
        autoreset: False leaves finished worlds to `reset(options={"reset_mask": ...})`.
        render_mode: None or "rgb_array" (highway-env's own drawing).

    Raises:
        UnusableInput: another simulator, or a scenario without cars.
    """

    def __init__(
        self,
        num_envs: int = 8,
        config: Config | None = None,
        scenario: str | Scenario | None = None,
        *,
        autoreset: bool = True,
        render_mode: str | None = None,
    ):
        self.config = config or Config(simulator="highway", scenario="parking")
        if self.config.simulator != "highway":
            raise UnusableInput(f"simulator '{self.config.simulator}' has an environment of its own, this is 'highway'")
        self.scenario = highway_scenario(self.config, scenario)
        self.num_envs, self.render_mode, n = num_envs, render_mode, num_envs
        mode = AutoresetMode.SAME_STEP if autoreset else AutoresetMode.DISABLED
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 5, "autoreset_mode": mode}
        cars = self.scenario.cars
        self.tasks: list[Any] = [TASKS[cars.task](cars.others, render_mode) for _ in range(n)]
        self.limits = limits = self.tasks[0].limits.astype(np.float32)
        self.single_action_space = gymnasium.spaces.Box(-limits, limits, dtype=np.float32)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (self.tasks[0].size,), np.float32)
        self.action_space = batch_space(self.single_action_space, n)
        self.observation_space = batch_space(self.single_observation_space, n)
        self.reward_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(rewards.TERMS),), np.float64)
        self.journal, self.preference = Journal(n), np.zeros(n)
        self.is_done, self._has_begun, self._autoreset = np.zeros(n, bool), False, autoreset
        self._seeds = streams.EpisodeSeeds(n)
        self._steps = np.zeros(n, np.int64)
        self._ways = np.zeros(n)
        self._observations = np.zeros((n, self.tasks[0].size), np.float32)

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None):
        """Start new episodes; arguments and returns as in `DynamicNavVectorEnv.reset`."""
        mask, seeds, preference = checked_reset(self.num_envs, seed, options, self._has_begun)
        self._has_begun = True
        self._observations = self._observations.copy()
        for i in np.flatnonzero(mask).tolist():
            self._start(i, seeds[i], preference[i])
        return self._observations, self._infos(np.zeros(self.num_envs, bool))

    def _start(self, world: int, seed: int | None, preference: float | None) -> None:
        seed = self._seeds.next(world, seed)
        task = self.tasks[world]
        task.env.reset(seed=int(streams.stream(seed, "highway").integers(2**31)))
        task.begin()
        preference = streams.preference_of(seed, preference, self.config.preference)
        self.preference[world] = preference
        self.is_done[world], self._steps[world], self._ways[world] = False, 0, task.way()
        self.journal.reset(world, preference, self._clearance(task)[0])
        self._observations[world] = self._observe(world)

    def _observe(self, world: int) -> np.ndarray:
        return np.array([*self.tasks[world].observe(), 2.0 * self.preference[world] - 1.0], np.float32)

    def _clearance(self, task) -> tuple[float, Surface]:
        """Least gap to a wall or another car [m], and what is nearest."""
        car, others = task.env.vehicle, task.others()
        walls = task.wall_gap()
        bodies = [[*one.position, one.heading, *HALF] for one in others]
        cars = float(gaps([*car.position, car.heading, *HALF], bodies).min(initial=np.inf))
        # highway-env pushes bodies apart that touch; what crashed has no gap.
        cars = 0.0 if car.crashed else cars
        return min(walls, cars), Surface.WALL if walls < cars else Surface.ROBOT

    def _drive(self, world: int, action) -> tuple[dict[str, float], tuple]:
        """One step of one world: reward terms, and (reached, touched, clearance, energy, metres, dv/dt, twist)."""
        task = self.tasks[world]
        env, way, speed = task.env, self._ways[world], task.env.vehicle.speed
        here, heading = env.vehicle.position.copy(), env.vehicle.heading
        env.step(action / task.limits)
        car, others = env.vehicle, task.others()
        clearance, nearest = self._clearance(task)
        touched = nearest if clearance <= 0.0 else Surface.NOTHING
        reached = touched == Surface.NOTHING and task.has_arrived()
        pose = np.array([*car.position, car.heading])
        places = to_robot(np.reshape([one.position for one in others], (-1, 2)), pose)
        turned = np.array([0.0, 0.0, car.heading])
        motions = to_robot(np.reshape([one.velocity - car.velocity for one in others], (-1, 2)), turned)
        self._ways[world] = task.way()
        energy = step_energy(speed, car.speed, DT_S)
        kept = task.usual_speed if reached or touched != Surface.NOTHING else car.speed
        transition = CarTransition(
            clearance, task.safe_m, time_gap(places, car.speed), predicted_intrusion(places, motions, task.safe_m),
            energy - kinetic_energy(kept) + kinetic_energy(speed),
            step_energy(task.usual_speed, task.usual_speed, DT_S), task.energy_scale, way, self._ways[world],
            task.way_scale, reached, touched != Surface.NOTHING,
        )  # fmt: skip
        terms = car_terms(transition)
        twist = (car.speed, float(wrap_angle(car.heading - heading)) / DT_S)
        metres = float(np.hypot(*(car.position - here)))
        return terms, (reached, touched, clearance, energy, metres, ((car.speed - speed) / DT_S) ** 2, twist)

    def step(self, actions):
        """Advance every world by 0.2 s.

        Args:
            actions: (n, 2) acceleration [m/s2], steering [rad]; clipped to the limits and noted in `infos["clipped"]`.

        Returns:
            observations (n, size), rewards (n,), terminations (n,), truncations (n,), infos.

        Raises:
            ValueError: wrong shape, or numbers that are not finite.
            gymnasium.error.ResetNeeded: before the first reset, or when every world has ended.
        """
        if not self._has_begun or self.is_done.all():
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        n, active = self.num_envs, ~self.is_done
        actions = checked_actions(actions, n).astype(float)
        commands = np.clip(actions, -self.limits.astype(float), self.limits)
        clipped = (commands != actions).any(axis=1) & active
        self._steps += active
        terms = {name: np.zeros(n) for name in rewards.TERMS}
        reached, touched = np.zeros(n, bool), np.zeros(n, np.int64)
        clearance, energy, metres, squares = np.zeros((4, n))
        twists = np.zeros((n, 2))
        self._observations = self._observations.copy()
        for i in np.flatnonzero(active).tolist():
            found, (reached[i], touched[i], clearance[i], energy[i], metres[i], squares[i], twists[i]) = self._drive(
                i, commands[i]
            )
            for name, value in found.items():
                terms[name][i] = value
            self._observations[i] = self._observe(i)
        vector = rewards.vector_reward(terms)
        self.journal.record(active, metres, clearance, energy, squares, twists, vector)
        self.journal.goals += reached
        self.journal.contacts += touched > 0
        terminated = reached | (touched > 0)
        truncated = active & ~terminated & (self._steps * DT_S >= self.scenario.cars.limit_s - 1e-9)
        self.is_done |= terminated | truncated
        infos = self._infos(clipped, terms, vector, twists)
        reward = (vector * infos["reward_weights"]).sum(axis=1)
        ended = terminated | truncated
        if ended.any():
            self._add_summaries(infos, ended, reached, touched)
            if self._autoreset:
                infos = self._restart(infos, ended)
        return self._observations, reward, terminated, truncated, infos

    def _infos(self, clipped, terms=None, vector=None, twists=None) -> dict[str, Any]:
        n = self.num_envs
        return {
            "twist": np.array([[task.env.vehicle.speed, 0.0] for task in self.tasks]) if twists is None else twists,
            "pose": np.array([[*task.env.vehicle.position, task.env.vehicle.heading] for task in self.tasks]),
            "battery": np.ones(n),
            "preference": self.preference.copy(),
            "way_m": self._ways.copy(),
            "reward_terms": terms or {name: np.zeros(n) for name in rewards.TERMS},
            "vector_reward": np.zeros((n, len(rewards.TERMS))) if vector is None else vector,
            "reward_weights": rewards.reward_weights(self.preference, np.ones(n), self.config.rewards),
            "clipped": clipped,
            "time_s": self._steps * DT_S,
        }

    def _add_summaries(self, infos, ended, reached, touched) -> None:
        """Put the finished episodes' measurements into `infos["summary"]`, in the columns of `episodes.csv`."""
        outcomes = np.full(self.num_envs, "timeout", dtype=object)
        outcomes[reached] = "goal"
        for i in np.flatnonzero(touched):
            outcomes[i] = outcome_of_contact(touched[i])
        nothing, never = np.zeros(self.num_envs, np.int64), np.full(self.num_envs, np.nan)
        reasons = np.full(self.num_envs, "", dtype=object)
        summary = self.journal.summary(DT_S, np.ones(self.num_envs), nothing, never, touched, outcomes, reasons)
        infos["summary"], infos["_summary"] = summary, ended.copy()

    def _restart(self, infos, ended) -> dict[str, Any]:
        """Same-step autoreset, as in `DynamicNavVectorEnv`."""
        final_obs = last_observations(self._observations, ended)
        for i in np.flatnonzero(ended).tolist():
            self._start(i, None, None)
        return restarted_infos(infos, self._infos(infos["clipped"]), final_obs, ended)

    def render(self):
        """(n,) tuple of (H, W, 3) uint8 pictures, drawn by highway-env."""
        if self.render_mode != "rgb_array":
            raise gymnasium.error.Error("render() needs render_mode='rgb_array'")
        for task in self.tasks:
            if task.env.viewer is None:
                task.env.render()  # makes the viewer, which then thinks that without a display nothing can be drawn
                task.env.viewer.enabled = True
        return tuple(task.env.render() for task in self.tasks)

    def close_extras(self, **kwargs):
        """End the worlds."""
        for task in self.tasks:
            task.env.close()


class HighwayEnv(OneWorld):
    """One car behind Gymnasium's interface; see `HighwayVectorEnv` for spaces, rewards and arguments."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012

    def __init__(self, config: Config | None = None, scenario: str | Scenario | None = None, render_mode=None):
        super().__init__(HighwayVectorEnv(1, config, scenario, autoreset=False, render_mode=render_mode))
