"""highway-env's parking task and its road, slowed down, as questions that an environment asks: where is what."""

import os

import gymnasium
import numpy as np

from dualnav_lite.geometry import box_corners, to_robot, wrap_angle
from dualnav_lite.highway.car_ways import car_way
from dualnav_lite.highway.cars import LENGTH_M, WIDTH_M
from dualnav_lite.rewards import ENERGY_SCALE

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # pictures are drawn off screen, so no display is asked for
from highway_env.envs.common.observation import ObservationType
from highway_env.envs.highway_env import HighwayEnvFast
from highway_env.envs.parking_env import ParkingEnv
from highway_env.road.road import Road, RoadNetwork

HALF = (0.5 * LENGTH_M, 0.5 * WIDTH_M)
SEEN = 6  # other cars in an observation


class Plain(ObservationType):
    """Where the driven car and its goal are, as highway-env's own parking observation scales it, without pandas.

    highway-env builds a data frame four times a step; without it a step is ten times as fast.
    """

    def space(self):
        """Not used: the kit has an observation of its own."""
        return gymnasium.spaces.Box(-1.0, 1.0, (6,))

    def observe(self):
        """The three entries of a goal environment; the goal is the car itself where there is none."""
        car = self.env.vehicle
        if car is None:
            return np.zeros(6)
        goal = getattr(car, "goal", None) or car
        scales = np.array([100.0, 100.0, 5.0, 5.0, 1.0, 1.0])
        found = [
            np.array([*one.position, *velocity, np.cos(one.heading), np.sin(one.heading)]) / scales
            for one, velocity in ((car, car.velocity), (goal, np.zeros(2)))
        ]
        return {"observation": found[0], "achieved_goal": found[0], "desired_goal": found[1]}


class Parking(ParkingEnv):
    """highway-env's parking task; walls are judged by `ParkingTask`, which must know their distance anyway."""

    def define_spaces(self):
        """Spaces, and the plain observation for the task's own measure of success."""
        super().define_spaces()
        self.observation_type = self.observation_type_parking = Plain(self)

    def _create_vehicles(self):
        super()._create_vehicles()
        for vehicle in self.road.vehicles:
            vehicle.on_state_update = lambda: None  # it looks for the nearest of 28 lanes; nobody here follows one


class Traffic(HighwayEnvFast):
    """highway-env's road, slower: others drive 10.5 to 12 m/s, the driven car comes up from behind at 15 m/s."""

    def define_spaces(self):
        """Spaces, without the observation that nobody reads."""
        super().define_spaces()
        self.observation_type = Plain(self)

    def _create_road(self):
        network = RoadNetwork.straight_road_network(self.config["lanes_count"], speed_limit=TrafficTask.top_speed)
        self.road = Road(network=network, np_random=self.np_random, record_history=self.config["show_trajectories"])

    def _create_vehicles(self):
        super()._create_vehicles()
        self.vehicle.speed = TrafficTask.top_speed

    def _rewards(self, action):
        return {}

    def _reward(self, action):
        return 0.0


class ParkingTask:
    """Reach a spot and its heading, by highway-env's own measure of success, and touch no wall and no parked car."""

    limits = np.array([2.0, np.pi / 4])  # acceleration [m/s2], steering [rad]
    speeds = (-3.0, 3.0)
    usual_speed, way_scale, safe_m, energy_scale = 2.0, 2.0, 0.5, ENERGY_SCALE
    half_room = np.array([34.5, 20.5])  # inner faces of the walls [m]
    size = 14

    def __init__(self, others: int, render_mode: str | None):
        action = {"type": "ContinuousAction", "acceleration_range": (-2.0, 2.0), "speed_range": self.speeds}
        settings = {"add_walls": False, "vehicles_count": others, "action": action, "duration": np.inf}
        self.env = Parking(settings, render_mode)

    def begin(self) -> None:
        """After a reset: forget the last episode."""

    def others(self) -> list:
        """The other cars."""
        return self.env.road.vehicles[1:]

    def goal_seen(self):
        """Goal in the car's frame (2,) [m] and heading error [rad]."""
        car, goal = self.env.vehicle, self.env.vehicle.goal
        here = np.array([*car.position, car.heading])
        return to_robot(goal.position, here), float(wrap_angle(goal.heading - car.heading))

    def way(self) -> float:
        """Metres to drive to the spot and its heading, on an empty place."""
        car, goal = self.env.vehicle, self.env.vehicle.goal
        there = np.array([*goal.position, goal.heading])
        return car_way(to_robot(car.position, there), car.heading - goal.heading)

    def wall_gap(self) -> float:
        """Least distance of a corner from the walls [m], 0 where one is touched."""
        car = self.env.vehicle
        corners = np.abs(box_corners([*car.position, car.heading, *HALF]))
        return max(float((self.half_room - corners).min()), 0.0)

    def has_arrived(self) -> bool:
        """highway-env's own criterion."""
        seen = self.env.observation_type.observe()
        return bool(self.env._is_success(seen["achieved_goal"], seen["desired_goal"]))

    def observe(self) -> np.ndarray:
        """(13,) speed, goal and heading error from the car, near and far, and where the walls are."""
        car, (place, error) = self.env.vehicle, self.goal_seen()
        near, far = np.tanh(place / 3.0), place / 20.0
        walls = car.position / self.half_room
        return np.array(
            [car.speed / 3.0, *near, *far, np.cos(error), np.sin(error), *walls, np.cos(car.heading),
             np.sin(car.heading), self.wall_gap() / 10.0, np.hypot(*place) / 20.0]
        )  # fmt: skip


class TrafficTask:
    """Drive 300 m through slower cars; leaving the road counts as a contact with a wall."""

    limits = np.array([4.0, 0.05])
    speeds = (0.0, 25.0)
    top_speed = usual_speed = 15.0  # [m/s]
    # Thrift counts more here than the robot's 0.04, and so does the way. Chosen while joules were charged when drawn
    # (60,000 steps): at 0.04 every preference drove alike, at 0.2 and 50 m the car learned to stand.
    way_scale, safe_m, energy_scale = 20.0, 1.0, 0.15
    lanes, lane_m, journey_m = 3, 4.0, 300.0
    size = 7 + 4 * SEEN + 1

    def __init__(self, others: int, render_mode: str | None):
        settings = {
            "lanes_count": self.lanes, "vehicles_count": others, "vehicles_density": 0.75, "duration": np.inf,
            "policy_frequency": 5, "simulation_frequency": 5, "action": {
                "type": "ContinuousAction", "acceleration_range": (-self.limits[0], self.limits[0]),
                "steering_range": (-self.limits[1], self.limits[1]), "speed_range": self.speeds,
            },
        }  # fmt: skip
        self.env = Traffic(settings, render_mode)
        self._start_m = 0.0

    def begin(self) -> None:
        """After a reset: note where the journey starts."""
        self._start_m = float(self.env.vehicle.position[0])

    def others(self) -> list:
        """The other cars."""
        return [one for one in self.env.road.vehicles if one is not self.env.vehicle]

    def way(self) -> float:
        """Metres left along the road."""
        return max(self.journey_m - float(self.env.vehicle.position[0]) + self._start_m, 0.0)

    def wall_gap(self) -> float:
        """0 once the car's middle has left the road, else inf: an edge is no obstacle to keep away from."""
        y = float(self.env.vehicle.position[1])
        return 0.0 if not -0.5 * self.lane_m < y < (self.lanes - 0.5) * self.lane_m else np.inf

    def has_arrived(self) -> bool:
        """The journey is done."""
        return self.way() <= 0.0

    def observe(self) -> np.ndarray:
        """(31,) speed, place on the road, heading, what is left; of the nearest cars place, closing speed, presence."""
        car = self.env.vehicle
        x, y = car.position
        lane_offset = (y + 0.5 * self.lane_m) % self.lane_m - 0.5 * self.lane_m
        own = [car.speed / 10.0 - 1.5, lane_offset / 2.0, 5.0 * car.heading, y / self.lane_m - 1.0]
        own += [self.way() / self.journey_m, np.cos(10.0 * car.heading), 1.0 if abs(y - 4.0) < 4.0 else 0.0]
        seen = np.zeros((SEEN, 4))
        near = sorted(self.others(), key=lambda one: abs(one.position[0] - x))[:SEEN]
        for row, one in zip(seen, near, strict=False):
            ahead = one.position[0] - x
            row[:] = [
                np.tanh(ahead / 30.0),
                (one.position[1] - y) / 4.0,
                (one.velocity[0] - car.velocity[0]) / 5.0,
                1.0,
            ]
            row[:3] *= abs(ahead) < 80.0
        return np.array([*own, *seen.ravel()])


TASKS = {"parking": ParkingTask, "traffic": TrafficTask}
