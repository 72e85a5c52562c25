"""Planners that roll out a grid of commands: the privileged ceiling and its twin that sees what the robot sees."""

from abc import abstractmethod

import numpy as np

from dualnav_lite import routing
from dualnav_lite.config import Config, Hardware, UnusableInput
from dualnav_lite.kernels import sampling as kernels
from dualnav_lite.planners.base import Planner
from dualnav_lite.planners.pursuit import scan_points
from dualnav_lite.planners.surroundings import CELLS, ORIGIN_M, RESOLUTION_M, clearance_around, occupied_cells

SPEEDS = np.array([-1.0, -0.5, 0.0, 0.25, 0.375, 0.5, 0.65, 0.8, 1.0])  # shares of the top speed
TURNS = np.linspace(-1.0, 1.0, 11)  # shares of the fastest turn
HEADINGS = np.linspace(-np.pi, np.pi, 8, endpoint=False)  # that may follow a command, fixed in the world
STANDING_M_S = 0.05
WAIT_M, WAIT_COST = 5.0, 1.0  # what moves nearer than that may be waited for; what standing may save [m of way]
SOLID_VALUE = 0.3  # of a map crop: door jambs and all that is solid, not the unknown
# Factor on a step's length by the gap [m] the hull would have there: to fixed things, to boxes that stand, and to
# people who stand, who may walk on at any moment; a waiting group is worth a detour of metres.
_GAP_FACTORS = ((0.30, 1.2), (0.20, 1.6), (0.10, 3.0), (0.05, 6.0), (0.0, 20.0))
_BOX_FACTORS = ((0.40, 1.2), (0.30, 1.6), (0.20, 3.0), (0.10, 10.0), (0.0, 30.0))
_PERSON_FACTORS = (
    (3.0, 1.3), (2.5, 1.6), (2.0, 2.0), (1.5, 2.5), (1.0, 3.5), (0.5, 5.0), (0.2, 8.0), (0.1, 12.0), (0.0, 30.0),
)  # fmt: skip
_CLOSED_M = 0.075  # cells nearer to something fixed are closed


def command_grid(limits: Hardware, max_speed: float | None = None):
    """(9, 11, 2) commands v [m/s], omega [rad/s]: what `costs` scores and an imitator chooses from.

    Raises:
        UnusableInput: `max_speed` is 0.
    """
    if max_speed == 0.0:
        raise UnusableInput("a planner that samples commands needs a max_speed above 0")
    top = limits.max_lin_vel if max_speed is None else min(max_speed, limits.max_lin_vel)
    return np.stack(np.meshgrid(SPEEDS * top, TURNS * limits.max_ang_vel, indexing="ij"), axis=-1)


def _raise_factors(cost, distance, hull_radius, table, margins):
    """Raise the cost of each cell to the table's factor at its distance from something."""
    for gap, factor in table:
        close = distance < hull_radius + margins * gap
        cost[close] = np.maximum(cost[close], factor)


def way_fields(clearance, goal_cell, resolution, hull_radius, people=None, boxes=None, margins=1.0):
    """Way left to the goal, dear where the hull would be close to something.

    Args:
        clearance: (H, W) distance to the nearest fixed solid [m].
        goal_cell: (iy, ix).
        resolution: cell size [m].
        hull_radius: [m].
        people, boxes: (H, W) distance to the nearest that stands [m], or None. Dear, never closed: they may move on.
        margins: factor on the gaps from which on closeness is dear.

    Returns:
        (4, H, W) f64 layers of `kernels.sampling`: the clearance, the way [m] (inf in solid cells and where there is
        none), the factor on the length of a step, and -1.
    """
    cost = np.ones(clearance.shape)
    _raise_factors(cost, clearance, hull_radius, _GAP_FACTORS, margins)
    if people is not None:
        _raise_factors(cost, people, hull_radius, _PERSON_FACTORS, margins)
    if boxes is not None:
        _raise_factors(cost, boxes, hull_radius, _BOX_FACTORS, margins)
    cost[clearance < _CLOSED_M] = np.inf
    way = routing.distance_field(cost, goal_cell, resolution)
    return np.stack([clearance, way, cost, np.full(cost.shape, -1.0)])


class SamplingPlanner(Planner):
    """Scores every command of a grid by rollouts and takes the cheapest; subclasses say what is known.

    Args:
        settings: the configuration.
        max_speed: [m/s]; the hardware's limit if None.
        calm: cost of turning [m of way for each rad/s]: saves energy in a long run and costs agility.

    Attributes:
        grid: (9, 11, 2) commands v [m/s], omega [rad/s].
    """

    def __init__(self, settings: Config, max_speed: float | None = None, calm: float = 0.0):
        super().__init__(settings)
        robot = settings.robot
        self.grid = command_grid(settings.hardware, max_speed)
        self._commands = np.ascontiguousarray(self.grid.reshape(-1, 2))
        self._turning = calm * np.abs(self._commands[:, 1])
        p = np.empty(23)
        p[kernels.HULL] = robot.hull_radius_m
        p[kernels.MAX_V], p[kernels.MAX_OMEGA] = self._commands[:, 0].max(), self.max_omega
        p[kernels.MAX_ACC], p[kernels.MAX_ANG_ACC] = robot.max_lin_acc_m_s2, robot.max_ang_acc_rad_s2
        p[kernels.FIRST_S], p[kernels.SECOND_S], p[kernels.DT] = 0.6, 4.4, 0.1
        p[kernels.STATIC_MARGIN], p[kernels.STATIC_SOFT] = 0.06, 0.15
        p[kernels.MOVING_MARGIN], p[kernels.MOVING_SOFT] = 0.15, 0.70
        p[kernels.GOAL_RADIUS] = 0.3  # inside the scenarios' 0.4 m
        p[kernels.COLLISION], p[kernels.MARGIN_RATE], p[kernels.SOFT_RATE] = 30.0, 15.0, 1.5
        p[kernels.STATIC_RATE] = 0.5
        p[kernels.TURN_COST], p[kernels.SPEED_COST], p[kernels.REVERSE_COST] = 0.03, 0.03, 0.5
        p[kernels.LANE_M], p[kernels.LANE_COST] = 4.0, 3.0
        p[kernels.CAP] = 3.0
        self._parameters = p

    def command(self, i, info):
        """The cheapest command of the grid."""
        return self._commands[self.costs(i, info).argmin()]

    @abstractmethod
    def costs(self, i: int, info: dict) -> np.ndarray:
        """(commands,) cost [m of way] of each command of `grid`, in its order, for world i."""

    def _roll(self, pose, twist, headings, goal, fields, grid, circles, boxes) -> np.ndarray:
        costs = np.empty(len(self._commands))
        kernels.score_commands(
            np.asarray(pose, float),
            np.asarray(twist, float),
            self._commands,
            headings,
            np.asarray(goal, float),
            fields,
            grid,
            circles,
            boxes,
            self._parameters,
            costs,
        )
        return costs + self._turning


class Ceiling(SamplingPlanner):
    """Sees the truth: its pose, the fixed solids, and positions and velocities of everything that moves.

    It does not know what anything will do next: movers keep their velocity in its rollouts. Movers that stand are part
    of its way to the goal. The bound that the other arms are held against, and the teacher for imitation.
    """

    needs_truth = True

    def __init__(self, settings: Config, max_speed: float | None = None, calm: float = 0.0):
        super().__init__(settings, max_speed, calm)
        self._kept: dict[int, tuple] = {}
        self.margins = 1.0

    def reset(self, indices):
        """Forget the fields of the worlds listed."""
        for i in indices:
            self._kept.pop(int(i), None)

    def command(self, i, info):
        """The cheapest command of the grid; who stands stays only where something moves that may be waited for.

        A first command and one way to go on look a few metres far: before a corner, starting later often reaches as
        much as starting now, and a robot that saves its turns (`calm`) would stand there for ever.
        """
        costs = self.costs(i, info)
        best = costs.argmin()
        stays = not self._commands[best].any() and np.abs(info["truth"]["twist"]).max() < STANDING_M_S
        if stays and not self._is_anything_coming(info["truth"]):
            going = np.where(self._commands[:, 0] > 0.0, costs, np.inf)
            if going.min() < costs[best] + WAIT_COST:
                best = going.argmin()
        return self._commands[best]

    @staticmethod
    def _is_anything_coming(truth) -> bool:
        """Whether something moves within `WAIT_M`."""
        for places, velocities, count in (
            ("circles", "circle_velocities", "num_circles"),
            ("boxes", "box_velocities", "num_boxes"),
        ):
            k = int(truth[count])
            near = np.hypot(*(truth[places][:k, :2] - truth["pose"][:2]).T) < WAIT_M
            if (near & (np.hypot(*truth[velocities][:k].T) > STANDING_M_S)).any():
                return True
        return False

    def costs(self, i, info):
        """By rollouts among what is really there."""
        truth = info["truth"]
        resolution = self.settings.map.resolution_m
        people, boxed = int(truth["num_circles"]), int(truth["num_boxes"])
        circles = np.concatenate([truth["circles"][:people], truth["circle_velocities"][:people]], axis=1)
        b = truth["boxes"][:boxed]
        turned = np.cos(b[:, 2:3]), np.sin(b[:, 2:3])
        boxes = np.concatenate([b[:, :2], *turned, b[:, 3:5], truth["box_velocities"][:boxed]], axis=1)
        fields = self._fields(i, truth, circles, boxes, resolution)
        grid = (0.0, 0.0, resolution)
        return self._roll(truth["pose"], truth["twist"], HEADINGS, truth["goal"], fields, grid, circles, boxes)

    def _fields(self, i, truth, circles, boxes, resolution):
        """The fields of a world, computed anew when the goal or what stands has changed."""
        circles = circles[np.hypot(circles[:, 3], circles[:, 4]) < STANDING_M_S]
        boxes = boxes[np.hypot(boxes[:, 6], boxes[:, 7]) < STANDING_M_S]
        key = (self.margins, *truth["goal"].tolist(), *circles[:, :2].round(1).ravel(), *boxes[:, :4].round(1).ravel())
        kept = self._kept.get(i)
        if kept is not None and kept[0] == key:
            return kept[1]
        static = truth["static_field"]
        y, x = (np.mgrid[: static.shape[0], : static.shape[1]] + 0.5) * resolution
        to_people, to_boxes = np.full(static.shape, np.inf), np.full(static.shape, np.inf)
        for cx, cy, radius in circles[:, :3]:
            to_people = np.minimum(to_people, np.hypot(x - cx, y - cy) - radius)
        for bx, by, c, s, half_length, half_width in boxes[:, :6]:
            u = np.maximum(np.abs(c * (x - bx) + s * (y - by)) - half_length, 0.0)
            v = np.maximum(np.abs(c * (y - by) - s * (x - bx)) - half_width, 0.0)
            to_boxes = np.minimum(to_boxes, np.hypot(u, v))
        cell = np.clip((np.asarray(truth["goal"])[::-1] / resolution).astype(int), 0, np.array(static.shape) - 1)
        hull = self.settings.robot.hull_radius_m
        fields = way_fields(static, cell, resolution, hull, to_people, to_boxes, self.margins)
        self._kept[i] = key, fields
        return fields


class CvSampling(SamplingPlanner):
    """The same rollouts without privilege: scan and map crop for what is fixed, tracks for what moves, guide's path.

    Tracked movers keep their velocity; whatever the tracker does not hold as moving counts as fixed.
    """

    TRACK_GAP_M = 0.15  # hits this close to a tracked mover are its own

    def __init__(self, settings: Config, max_speed: float | None = None, calm: float = 0.0):
        super().__init__(settings, max_speed, calm)
        # Its fields end 3.2 m away and its path 3.1 m: it looks no farther.
        self._parameters[kernels.SECOND_S] = 2.4

    def costs(self, i, info):
        """By rollouts among what the robot sees."""
        tracks = info["tracks"]
        valid = tracks["valid"]
        places, radii, velocities = tracks["positions"][valid], tracks["radii"][valid], tracks["velocities"][valid]
        circles = np.concatenate([places, radii[:, None], velocities], axis=1).astype(float)
        points = scan_points(info["scan"], self.settings.lidar.range_max_m)
        for place, radius in zip(places, radii, strict=True):
            points = points[np.hypot(*(points - place).T) > radius + self.TRACK_GAP_M]
        clearance = clearance_around(points, occupied_cells(info["map"], SOLID_VALUE))
        goal = info["path_robot"][-1]
        cell = np.clip(((goal[::-1] - ORIGIN_M) / RESOLUTION_M).astype(int), 0, CELLS - 1)
        fields = way_fields(clearance, cell, RESOLUTION_M, self.settings.robot.hull_radius_m)
        grid = (ORIGIN_M, ORIGIN_M, RESOLUTION_M)
        boxes = np.zeros((0, 8))
        headings = HEADINGS - info["pose"][2]
        return self._roll(np.zeros(3), info["twist"], headings, goal, fields, grid, circles, boxes)
