"""Many worlds behind Gymnasium's vector interface, in one process: action, sensing, reward, autoreset."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from dualnav_lite import rewards, streams
from dualnav_lite.canvas import THEMES
from dualnav_lite.config import Config, UnusableInput, load_config
from dualnav_lite.interface import (
    action_box,
    checked_actions,
    checked_reset,
    last_observations,
    observation_box,
    restarted_infos,
)
from dualnav_lite.journal import Journal
from dualnav_lite.perception import Percept, Perception
from dualnav_lite.render import draw
from dualnav_lite.reward_model import RewardModel
from dualnav_lite.scenario import Scenario, resolve_scenarios
from dualnav_lite.simulation import Simulation
from dualnav_lite.task import Task
from dualnav_lite.truth import truth_of


class DynamicNavVectorEnv(gymnasium.vector.VectorEnv):
    """Many worlds in one process, stepped together by batched kernels; a world's rows do not depend on the others.

    Everything in `DynamicNavEnv`'s card holds, with a leading axis of worlds; infos are dictionaries of arrays, and
    `split_infos` turns them into the list that planners and policies take.

    Autoreset: `AutoresetMode.SAME_STEP` by default: the step that ends an episode returns the first observation of the
    next one, and the last one stands in `infos["final_obs"]` (a truncated step must be bootstrapped with its value).
    With `autoreset=False` (`AutoresetMode.DISABLED`) a finished world stands still until
    `reset(options={"reset_mask": ...})`.

    Args:
        num_envs: number of worlds n.
        config: a `Config`, or the path of a config file, or None for the defaults.
        scenario: id, path, `Scenario`, or a sequence of them from which each episode draws one by its seed.
        truth: put the simulator's own state into `infos["truth"]`, for the ceiling planner and teachers.
        full_map: put the whole received map into `infos["received_map"]`.
        encoder, reward_function, predictor: a student's parts (SPEC 15), the first two called a world at a time; None
            for the library's.
        autoreset: see above.
        render_mode: None or "rgb_array"; render_theme: "light", or "dark" for a dark notebook.

    Attributes:
        observations: (n, C, 64, 64) as the last reset or step returned them; not to be written to.

    Raises:
        UnusableInput: a config or scenario that cannot be used.
    """

    def __init__(
        self,
        num_envs: int = 8,
        config: Config | str | Path | None = None,
        scenario: str | Scenario | Sequence[str | Scenario] | None = None,
        *,
        truth: bool = False,
        full_map: bool = False,
        encoder: Callable | None = None,
        reward_function: Callable | None = None,
        predictor: Callable | None = None,
        autoreset: bool = True,
        render_mode: str | None = None,
        render_theme: str = "light",
    ):
        self.config = config if isinstance(config, Config) else load_config(config)
        if self.config.simulator != "pymunk":
            raise UnusableInput(
                f"simulator '{self.config.simulator}' has an environment of its own (dualnav_lite.highway), "
                "this one is 'pymunk'"
            )
        if not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise UnusableInput(f"num_envs must be a whole number of at least 1, got {num_envs!r}")
        if render_mode not in (None, "rgb_array"):
            raise UnusableInput(f"render_mode '{render_mode}' is unknown; known: None, 'rgb_array'")
        if render_theme not in THEMES:
            raise UnusableInput(f"render_theme '{render_theme}' is unknown; known: {', '.join(THEMES)}")
        self.num_envs, self.render_mode, self._theme = num_envs, render_mode, render_theme
        mode = AutoresetMode.SAME_STEP if autoreset else AutoresetMode.DISABLED
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": mode}
        self.scenarios = resolve_scenarios(self.config, scenario)
        self.single_action_space, self.single_observation_space = action_box(self.config), observation_box(self.config)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.reward_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(rewards.TERMS),), np.float64)
        # The float32 bounds of the space, so that a legal float32 action is never counted as clipped.
        self._limits = self.single_action_space.high.astype(float)
        self.sim = Simulation(num_envs, self.config)
        self.perception = Perception(num_envs, self.config, encoder, predictor)
        self.reward_model = RewardModel(num_envs, self.config.rewards, self.config.robot.hull_radius_m, reward_function)
        self.task = Task(num_envs, self.config.control_dt_s)
        self.journal = Journal(num_envs)
        self.preference = np.zeros(num_envs)
        self.is_done = np.zeros(num_envs, bool)
        self.percept: Percept | None = None
        self.trails: list[list[np.ndarray]] = [[] for _ in range(num_envs)]
        self._show_truth, self._show_map, self._autoreset = truth, full_map, autoreset
        self._seeds = streams.EpisodeSeeds(num_envs)
        self.observations = np.zeros(self.observation_space.shape, np.float32)

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None):
        """Start new episodes.

        Args:
            seed: of world 0, world i getting seed + i; or one for each world. The seed is the episode's: it names the
                layout and every draw. Later episodes of a world draw theirs from it. None continues those draws.
            options: `reset_mask` (n,) bool, worlds to reset (default all); `preference`, one number or (n,).

        Returns:
            observations (n, C, 64, 64) float32 and infos; worlds outside the mask keep their last observation.
        """
        mask, seeds, preference = checked_reset(self.num_envs, seed, options, has_begun=self.percept is not None)
        for i in np.flatnonzero(mask).tolist():
            self._start(i, seeds[i], preference[i])
        self._sense_first(mask)
        return self.observations, self.present_infos()

    def _start(self, world: int, seed: int | None, preference: float | None) -> None:
        """Begin an episode in one world, without sensing."""
        seed = self._seeds.next(world, seed)
        pick = int(streams.stream(seed, "scenario").integers(len(self.scenarios))) if len(self.scenarios) > 1 else 0
        scenario = self.scenarios[pick]
        self.sim.reset(world, scenario, seed)
        self.perception.reset(world, scenario, seed, self.sim)
        preference = streams.preference_of(seed, preference, self.config.preference)
        self.preference[world] = preference
        self.journal.reset(world, preference, self.sim.clearance[world])
        self.task.reset(world, self.sim)
        self.is_done[world] = False
        self.trails[world] = [self.sim.poses[world].copy()]
        self.reward_model.reset(world)

    def _sense_first(self, mask) -> None:
        """First observation of the worlds in the mask."""
        self._merge(self.perception.sense(self.sim, mask, self.task.idle), mask)
        self._encode(mask)

    def _encode(self, mask) -> None:
        """New observations of the worlds in the mask, in an array nobody has been given yet."""
        if mask.all():
            self.observations = self.perception.encode(self.percept, self.sim, self.preference, slice(None))
        else:
            worlds = np.flatnonzero(mask)
            self.observations = self.observations.copy()
            self.observations[worlds] = self.perception.encode(self.percept, self.sim, self.preference, worlds)

    def _merge(self, percept: Percept, mask) -> None:
        """Keep the old percept of the worlds that were not sensed."""
        if self.percept is not None and not mask.all():
            keep = ~mask
            for name, fresh in vars(percept).items():
                old = getattr(self.percept, name)
                if isinstance(fresh, np.ndarray):
                    fresh[keep] = old[keep]
                else:
                    for part, values in vars(fresh).items():
                        values[keep] = getattr(old, part)[keep]
        self.percept = percept

    def _commands(self, actions, idle):
        """Commands inside the hardware limits, and whether each action was clipped."""
        actions = checked_actions(actions, self.num_envs)
        commands = np.minimum(np.maximum(actions.astype(float), -self._limits), self._limits)
        clipped = (commands != actions).any(axis=1) & ~idle
        commands[idle] = 0.0
        return commands, clipped

    def step(self, actions):
        """Advance every world by one control step.

        Args:
            actions: (n, 2) v [m/s], omega [rad/s]; clipped to the hardware limits and noted in `infos["clipped"]`.

        Returns:
            observations (n, C, 64, 64), rewards (n,), terminations (n,), truncations (n,), infos.

        Raises:
            ValueError: wrong shape, or numbers that are not finite.
            gymnasium.error.ResetNeeded: before the first reset, or when every world has ended.
        """
        if self.percept is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        if self.is_done.all():
            raise gymnasium.error.ResetNeeded("the episode is over: call reset() before the next step()")
        return self.advance(actions)

    def advance(self, actions):
        """`step` for a share of the worlds of `ParallelVectorEnv`: all of them may have ended."""
        sim, active = self.sim, ~self.is_done
        idle = self.task.idle
        commands, clipped = self._commands(actions, idle)
        odometer, path_before = sim.odometer_m.copy(), sim.path_length
        sim.advance(commands, active)
        path_after, surfaces = sim.path_length.copy(), sim.contacts.copy()
        ends = self.task.judge(sim, active, self.journal)
        for world in self.task.follow(sim, ends, active):
            self.perception.tell_goal(world, sim)
        percept = self.perception.sense(sim, active, self.task.idle)
        self._merge(percept, active)
        still = idle | ~active
        way = np.where(still, 0.0, path_before), np.where(still, 0.0, path_after)
        terms = self.reward_model.terms(sim, self.percept, way, ends, active)
        vector = rewards.vector_reward(terms)
        weights = rewards.reward_weights(self.preference, sim.robots.battery, self.config.rewards)
        self._encode(active)
        self.journal.record(
            active,
            sim.odometer_m - odometer,
            ends.clearance,
            sim.robots.energy_j,
            sim.robots.acceleration_square,
            sim.robots.twist,
            vector,
        )
        self.is_done = self.is_done | ends.terminated | ends.truncated
        if self.render_mode:
            for i in np.flatnonzero(active):
                self.trails[i].append(sim.poses[i].copy())
        infos = self._infos(clipped, terms, vector, weights)
        self._add_summaries(infos, active & self.is_done, surfaces)
        if self._autoreset and self.is_done.any():
            infos = self._restart(infos)
        return self.observations, (vector * weights).sum(axis=1), ends.terminated, ends.truncated, infos

    def present_infos(self) -> dict[str, Any]:
        """The infos a reset returns, of the worlds as they stand."""
        return self._infos(np.zeros(self.num_envs, bool))

    def _infos(self, clipped, terms=None, vector=None, weights=None) -> dict[str, Any]:
        """Everything a planner, a policy or a reader may know, as fresh arrays."""
        sim, percept, n = self.sim, self.percept, self.num_envs
        if terms is None:
            terms = {name: np.zeros(n) for name in rewards.TERMS}
            vector = np.zeros((n, len(rewards.TERMS)))
            weights = rewards.reward_weights(self.preference, sim.robots.battery, self.config.rewards)
        infos = percept.infos(sim.robots, self.preference, self.task.idle.copy()) | {
            "reward_terms": terms,
            "vector_reward": vector,
            "reward_weights": weights,
            "clipped": clipped,
            "time_s": sim.times_s.copy(),
        }
        if self._show_map:
            infos["received_map"] = self.perception.mapper.received.copy()
        if self._show_truth:
            infos["truth"] = truth_of(sim)
        return infos

    def _add_summaries(self, infos, ended, surfaces) -> None:
        """Put the finished episodes' measurements into `infos["summary"]`."""
        if ended.any():
            sim = self.sim
            infos["summary"] = self.journal.summary(
                self.config.control_dt_s,
                sim.robots.battery,
                sim.movers.events,
                sim.movers.first_event_s,
                surfaces,
                self.task.outcomes,
                self.task.reasons,
            )
            infos["summary"]["scenario"] = np.array([scenario.id for scenario in sim.scenarios], dtype=object)
            infos["summary"]["seed"] = np.array([layout.seed for layout in sim.layouts], dtype=object)
            infos["_summary"] = ended.copy()

    def _restart(self, infos) -> dict[str, Any]:
        """Same-step autoreset: begin anew where an episode ended; its last observation and info are kept."""
        ended = self.is_done.copy()
        final_obs = last_observations(self.observations, ended)
        for i in np.flatnonzero(ended).tolist():
            self._start(i, None, None)
        self._sense_first(ended)
        return restarted_infos(infos, self._infos(infos["clipped"]), final_obs, ended)

    def render(self):
        """(n,) tuple of (H, W, 3) uint8 pictures of the worlds, as drawn by `render.draw`."""
        if self.render_mode != "rgb_array":
            raise gymnasium.error.Error("render() needs render_mode='rgb_array'")
        if self.percept is None:
            raise gymnasium.error.ResetNeeded("call reset() before render()")
        return tuple(draw(self, i, self._theme) for i in range(self.num_envs))
