"""Several robots of one kind in one room, each with its own lidar, map and goal (article 4.5).

The article's fix for robots that hit each other's *predicted* path is a reward: r_dynamic += 0.3 r_cross, where r_cross
is minus the mean distance between where the others were predicted and where they went. It is here under the article's
names, `predict_other_traj` and `get_actual_traj`; `fleet_drive` measures what it can do for a policy that is trained.
"""

from dataclasses import dataclass

import numpy as np

from dualnav_lite import streams
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.geometry import to_world
from dualnav_lite.kernels.clearance import hull_clearance
from dualnav_lite.kernels.scene import read_field
from dualnav_lite.motion import STEPS
from dualnav_lite.perception import Percept
from dualnav_lite.robot import Robots
from dualnav_lite.rooms import FIELD_RESOLUTION_M, PATH_MARGIN_M, StaticRoom, draw, draw_room, furnish
from dualnav_lite.scenario import Scenario, load_scenario
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import Surface

MATCH_M = 0.5  # a track this near to a robot's own word of where it is, is that robot
JITTER_RAD, WALL_M, APART_M, LANE_HALF_M, TRIES = 0.35, 0.9, 1.2, 0.6, 200


@dataclass(frozen=True)
class FleetLayout:
    """A room, and for each robot a start (K, 3), a goal (K, 2) and the way to it (K, H, W) as a field [m]."""

    seed: int
    room: StaticRoom
    starts: np.ndarray
    goals: np.ndarray
    fields: np.ndarray
    time_limit_s: float


def draw_layout(scenario: Scenario, config: Config, seed: int) -> FleetLayout:
    """Robots around the middle of a furnished hall, each with a goal opposite; from the seed alone.

    Raises:
        UnusableInput: a scenario without a fleet, or no layout fits.
    """
    rng, hull = streams.stream(seed, "fleet"), config.robot.hull_radius_m
    count = load_scenario(scenario, "fleet").fleet.robots
    for _ in range(TRIES):
        room = draw_room(rng, scenario.room, False)
        middle = np.array([room.width, room.height]) / 2.0
        angles = 2.0 * np.pi * (np.arange(count) / count + rng.random()) + rng.uniform(-JITTER_RAD, JITTER_RAD, count)
        out = np.stack([np.cos(angles), np.sin(angles)], axis=1) * (middle.min() - WALL_M)
        starts, goals = middle + out, middle - out
        ends = np.concatenate([starts, goals])
        apart = np.hypot(*(ends[:, None] - ends[None]).transpose(2, 0, 1)) + 10.0 * np.eye(2 * count)
        if apart.min() < APART_M:
            continue  # somebody's start would be another's goal
        lanes = [(*start, *goal, LANE_HALF_M) for start, goal in zip(starts, goals, strict=True)]
        room = furnish(rng, room, scenario.room, lanes)
        areas = room.areas(hull + PATH_MARGIN_M)
        if len({areas[room.cell(end)] for end in ends}) == 1 and areas[room.cell(starts[0])]:
            break
    else:
        raise UnusableInput(f"scenario '{scenario.id}', seed {seed}: no layout fits after {TRIES} draws")
    fields = np.stack([room.progress_field(goal, hull) for goal in goals])
    poses = np.column_stack([starts, angles + np.pi + rng.uniform(-0.5, 0.5, count)])
    longest = max(float(field[room.cell(start)]) for field, start in zip(fields, starts, strict=True))
    limit = scenario.time_limit_paths * longest / config.hardware.max_lin_vel + scenario.time_limit_extra_s
    return FleetLayout(seed, room, poses, goals, fields, limit)


class FleetWorlds:
    """The truth of several fleets, a row a robot: rows f K to f K + K - 1 are fleet f. `Perception` reads it.

    A robot that has touched something or has arrived stands, and the others must get past it.

    Args:
        layouts: one a fleet, with equally many robots each.
        scenario: their scenario.
        config: of every robot.

    Attributes:
        poses, goals, clearance, path_length, outcomes: a row a robot; outcome "" while it is under way.
        past: (steps + 1, rows, 2) where everybody was.
    """

    def __init__(self, layouts: list[FleetLayout], scenario: Scenario, config: Config):
        self.layouts, self.scenario, self.config = layouts, scenario, config
        self.robots_each = len(layouts[0].starts)
        n = len(layouts) * self.robots_each
        self.robots, self.scene = Robots(n, config), Scene.empty(n)
        self.poses = np.concatenate([one.starts for one in layouts])
        self.goals = np.concatenate([one.goals for one in layouts])
        self.steps, self.outcomes = np.zeros(n, np.int64), np.full(n, "", dtype=object)
        self.clearance, self.path_length = np.zeros(n), np.zeros(n)
        cells = max(max(one.fields.shape[1:]) for one in layouts)
        self._fields = np.full((n, cells, cells), np.inf, np.float32)
        for row in range(n):
            layout, k = layouts[row // self.robots_each], row % self.robots_each
            charge = draw(streams.stream(layout.seed, f"charge {k}"), scenario.start_charge)
            self.robots.reset(row, layout.seed * 4 + k, self.poses[row], charge)
            self.scene.add_room(row, layout.room.width, layout.room.height)
            self.scene.add_boxes(row, layout.room.boxes, layout.room.surfaces)
            self.scene.add_circles(row, np.zeros((self.robots_each - 1, 3)), Surface.ROBOT)
            rows, columns = layout.fields[k].shape
            self._fields[row, :rows, :columns] = layout.fields[k]
        self._limits = np.repeat([one.time_limit_s for one in layouts], self.robots_each)
        self.past = self.poses[None, :, :2].copy()
        self._look()

    def fleet_of(self, row: int) -> np.ndarray:
        """Rows of the other robots of a robot's fleet."""
        first = row - row % self.robots_each
        return np.setdiff1d(np.arange(first, first + self.robots_each), [row])

    def nearby_robots(self, row: int) -> np.ndarray:
        """Rows of the robots within radio range of one (article 4.5)."""
        others = self.fleet_of(row)
        return others[np.hypot(*(self.poses[others, :2] - self.poses[row, :2]).T) <= self.scenario.fleet.radio_m]

    def get_actual_traj(self, row: int, steps: int = STEPS) -> np.ndarray:
        """(steps, 2) where a robot was in the last steps, by its own word over the radio (article 4.5)."""
        return self.past[-steps:, row]

    def _look(self) -> None:
        """Bring circles, clearance and ways up to date."""
        scene, hull = self.scene, self.config.robot.hull_radius_m
        for row in range(len(self.poses)):
            scene.circles[row, : self.robots_each - 1, :2] = self.poses[self.fleet_of(row), :2]
            scene.circles[row, : self.robots_each - 1, 2] = hull
        tables = (scene.segments, scene.num_segments, scene.circles, scene.circle_surface, scene.num_circles)
        hull_clearance(self.poses, hull, *tables, np.uint8(Surface.PHANTOM), self.clearance)
        length = np.empty(len(self.poses))
        read_field(self._fields, self.poses, FIELD_RESOLUTION_M, length)
        beeline = np.hypot(*(self.goals - self.poses[:, :2]).T)
        self.path_length = np.where(np.isfinite(length), length, beeline)

    def advance(self, commands) -> None:
        """One control step; commands (rows, 2) of robots that are done are taken as zero."""
        under_way = self.outcomes == ""
        high = self.config.hardware.limits
        commands = np.where(under_way[:, None], np.clip(commands, -high, high), 0.0)
        self.robots.drive(self.poses[:, 2], commands)
        before = self.poses.copy()
        # Whoever has touched something or arrived is held where it is.
        self.poses = before + np.where(under_way[:, None], self.robots.displacement, 0.0)
        self.robots.odometry(before, self.poses)
        self.steps += 1
        self.past = np.concatenate([self.past, self.poses[None, :, :2]])
        self._look()
        touched = self.clearance <= 0.0
        arrived = np.hypot(*(self.goals - self.poses[:, :2]).T) <= self.scenario.goal_radius_m
        late = self.steps * self.config.control_dt_s >= self._limits - 1e-9
        for row in np.flatnonzero(under_way):
            if touched[row]:
                gap = np.hypot(*(self.poses[self.fleet_of(row), :2] - self.poses[row, :2]).T).min()
                is_robot = gap <= 2.0 * self.config.robot.hull_radius_m
                self.outcomes[row] = "hit_robot" if is_robot else "hit_furniture"
            elif arrived[row]:
                self.outcomes[row] = "goal"
            elif late[row]:
                self.outcomes[row] = "timeout"
            if self.outcomes[row]:
                self.robots.stop(row)


def predict_other_traj(worlds: FleetWorlds, percept: Percept, row: int, other: int) -> np.ndarray | None:
    """(STEPS, 2) where a robot will be in the next 2 s, as another one's own lidar tells it, world frame (article 4.5).

    None where the lidar follows nothing within half a metre of the other's own word.
    """
    prediction = percept.prediction
    valid = np.flatnonzero(prediction.valid[row])
    if not len(valid):
        return None
    places = to_world(percept.tracks.positions[row, valid], worlds.poses[row])
    gaps = np.hypot(*(places - worlds.poses[other, :2]).T)
    if gaps.min() > MATCH_M:
        return None
    return to_world(prediction.positions[row, valid[gaps.argmin()]], worlds.poses[row])


def cross_term(predicted, actual) -> float:
    """r_cross of one neighbour: minus the mean distance [m] between the predicted and the driven way (article 4.5)."""
    return -float(np.linalg.norm(np.asarray(predicted) - np.asarray(actual), axis=1).mean())


class CrossTerm:
    """r_cross of every robot at each step: what it said of its neighbours 2 s ago against what they did since."""

    def __init__(self):
        self._said: list[dict[tuple[int, int], np.ndarray]] = []

    def __call__(self, worlds: FleetWorlds, percept: Percept) -> np.ndarray:
        """(rows,) mean over the neighbours that were told of, 0 without any; call it once a step, before `advance`."""
        found = np.zeros(len(worlds.poses))
        if len(self._said) >= STEPS:
            told = self._said[-STEPS]
            for row in range(len(found)):
                terms = [cross_term(way, worlds.get_actual_traj(j)) for (i, j), way in told.items() if i == row]
                found[row] = np.mean(terms) if terms else 0.0
        said = {}
        for row in range(len(found)):
            for other in worlds.nearby_robots(row):
                way = predict_other_traj(worlds, percept, row, other)
                if way is not None and not worlds.outcomes[other]:
                    said[row, int(other)] = way
        self._said = [*self._said[1 - STEPS :], said]
        return found
