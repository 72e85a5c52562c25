"""A fleet behind the calls of PettingZoo's parallel interface, with the cross-agent term in its reward."""

from typing import Any

import numpy as np

from dualnav_lite import rewards
from dualnav_lite.config import Config
from dualnav_lite.fleet import CrossTerm, FleetWorlds, draw_layout
from dualnav_lite.interface import action_box, checked_actions, checked_seed, observation_box, split_infos
from dualnav_lite.perception import Percept, Perception
from dualnav_lite.scenario import load_scenario


class FleetEnv:
    """One fleet behind the calls of PettingZoo's parallel interface (Terry et al., "PettingZoo", 2021); no dependency.

    Agents are "robot_0", ...; those that have touched something, arrived or run out of time leave `agents`. Each gets
    the observation, the reward and the infos of `DynamicNavEnv`; r_dynamic holds `cross_weight` r_cross as well.

    Args:
        config: of every robot.
        scenario: one with a fleet, or its id.
        cross_weight: of the cross-agent term; the scenario's if None, 0 leaves it out.
    """

    metadata = {"name": "dualnav_fleet"}  # noqa: RUF012

    def __init__(self, config: Config | None = None, scenario="fleet_crossing", cross_weight: float | None = None):
        self.config = config or Config()
        self.scenario = load_scenario(scenario, "fleet")
        self.cross_weight = self.scenario.fleet.cross_weight if cross_weight is None else cross_weight
        self.possible_agents = [f"robot_{k}" for k in range(self.scenario.fleet.robots)]
        self.agents: list[str] = []

    def observation_space(self, agent: str):
        """The image of `encoder.CHANNELS`, the same for every agent."""
        return observation_box(self.config)

    def action_space(self, agent: str):
        """v [m/s], omega [rad/s], the same for every agent."""
        return action_box(self.config)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None):
        """Observations and infos, a dictionary by agent each; the same seed gives the same bytes."""
        seed = int(np.random.default_rng().integers(1_000_000)) if seed is None else checked_seed(seed)
        self.worlds = FleetWorlds([draw_layout(self.scenario, self.config, seed)], self.scenario, self.config)
        n, sim = len(self.possible_agents), self.worlds
        self._preference = np.full(n, 0.5 if self.config.preference == "drawn" else self.config.preference)
        self._perception, self._cross = Perception(n, self.config), CrossTerm()
        for row in range(n):
            self._perception.reset(row, self.scenario, seed * 4 + row, sim)  # type: ignore[arg-type]
        self.agents = list(self.possible_agents)
        self._percept = self._sense()
        return self._told(self._cross(sim, self._percept))

    def _sense(self) -> Percept:
        n = len(self.possible_agents)
        return self._perception.sense(self.worlds, np.ones(n, bool), np.zeros(n, bool))  # type: ignore[arg-type]

    def _told(self, cross):
        """Observations and infos of the agents that are under way."""
        sim: Any = self.worlds
        images = self._perception.encode(self._percept, sim, self._preference, slice(None))
        infos = split_infos(self._percept.infos(sim.robots, self._preference, sim.outcomes != ""), len(sim.poses))
        rows = [self.possible_agents.index(agent) for agent in self.agents]
        for row in rows:
            infos[row]["r_cross"] = float(cross[row])
        return (
            {agent: images[row] for agent, row in zip(self.agents, rows, strict=True)},
            {agent: infos[row] for agent, row in zip(self.agents, rows, strict=True)},
        )

    def step(self, actions: dict[str, Any]):
        """Observations, rewards, terminations, truncations and infos, a dictionary by agent each."""
        if set(actions) != set(self.agents):
            raise ValueError(f"an action is needed for each of {self.agents}, got {sorted(actions)}")
        sim, n = self.worlds, len(self.possible_agents)
        commands = np.zeros((n, 2))
        for agent, action in actions.items():
            commands[self.possible_agents.index(agent)] = checked_actions(np.asarray(action)[None], 1)[0]
        before = sim.path_length.copy()
        sim.advance(commands)
        self._percept = self._sense()
        cross = self._cross(sim, self._percept)
        reached, touched = sim.outcomes == "goal", np.array([one.startswith("hit_") for one in sim.outcomes])
        intrusion = rewards.predicted_intrusion(sim.robots.twist, self._percept.prediction)
        still = np.zeros((n, 2))
        terms = rewards.reward_terms(
            rewards.Transition(
                np.where(touched, 0.0, sim.clearance), self._percept.scans[..., 0].min(axis=1), sim.robots.twist,
                still, still, intrusion, sim.robots.energy_j, sim.robots.reference_joules, before, sim.path_length,
                np.hypot(*(sim.goals - sim.poses[:, :2]).T), reached, touched, sim.robots.battery <= 0.0,
            ),
            self.config.rewards,
        )  # fmt: skip
        terms["dynamic"] = terms["dynamic"] + self.cross_weight * cross
        vector = rewards.vector_reward(terms)
        weights = rewards.reward_weights(self._preference, sim.robots.battery, self.config.rewards)
        observations, infos = self._told(cross)
        for agent, info in infos.items():
            row = self.possible_agents.index(agent)
            info |= {"vector_reward": vector[row], "reward_weights": weights[row], "outcome": sim.outcomes[row]}
        rows = {agent: self.possible_agents.index(agent) for agent in self.agents}
        total = (vector * weights).sum(axis=1)
        results = (
            {agent: float(total[row]) for agent, row in rows.items()},
            {agent: bool(reached[row] or touched[row]) for agent, row in rows.items()},
            {agent: sim.outcomes[row] == "timeout" for agent, row in rows.items()},
        )
        self.agents = [agent for agent in self.agents if not sim.outcomes[rows[agent]]]
        return observations, *results, infos
