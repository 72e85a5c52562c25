"""The truth of n worlds, stepped together: bodies, movers, events, goals. Nothing here is sensed."""

import numpy as np

from dualnav_lite import streams
from dualnav_lite.config import Config
from dualnav_lite.geometry import to_robot, to_world
from dualnav_lite.kernels.clearance import hull_clearance
from dualnav_lite.kernels.scene import place_movers, read_field, renew_phantoms
from dualnav_lite.layout import Layout, generate
from dualnav_lite.pedestrians import SURFACE_OF_KIND, Movers
from dualnav_lite.robot import Robots
from dualnav_lite.rooms import FIELD_RESOLUTION_M
from dualnav_lite.scenario import Scenario
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import Surface
from dualnav_lite.world import World

MAX_PHANTOMS = 8
MAX_ROOM_M = 12.0  # of a side
RESTART_CLEARANCE_M = 0.6  # a robot re-placed after a contact has this much room around its middle


class Simulation:
    """State of n worlds after the last control step.

    Attributes:
        poses: (n, 3) true robot poses.
        scene: what beams and hulls can meet.
        clearance: (n,) gap from the hull to the nearest solid [m].
        contacts: (n,) `Surface` touched during the last step.
        odometer_m, times_s, steps: (n,) since the reset.
        goals: (n, 2) present goal; path_length: (n,) way to it along free space [m].
        static_fields, goal_fields: (n, H, W) distance to the nearest static solid, and way to the goal [m].
        layouts, scenarios: of each world's present episode.
    """

    def __init__(self, num_envs: int, config: Config):
        n = num_envs
        cells = int(np.ceil(MAX_ROOM_M / FIELD_RESOLUTION_M - 1e-9))
        self.config = config
        self.robots = Robots(n, config)
        self.movers = Movers(n)
        self.scene = Scene.empty(n)
        self.worlds: list[World | None] = [None] * n
        self.layouts: list[Layout | None] = [None] * n
        self.scenarios: list[Scenario | None] = [None] * n
        self.poses = np.zeros((n, 3))
        self.clearance = np.zeros(n)
        self.contacts = np.zeros(n, np.uint8)
        self.odometer_m = np.zeros(n)
        self.times_s = np.zeros(n)
        self.steps = np.zeros(n, np.int64)
        self.goals = np.zeros((n, 2))
        self.path_length = np.zeros(n)
        self.num_static = np.zeros(n, np.int64)
        self.static_fields = np.zeros((n, cells, cells), np.float32)
        self.goal_fields = np.full((n, cells, cells), np.inf, np.float32)
        self.phantoms = np.zeros((n, MAX_PHANTOMS, 5))
        self.num_phantoms = np.zeros(n, np.int64)
        self.phantom_keys = np.zeros(n, np.uint64)
        self.phantom_bounds = np.zeros((3, n, 2))  # life [s], ahead [m], radius [m]

    def reset(self, world: int, scenario: Scenario, seed: int) -> Layout:
        """Start a new episode in one world."""
        layout = generate(scenario, self.config, seed)
        robot = self.config.robot
        self.worlds[world] = World(layout, robot.hull_radius_m, robot.mass_kg)
        self.layouts[world], self.scenarios[world] = layout, scenario
        self.robots.reset(world, seed, layout.start, layout.charge)
        self.movers.reset(world, layout)
        self.poses[world] = layout.start
        self.contacts[world] = Surface.NOTHING
        self.odometer_m[world] = self.times_s[world] = self.steps[world] = 0
        scene = self.scene
        scene.num_segments[world] = scene.num_circles[world] = 0
        scene.add_room(world, layout.room.width, layout.room.height)
        scene.add_boxes(world, layout.room.boxes, layout.room.surfaces)
        self.num_static[world] = scene.num_segments[world]
        self.static_fields[world] = 0.0
        rows, columns = layout.room.clearance.shape
        self.static_fields[world, :rows, :columns] = layout.room.clearance
        self._reset_phantoms(world, scenario, seed)
        self.set_goal(world, layout.goals[0], layout.goal_field)
        self._look(np.arange(len(self.worlds)) == world)
        return layout

    def _reset_phantoms(self, world: int, scenario: Scenario, seed: int) -> None:
        sensing = scenario.sensing
        self.num_phantoms[world] = min(sensing.phantoms, MAX_PHANTOMS)
        self.phantom_keys[world] = streams.stream_key(seed, "phantoms")
        self.phantoms[world] = 0.0
        for row, bounds in enumerate((sensing.phantom_life_s, sensing.phantom_ahead_m, sensing.phantom_radius_m)):
            self.phantom_bounds[row, world] = bounds.low, bounds.high

    def set_goal(self, world: int, goal, goal_field=None) -> None:
        """Give one world a goal (2,) [m]; its field is computed unless the layout holds it."""
        room = self.layouts[world].room
        if goal_field is None:
            goal_field = room.progress_field(goal, self.config.robot.hull_radius_m)
        self.goals[world] = goal
        self.goal_fields[world] = np.inf
        rows, columns = goal_field.shape
        self.goal_fields[world, :rows, :columns] = goal_field

    def measure_paths(self) -> np.ndarray:
        """(n,) way from each robot to its goal along free space [m], now."""
        length = np.empty(len(self.poses))
        read_field(self.goal_fields, self.poses, FIELD_RESOLUTION_M, length)
        beeline = np.hypot(*(self.goals - self.poses[:, :2]).T)
        return np.where(np.isfinite(length), length, beeline)

    def advance(self, commands, active) -> None:
        """One control step of the active worlds.

        Args:
            commands: (n, 2) v [m/s], omega [rad/s] inside the hardware limits.
            active: (n,) bool; the others stay as they are.
        """
        c, movers, idle = self.config, self.movers, ~active
        held = ("battery", "wheels", "twist") if idle.any() else ()
        kept = {name: getattr(self.robots, name)[idle] for name in held}
        self._fire_pop_ups(active)
        movers.move(
            self.poses,
            self.robots.twist[:, 0],
            c.robot.hull_radius_m,
            self.scene.segments,
            self.num_static,
            c.control_dt_s,
            self.times_s,
        )
        self.robots.drive(self.poses[:, 2], commands)
        before = self.poses.copy()
        for i in np.flatnonzero(active).tolist():
            world = self.worlds[i]
            world.clear_contact()
            world.advance(self.robots.displacement[i], movers.velocities[i], c.physics_dt_s, c.substeps)
            world.read(self.poses[i], movers.states[i])
            self.contacts[i] = world.contact
        for name, values in kept.items():
            getattr(self.robots, name)[idle] = values
        self.robots.odometry(before, self.poses)
        self.odometer_m += np.hypot(*(self.poses[:, :2] - before[:, :2]).T)
        self.steps[active] += 1
        self.times_s = self.steps * c.control_dt_s
        self._look(active)

    def _fire_pop_ups(self, active) -> None:
        for i in self.movers.due(self.odometer_m):
            if active[i]:
                room = self.layouts[i].room
                row = self.movers.fire(
                    i, self.odometer_m[i], self.poses[i], room, self.goals[i], self.goal_fields[i], self.times_s[i]
                )
                if row is not None:
                    self.worlds[i].show(row, self.movers.states[i, row, :3])

    def _look(self, active) -> None:
        """Bring scene, clearance and path length up to date."""
        scene, movers = self.scene, self.movers
        if self.num_phantoms.any():
            renew_phantoms(
                self.phantoms,
                self.num_phantoms,
                self.poses,
                self.times_s,
                self.phantom_keys,
                *self.phantom_bounds,
                active,
            )
        place_movers(
            movers.kinds,
            SURFACE_OF_KIND,
            movers.active,
            movers.states,
            movers.radii,
            movers.halves,
            self.num_static,
            self.phantoms,
            self.num_phantoms,
            np.uint8(Surface.PHANTOM),
            scene.segments,
            scene.segment_surface,
            scene.num_segments,
            scene.circles,
            scene.circle_surface,
            scene.num_circles,
        )
        hull_clearance(
            self.poses,
            self.config.robot.hull_radius_m,
            scene.segments,
            scene.num_segments,
            scene.circles,
            scene.circle_surface,
            scene.num_circles,
            np.uint8(Surface.PHANTOM),
            self.clearance,
        )
        self.path_length = self.measure_paths()

    def replace_robot(self, world: int) -> None:
        """Put one robot at rest on the nearest spot with room around it, as a person would after a contact."""
        room = self.layouts[world].room
        rows, columns = room.clearance.shape
        y, x = np.mgrid[:rows, :columns] * FIELD_RESOLUTION_M + 0.5 * FIELD_RESOLUTION_M
        gap = room.clearance.copy()
        movers = self.movers
        for m in np.flatnonzero(movers.active[world]):
            mx, my = movers.states[world, m, :2]
            gap = np.minimum(gap, np.hypot(x - mx, y - my) - movers.radii[world, m])
        px, py, heading = self.poses[world]
        distance = np.where(gap >= min(RESTART_CLEARANCE_M, gap.max()), np.hypot(x - px, y - py), np.inf)
        iy, ix = np.unravel_index(np.argmin(distance), distance.shape)
        pose = np.array([x[iy, ix], y[iy, ix], heading])
        # Where the robot is carried, its odometry is carried along: the person who moves it sets it right.
        carried = to_robot(pose[:2], self.poses[world])
        self.robots.pose_odom[world, :2] = to_world(carried, self.robots.pose_odom[world])
        self.worlds[world].place_robot(pose)
        self.poses[world] = pose
        self.robots.stop(world)
        self._look(np.arange(len(self.worlds)) == world)
