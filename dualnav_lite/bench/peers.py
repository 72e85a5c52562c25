"""Other simulators in the same room: what `bench` measures beside us. Each import may fail; nobody else needs them."""

import contextlib
import io
import math
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np
import yaml

from dualnav_lite.config import Config
from dualnav_lite.layout import Layout
from dualnav_lite.pedestrians import PEDESTRIAN


def version(package: str) -> str | None:
    """Installed version of a package, or None."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def people(layout: Layout) -> list:
    """The plans of the people of a layout."""
    return [mover for mover in layout.movers if mover.kind == PEDESTRIAN]


class IrSim:
    """ir-sim with the walls, boxes, people and lidar of a layout; the people walk their waypoints by RVO."""

    def __init__(self, layout: Layout, config: Config):
        with contextlib.redirect_stdout(io.StringIO()):  # its import complains about missing screens
            import irsim
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "room.yaml"
            path.write_text(yaml.safe_dump(self._world(layout, config)), encoding="utf-8")
            self._env = irsim.make(
                str(path), headless=True, disable_all_plot=True, log_file=None, log_level="ERROR", seed=0
            )

    @staticmethod
    def _world(layout: Layout, config: Config) -> dict:
        room, lidar, limits = layout.room, config.lidar, config.hardware
        corners = [[0, 0], [room.width, 0], [room.width, room.height], [0, room.height], [0, 0]]
        solid = [{"shape": {"name": "linestring", "vertices": corners}, "state": [0.0, 0.0, 0.0]}]
        for x, y, angle, half_length, half_width in room.boxes.tolist():
            shape = {"name": "rectangle", "length": 2 * half_length, "width": 2 * half_width}
            solid.append({"shape": shape, "state": [x, y, angle]})
        walking = [
            {
                "kinematics": {"name": "omni"},
                "shape": {"name": "circle", "radius": person.radius},
                "state": [*map(float, person.pose[:2]), 0.0],
                "goal": [[*point, 0.0] for point in person.waypoints.tolist()],
                "vel_max": [person.speed, person.speed],
                "vel_min": [-person.speed, -person.speed],
                "behavior": {"name": "rvo", "vxmax": person.speed, "vymax": person.speed},
            }
            for person in people(layout)
        ]
        robot = {
            "kinematics": {"name": "diff"},
            "shape": {"name": "circle", "radius": config.robot.hull_radius_m},
            "state": layout.start.tolist(),
            "goal": [*layout.goals[0].tolist(), 0.0],
            "vel_max": [limits.max_lin_vel, limits.max_ang_vel],
            "vel_min": [-limits.max_lin_vel, -limits.max_ang_vel],
            "sensors": [
                {
                    "name": "lidar2d",
                    "number": lidar.beams,
                    "range_min": lidar.range_min_m,
                    "range_max": lidar.range_max_m,
                    "angle_range": 2 * math.pi,
                }
            ],
        }
        world = {"width": room.width, "height": room.height, "step_time": 0.1, "sample_time": 0.1}
        return {"world": world | {"collision_mode": "unobstructed"}, "robot": [robot], "obstacle": solid + walking}

    def scan(self) -> np.ndarray:
        """(beams,) ranges from -pi to pi, both ends included, in the world as it stands."""
        lidar = self._env.robot.lidar
        lidar.step(self._env.robot.state)
        return lidar.range_data

    def step(self, action) -> None:
        """One control step of robot and people, with a scan."""
        self._env.step(np.reshape(action, (2, 1)))


class Navground:
    """navground's compiled lidar among the walls, boxes and people of a layout."""

    def __init__(self, layout: Layout, config: Config):
        from navground import core, sim

        room, lidar = layout.room, config.lidar
        self._world = sim.World()
        corners = np.array([[0, 0], [room.width, 0], [room.width, room.height], [0, room.height]], float)
        outer = np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)
        for x0, y0, x1, y1 in np.concatenate([outer, room.segments()]).tolist():
            self._world.add_wall(sim.Wall(core.LineSegment((x0, y0), (x1, y1))))
        for person in people(layout):
            self._world.add_obstacle(sim.Obstacle(core.Disc(tuple(map(float, person.pose[:2])), person.radius)))
        self._lidar = sim.state_estimations.LidarStateEstimation(
            range=lidar.range_max_m, start_angle=-math.pi, field_of_view=2 * math.pi, resolution=lidar.beams
        )
        x, y, heading = layout.start.tolist()
        self._robot = sim.Agent(radius=config.robot.hull_radius_m)
        self._robot.pose = core.Pose2((x, y), heading)
        self._robot.state_estimation = self._lidar
        self._world.add_agent(self._robot)
        self._state = core.SensingState()
        self._lidar.prepare(self._robot, self._world)

    def turn(self) -> None:
        """One turn of the lidar; the readings stay in its own memory, so that only its work is timed."""
        self._lidar.update(self._robot, self._world, self._state)

    def scan(self) -> np.ndarray:
        """(beams,) ranges from -pi to pi, both ends included."""
        self.turn()
        return np.array(self._lidar.read_ranges(self._state))
