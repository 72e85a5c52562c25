"""From truth to what the robots know: scan, map over the link, tracks, prediction, guide, observation."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from dualnav_lite import streams
from dualnav_lite.config import Config
from dualnav_lite.encoder import Ego, encode_states
from dualnav_lite.forecast import shipped
from dualnav_lite.geometry import to_robot, to_world
from dualnav_lite.lidar import Lidar
from dualnav_lite.localiser import Localiser
from dualnav_lite.mapping import Mapper
from dualnav_lite.motion import TIMES_S, Prediction
from dualnav_lite.robot import Robots
from dualnav_lite.routing import Guide
from dualnav_lite.scenario import Scenario
from dualnav_lite.simulation import Simulation
from dualnav_lite.tracking import Tracker, Tracks, constant_velocity

FLOW_SCANS = 3  # scans that `encode_state` gets
PREDICTOR_SCANS = 10  # scans that a predictor gets (article 2.3)


@dataclass
class Percept:
    """What n robots know after a control step; every array is fresh, robot frame unless said.

    Attributes:
        scans: (n, beams, 2); pose: (n, 3) believed; map: (n, 64, 64); map_age_s: (n,).
        tracks: nearest moving things; prediction: where they will be.
        goal_robot, guide_robot: (n, 2) [m]; path_robot: (n, 32, 2) [m].
    """

    scans: np.ndarray
    pose: np.ndarray
    map: np.ndarray
    map_age_s: np.ndarray
    tracks: Tracks
    prediction: Prediction
    goal_robot: np.ndarray
    guide_robot: np.ndarray
    path_robot: np.ndarray

    def infos(self, robots: Robots, preference, idle) -> dict[str, Any]:
        """What planners and policies are told, by the names of an environment's infos; (n,) preference and idle."""
        return {
            "scan": self.scans,
            "pose": self.pose,
            "twist": robots.twist.copy(),
            "battery": robots.battery.copy(),
            "goal_robot": self.goal_robot,
            "guide_robot": self.guide_robot,
            "path_robot": self.path_robot,
            "map": self.map,
            "map_age_s": self.map_age_s,
            "preference": preference.copy(),
            "idle": idle,
            "tracks": dict(vars(self.tracks)),
        }


class Perception:
    """Sensing of n worlds.

    Args:
        num_envs: number of worlds n.
        config: the whole configuration.
        encoder: `encode_state` of a student, called a world at a time; None for the library's.
        predictor: maps (n, 10, beams, 2) scans and (n, 10, 3) poses to a `Prediction` or its first three fields; None
            for the one that `config.predictor` names: constant velocity on tracks, or the shipped LSTM.
    """

    def __init__(
        self, num_envs: int, config: Config, encoder: Callable | None = None, predictor: Callable | None = None
    ):
        n, beams = num_envs, config.lidar.beams
        self.config, self._encoder, self._predictor = config, encoder, predictor
        self._lstm = shipped() if predictor is None and config.predictor == "lstm" else None
        self.lidar = Lidar(config.lidar, n)
        self.mapper = Mapper(config.map, config.lidar, n, config.control_dt_s)
        self.localiser = Localiser(config.map, beams, config.lidar.range_max_m, n)
        self._tracker = Tracker(n, config.control_dt_s, PREDICTOR_SCANS if self._lstm else 0)
        self.guide = Guide(config.guide, config.map, n)
        depth = PREDICTOR_SCANS if predictor or self._lstm else FLOW_SCANS
        self._scans = np.zeros((n, depth, beams, 2), np.float32)
        self._poses = np.zeros((n, depth, 3))
        self._is_first = np.ones(n, bool)
        self._keys = np.zeros(n, np.uint64)
        self._lux = np.zeros(n)
        self._goals = np.zeros((n, 2))

    def reset(self, world: int, scenario: Scenario, seed: int, sim: Simulation) -> None:
        """Forget one world and set up its light and link."""
        link = scenario.link
        worlds = np.array([world])
        self.localiser.reset(world, sim.robots.pose_odom[world])
        pose = self.localiser.poses[worlds]
        key = streams.stream_key(seed, "link")
        self.mapper.reset(worlds, pose, [link.delay_s], [link.loss], [link.burst_mean_s], np.array([key], np.uint64))
        self._tracker.reset(worlds)
        self.guide.reset(worlds)
        self._is_first[world] = True
        self._keys[world] = streams.stream_key(seed, "lidar")
        self._lux[world] = scenario.sensing.ambient_lux
        self.tell_goal(world, sim)

    def tell_goal(self, world: int, sim: Simulation) -> None:
        """Give the robot its present goal, in the frame it believes in; whoever issues it sees where the robot is."""
        self.localiser.follow(sim.robots.pose_odom)
        self._goals[world] = to_world(to_robot(sim.goals[world], sim.poses[world]), self.localiser.poses[world])

    def sense(self, sim: Simulation, active, idle) -> Percept:
        """What the robots know now.

        Args:
            sim: the truth.
            active: (n,) worlds that have moved on since the last call; the others are not updated.
            idle: (n,) worlds without an open goal, whose goal and guide read 0.
        """
        steps = sim.steps
        scans, labels = self.lidar.scan(sim.poses, sim.scene, self._lux, self._keys, steps)
        self.localiser.follow(sim.robots.pose_odom)
        self.localiser.match(self.mapper.received, self.mapper.received_corners, scans, steps, active)
        pose = self.localiser.poses.copy()
        self._remember(scans, pose, active)
        self.mapper.update(pose, scans, labels, steps, active)
        crops = self.mapper.crops(pose, scans, labels)
        tracks = self._tracker.update(pose, scans, active)
        due = active & self.guide.is_due(self._goals, steps)
        grids = self.mapper.plan_grids(pose, scans, labels, due)
        guide_robot, path_robot, _ = self.guide.update(grids, pose, self._goals, steps, due)
        goal_robot = to_robot(self._goals, pose)
        if idle.any():
            goal_robot[idle] = guide_robot[idle] = path_robot[idle] = 0.0
        return Percept(
            scans,
            pose,
            crops,
            self.mapper.age_s,
            tracks,
            self._predict(tracks),
            goal_robot,
            guide_robot,
            path_robot,
        )

    def _remember(self, scans, pose, active) -> None:
        first = active & self._is_first
        moved = active if not active.all() else slice(None)
        self._scans[moved, :-1] = self._scans[moved, 1:]
        self._poses[moved, :-1] = self._poses[moved, 1:]
        self._scans[moved, -1], self._poses[moved, -1] = scans[moved], pose[moved]
        if first.any():
            self._scans[first], self._poses[first] = scans[first][:, None], pose[first][:, None]
            self._is_first[first] = False

    def _predict(self, tracks: Tracks) -> Prediction:
        if self._lstm is not None:
            return self._lstm.correct(tracks, self._tracker.past(tracks), self._poses, self._scans[:, -1])
        if self._predictor is None:
            return constant_velocity(tracks)
        predicted = self._predictor(self._scans.copy(), self._poses.copy())
        return predicted if isinstance(predicted, Prediction) else Prediction(*predicted)

    def encode(self, percept: Percept, sim: Simulation, preference, worlds) -> np.ndarray:
        """Observations of some worlds.

        Args:
            percept: of all worlds.
            sim: the truth; read for twist and battery, which a robot measures itself, and for `motion: truth`.
            preference: (n,).
            worlds: index array of the worlds wanted, or `slice(None)`.

        Returns:
            (k, C, 64, 64) float32.
        """
        observation = self.config.observation
        forecast = None
        if observation.motion.method == "truth":
            forecast = true_prediction(sim)
        elif observation.motion.method == "forecast":
            forecast = percept.prediction
        battery = sim.robots.battery if observation.battery == "measured" else np.ones_like(preference)
        everybody = Ego(
            sim.robots.twist, battery, percept.goal_robot, percept.guide_robot, percept.map_age_s, preference, forecast
        )
        ego = everybody if isinstance(worlds, slice) else everybody.rows(worlds)
        scans, poses = self._scans[worlds, -FLOW_SCANS:], self._poses[worlds, -FLOW_SCANS:]
        if self._encoder is None:
            return encode_states(scans, poses, percept.map[worlds], ego, observation)
        given = zip(scans, poses, percept.map[worlds], map(ego.rows, range(len(scans))), strict=True)
        return np.stack([np.asarray(self._encoder(*deepcopy(one)), np.float32) for one in given])


def true_movers(sim: Simulation):
    """Positions (n, M, 2), velocities (n, M, 2) in the true robot frame, and which are there (n, M) and move."""
    movers = sim.movers
    positions = to_robot(movers.states[:, :, :2], sim.poses[:, None])
    turned = np.zeros_like(sim.poses)[:, None] + [0.0, 0.0, 1.0] * sim.poses[:, None]
    velocities = to_robot(movers.states[:, :, 3:5], turned)
    return positions, velocities, movers.active & (np.hypot(velocities[..., 0], velocities[..., 1]) > 0.05)


def true_prediction(sim: Simulation) -> Prediction:
    """Constant-velocity forecast from the simulator's own positions and velocities: an upper bound, not a sensor."""
    positions, velocities, valid = true_movers(sim)
    ways = positions[:, :, None] + velocities[:, :, None] * TIMES_S[:, None]
    return Prediction(ways, velocities, valid, sim.movers.radii.copy())
