"""A small town on foot: how far, and how risky, on streets whose risk changes over the day.

Junctions of a crooked grid, streets between neighbours, some of them closed. Each hot spot of the risk field (a market
at noon, a park at dusk, a bar quarter at night) has its hours, so the safe way is another one at another time, and may
change while one walks. Two objectives: metres walked, and risk, the expected number of incidents in a thousand walks.
Times are whole minutes, so that the exact answer is a shortest path in junctions times minutes (`exact_walk`).

Source: the article's opening paragraph (routes that weigh crime risk against distance, by DQN).
"""

from dataclasses import dataclass
from itertools import pairwise

import gymnasium
import networkx as nx
import numpy as np
from gymnasium.vector import AutoresetMode

from dualnav_lite import streams
from dualnav_lite.interface import last_observations

SIDE = 7  # junctions along a side
BLOCK_M, CROOKED_M = 120.0, 35.0
CLOSED_SHARE = 0.15  # of the streets
WALK_M_MIN = 80.0
DAY_MIN = 24 * 60
SLOTS = 8  # streets that may leave a junction, by compass direction
MOST_MOVES = 60  # of a walk, then it is cut off
# x, y [blocks], reach [m], hour of the peak, hours to either side, incidents in 1,000 walks of 100 m at the peak
HOT_SPOTS = ((1.5, 4.5, 190.0, 13.0, 3.0, 3.0), (4.5, 1.5, 220.0, 19.5, 2.5, 5.0), (3.2, 3.2, 230.0, 0.5, 3.5, 7.0))
BACKGROUND = 0.15  # the same everywhere and always
RISK_PER_M = 60.0  # metres that one incident in 1,000 walks weighs as much as, for preference 0.5


@dataclass(frozen=True)
class Town:
    """A street graph.

    Attributes:
        places: (J, 2) junctions [m].
        neighbours: (J, SLOTS) junction at the end of each street by compass direction, -1 where there is none.
        lengths: (J, SLOTS) [m], 0 where there is none.
        minutes: (J, SLOTS) whole minutes to walk it.
    """

    places: np.ndarray
    neighbours: np.ndarray
    lengths: np.ndarray
    minutes: np.ndarray


def build_town(seed: int = 0) -> Town:
    """A connected town from a seed."""
    rng = streams.stream(seed, "town")
    grid = nx.grid_2d_graph(SIDE, SIDE)
    order = {junction: k for k, junction in enumerate(sorted(grid))}
    places = BLOCK_M * np.array(sorted(grid), float) + rng.uniform(-CROOKED_M, CROOKED_M, (SIDE * SIDE, 2))
    graph = nx.relabel_nodes(grid, order)
    for k in range(0, SIDE - 1, 2):  # a few alleys across the blocks
        graph.add_edge(order[k, k], order[k + 1, k + 1])
    streets = sorted(graph.edges)
    for street in rng.permutation(len(streets))[: round(CLOSED_SHARE * len(streets))]:
        graph.remove_edge(*streets[street])
        if not nx.is_connected(graph):
            graph.add_edge(*streets[street])
    neighbours = np.full((len(places), SLOTS), -1)
    for a, b in [*graph.edges, *(edge[::-1] for edge in graph.edges)]:
        way = places[b] - places[a]
        wanted = int(np.rint(np.arctan2(way[1], way[0]) / (2.0 * np.pi / SLOTS))) % SLOTS
        free = next(slot for turn in range(SLOTS) if neighbours[a, slot := (wanted + turn) % SLOTS] < 0)
        neighbours[a, free] = b
    gaps = places[neighbours] - places[:, None]
    lengths = np.where(neighbours >= 0, np.hypot(gaps[..., 0], gaps[..., 1]), 0.0)
    minutes = np.where(neighbours >= 0, np.maximum(np.rint(lengths / WALK_M_MIN), 1), 0).astype(np.int64)
    return Town(places, neighbours, lengths, minutes)


def risk_density(places, minute) -> np.ndarray:
    """Incidents in 1,000 walks of 100 m at (..., 2) places [m] and a time [min]; broadcast."""
    hour = np.asarray(minute)[..., None] / 60.0
    x, y, reach, peak, width, height = np.array(HOT_SPOTS).T
    places = np.asarray(places, float)[..., None, :]
    away = (places[..., 0] - BLOCK_M * x) ** 2 + (places[..., 1] - BLOCK_M * y) ** 2
    off = (hour - peak + 12.0) % 24.0 - 12.0
    return BACKGROUND + (height * np.exp(-0.5 * away / reach**2 - 0.5 * (off / width) ** 2)).sum(axis=-1)


def street_risk(town: Town, minute) -> np.ndarray:
    """(..., J, SLOTS) risk of walking each street at a time (...) [min]: its length times the density at its middle."""
    middle = 0.5 * (town.places[:, None] + town.places[town.neighbours])
    minute = np.asarray(minute, float)[..., None, None]
    return np.where(town.neighbours >= 0, risk_density(middle, minute) * town.lengths / 100.0, 0.0)


def weigh(metres, risk, preference):
    """What is minimised: metres for preference 1, metres' worth of risk for 0, and both in between."""
    return preference * metres + (1.0 - preference) * RISK_PER_M * risk


@dataclass(frozen=True)
class Walk:
    """Junctions in order, and both objectives."""

    junctions: tuple[int, ...]
    metres: float
    risk: float


def walk_of(town: Town, junctions, minute: int) -> Walk:
    """Metres and risk of a way that starts at a minute of the day."""
    metres = risk = 0.0
    for here, there in pairwise(junctions):
        slot = int(np.flatnonzero(town.neighbours[here] == there)[0])
        metres += town.lengths[here, slot]
        risk += street_risk(town, minute)[here, slot]
        minute += town.minutes[here, slot]
    return Walk(tuple(int(one) for one in junctions), float(metres), float(risk))


def exact_walk(town: Town, start: int, goal: int, minute: int, preference: float, horizon_min: int = 60) -> Walk:
    """The best way, by Dijkstra on junctions times minutes (networkx); no one waits.

    Raises:
        networkx.NetworkXNoPath: the goal cannot be reached within the horizon.
    """
    risks = street_risk(town, minute + np.arange(horizon_min + 1))
    costs = weigh(town.lengths, risks, preference)
    graph = nx.DiGraph()
    for here, slot in zip(*np.nonzero(town.neighbours >= 0), strict=True):
        there, took = int(town.neighbours[here, slot]), int(town.minutes[here, slot])
        for t in range(horizon_min + 1 - took):
            graph.add_edge((int(here), t), (there, t + took), weight=float(costs[t, here, slot]))
    for t in range(horizon_min + 1):
        graph.add_edge((goal, t), "there", weight=0.0)
    way = nx.dijkstra_path(graph, (start, 0), "there")
    return walk_of(town, [junction for junction, _ in way[:-1]], minute)


def frozen_walk(town: Town, start: int, goal: int, minute: int, preference: float) -> Walk:
    """The way that would be best if the risk stayed as it is at departure: what a route planner of a phone answers."""
    costs = weigh(town.lengths, street_risk(town, minute), preference)
    graph = nx.DiGraph()
    for here, slot in zip(*np.nonzero(town.neighbours >= 0), strict=True):
        graph.add_edge(int(here), int(town.neighbours[here, slot]), weight=float(costs[here, slot]))
    return walk_of(town, nx.dijkstra_path(graph, start, goal), minute)


class StreetsVectorEnv(gymnasium.vector.VectorEnv):
    """Many walkers in one town; a step is a street.

    ## Observation
    `Box(size, float32)`: where one is and wants to be, both one-hot; the time of day as sine and cosine; the
    preference; and for each of the 8 compass slots whether a street leaves there, its length and its risk now.
    ## Action
    `Discrete(8)`: the slot. A slot without a street costs a turn and 50 m.
    ## Reward
    (way nearer to the goal in a straight line - `weigh(metres, risk, preference)`) / 100. The first part is
    potential-based (Ng, Harada, Russell, ICML 1999): over a walk it sums to the same whatever way was taken, so the
    best way stays the best and is found sooner. `infos["vector_reward"]` holds (-metres, -risk).
    ## Episode
    ends at the goal, or is cut off after 60 streets. `infos["walks"]` lists (start, goal, minute, preference, metres,
    risk, arrived) of each that ended.

    Args:
        num_envs: walkers.
        town: the streets.
        goals: junctions from which goals are drawn; None: all.
    """

    def __init__(self, num_envs: int, town: Town, goals=None):
        self.town, self.num_envs = town, num_envs
        self._goals = np.arange(len(town.places)) if goals is None else np.asarray(goals, np.int64)
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        size = 2 * len(town.places) + 3 + 3 * SLOTS
        self.single_observation_space = gymnasium.spaces.Box(-5.0, 5.0, (size,), np.float32)
        self.single_action_space = gymnasium.spaces.Discrete(SLOTS)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self._rng = np.random.default_rng(0)
        self.here, self.goal, self.minute, self.moves, self._from = np.zeros((5, num_envs), np.int64)
        self._left = np.zeros(num_envs, np.int64)  # minute of departure
        self.preference = np.zeros(num_envs)
        self.sums = np.zeros((num_envs, 2))

    def reset(self, *, seed: int | None = None, options=None):
        """New walkers everywhere; `options["trips"]`: (n, 4) start, goal, minute, preference, to choose them."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        everybody = np.arange(self.num_envs)
        self._start(everybody, (options or {}).get("trips"))
        return self.observe(), {}

    def _start(self, which, trips=None) -> None:
        n, junctions = len(which), len(self.town.places)
        if trips is None:
            goal = self._rng.choice(self._goals, size=n)
            start = (goal + self._rng.integers(1, junctions, size=n)) % junctions
            minute, preference = self._rng.integers(DAY_MIN, size=n), self._rng.random(n)
        else:
            start, goal, minute = np.asarray(trips)[:, :3].astype(np.int64).T
            preference = np.asarray(trips, float)[:, 3]
        self.here[which] = self._from[which] = start
        self.goal[which], self.preference[which] = goal, preference
        self.minute[which] = self._left[which] = minute
        self.moves[which], self.sums[which] = 0, 0.0

    def observe(self) -> np.ndarray:
        """(n, size) what the walkers know."""
        n, junctions, rows = self.num_envs, len(self.town.places), np.arange(self.num_envs)
        seen = np.zeros((n, self.single_observation_space.shape[0]), np.float32)
        seen[rows, self.here], seen[rows, junctions + self.goal] = 1.0, 1.0
        angle = 2.0 * np.pi * self.minute / DAY_MIN
        seen[:, 2 * junctions : 2 * junctions + 3] = np.stack([np.sin(angle), np.cos(angle), self.preference], axis=1)
        slots = seen[:, 2 * junctions + 3 :].reshape(n, 3, SLOTS)
        slots[:, 0] = self.town.neighbours[self.here] >= 0
        slots[:, 1] = self.town.lengths[self.here] / BLOCK_M
        slots[:, 2] = self._risks() / 5.0
        return seen

    def _risks(self) -> np.ndarray:
        """(n, SLOTS) risk of the streets that leave from here, now."""
        town, ends = self.town, self.town.neighbours[self.here]
        middle = 0.5 * (town.places[self.here][:, None] + town.places[ends])
        density = risk_density(middle, self.minute[:, None].astype(float))
        return np.where(ends >= 0, density * town.lengths[self.here] / 100.0, 0.0)

    def _straight_m(self, junctions) -> np.ndarray:
        """(n,) straight line from junctions to the goals."""
        return np.hypot(*(self.town.places[junctions] - self.town.places[self.goal]).T)

    def step(self, actions):
        """Everybody walks a street."""
        rows, chosen = np.arange(self.num_envs), np.asarray(actions)
        before, there = self.here, self.town.neighbours[self.here, chosen]
        is_street = there >= 0
        metres = np.where(is_street, self.town.lengths[self.here, chosen], 50.0)
        risk = self._risks()[rows, chosen]
        self.minute = self.minute + np.where(is_street, self.town.minutes[self.here, chosen], 1)
        self.here = np.where(is_street, there, self.here)
        self.moves = self.moves + 1
        self.sums += np.stack([metres, risk], axis=1)
        nearer = self._straight_m(before) - self._straight_m(self.here)
        reward = (nearer - weigh(metres, risk, self.preference)) / 100.0
        terminated = self.here == self.goal
        truncated = ~terminated & (self.moves >= MOST_MOVES)
        infos: dict = {"vector_reward": -np.stack([metres, risk], axis=1)}
        ended = np.flatnonzero(terminated | truncated)
        observations = self.observe()
        if len(ended):
            infos["final_obs"] = last_observations(observations, terminated | truncated)
            columns = (self._from, self.goal, self._left, self.preference, *self.sums.T, terminated)
            infos["walks"] = [tuple(column[i].item() for column in columns) for i in ended]
            self._start(ended)
            observations = self.observe()
        return observations, reward, terminated, truncated, infos


def street_mask(observations):
    """(n, SLOTS) bool: which slots hold a street, read from observations (a tensor); for `dqn.QNetwork`."""
    first = observations.shape[1] - 3 * SLOTS
    return observations[:, first : first + SLOTS] > 0.5
