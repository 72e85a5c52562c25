"""Optimal reciprocal collision avoidance on what the robot sees; needs the package pyrvo."""

import numpy as np

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.planners.base import Planner
from dualnav_lite.planners.pursuit import scan_points

HORIZON_S, STATIC_HORIZON_S = 4.0, 1.0
GAP_M = 0.08  # beside the hull; ORCA itself keeps none, and a differential drive cannot follow it exactly
RANGE_M = 3.0
JUMP_M = 0.25  # neighbouring beams farther apart belong to different things
PIECE_M = 0.3  # length of the pieces by which a wall is given


class Orca(Planner):
    """Sees tracks of moving things and the scan, from which walls and whatever stands become obstacle lines.

    It prefers the velocity towards the guide point, asks ORCA for the nearest safe one and turns the wheels towards it.
    The others are taken to do half of the avoiding, as in the original; those who do not react are its known weakness.

    Source: van den Berg, Guy, Lin, Manocha (ISRR 2009).
    """

    def __init__(self, settings: Config, max_speed: float | None = None):
        super().__init__(settings)
        try:
            from pyrvo import RVOSimulator
        except ImportError:
            raise UnusableInput(
                "arm 'orca' needs pyrvo, which is not installed: pip install -r requirements-bench.txt"
            ) from None
        self._simulator = RVOSimulator
        self.speed = self.max_v if max_speed is None else min(max_speed, self.max_v)

    def command(self, i, info):
        """Towards the velocity that ORCA chooses."""
        dt = self.settings.control_dt_s
        radius = self.settings.robot.hull_radius_m + GAP_M
        simulator = self._simulator(dt, RANGE_M, 10, HORIZON_S, STATIC_HORIZON_S, radius, self.speed)
        robot = simulator.add_agent((0.0, 0.0))
        simulator.set_agent_velocity(robot, (float(info["twist"][0]), 0.0))
        tracks = info["tracks"]
        valid = np.flatnonzero(tracks["valid"])
        for k in valid:
            velocity, place = tracks["velocities"][k].tolist(), tracks["positions"][k].tolist()
            size = float(tracks["radii"][k])
            other = simulator.add_agent(tuple(place), RANGE_M, 10, HORIZON_S, 1.0, size, 2.0, tuple(velocity))
            simulator.set_agent_pref_velocity(other, tuple(velocity))
        points = scan_points(info["scan"], self.settings.lidar.range_max_m)
        for begin, end in wall_pieces(points, tracks["positions"][valid], tracks["radii"][valid]):
            simulator.add_obstacle([tuple(begin.tolist()), tuple(end.tolist())])
        simulator.process_obstacles()
        guide = np.asarray(info["guide_robot"], float)
        distance = max(float(np.hypot(*guide)), 1e-6)
        wanted = guide / distance * min(self.speed, distance)
        simulator.set_agent_pref_velocity(robot, tuple(wanted.tolist()))
        simulator.do_step()
        vx, vy = simulator.get_agent_velocity(robot).to_tuple()
        bearing = float(np.arctan2(vy, vx)) if np.hypot(vx, vy) > 0.02 else 0.0
        return max(vx, 0.0), 3.0 * bearing


def wall_pieces(points, centres, radii):
    """Pairs of points that outline what stands within reach, off the tracked things.

    Args:
        points: (p, 2) hits in the order of their beams [m], robot frame.
        centres, radii: (k, 2), (k,) of tracked movers [m].

    Returns:
        List of (begin (2,), end (2,)) [m].
    """
    keep = np.hypot(*points.T) < RANGE_M
    for centre, radius in zip(centres, radii, strict=True):
        keep &= np.hypot(*(points - centre).T) > radius + 0.15
    points = points[keep]
    if len(points) < 2:
        return []
    steps = np.hypot(*np.diff(points, axis=0).T)
    pieces = []
    for run in np.split(points, np.flatnonzero(steps > JUMP_M) + 1):
        begin = run[0]
        for k in range(1, len(run)):
            is_last = k == len(run) - 1
            if is_last or np.hypot(*(run[k] - begin)) >= PIECE_M:
                if np.hypot(*(run[k] - begin)) > 1e-3:
                    pieces.append((begin, run[k]))
                begin = run[k]
    return pieces
