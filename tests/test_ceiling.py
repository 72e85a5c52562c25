"""The ceiling planner, in a plane world of its own: a dozen lines of kinematics, no pymunk, no scan."""

import numpy as np
import pytest

from dualnav_lite.config import Config
from dualnav_lite.kernels.clearance import static_clearance
from dualnav_lite.planners import ARMS, make_planner

ROOM, CELLS, HULL = 8.0, 120, 0.2


def static_field(boxes):
    """(120, 120) distance to the nearest box or wall of an 8 x 8 m room; 0 outside it."""
    field = np.zeros((CELLS, CELLS), np.float32)
    field[:80, :80] = static_clearance(np.array(boxes, float).reshape(-1, 5), ROOM, ROOM, 0.1)
    return field


class Plane:
    """A robot with the real one's limits among circles that walk and boxes that slide or stand."""

    def __init__(self, goal, circles=(), walks=(), boxes=(), slides=(), static=(), start=(1.0, 4.0, 0.0)):
        self.pose, self.twist, self.goal = np.array(start, float), np.zeros(2), np.array(goal, float)
        self.circles, self.walks = np.array(circles, float).reshape(-1, 3), np.array(walks, float).reshape(-1, 2)
        self.boxes, self.slides = np.array(boxes, float).reshape(-1, 5), np.array(slides, float).reshape(-1, 2)
        self.static, self.field, self.trail = np.array(static, float).reshape(-1, 5), static_field(static), []

    def info(self):
        """What `infos["truth"]` would hold."""
        truth = {
            "pose": self.pose.copy(),
            "twist": self.twist.copy(),
            "goal": self.goal,
            "static_field": self.field,
            "circles": self.circles,
            "circle_velocities": self.walks,
            "num_circles": len(self.circles),
            "boxes": self.boxes,
            "box_velocities": self.slides,
            "num_boxes": len(self.boxes),
        }
        return {"truth": truth, "twist": self.twist.copy(), "idle": False}

    def move(self, command):
        """One control step of unicycle kinematics within the acceleration limits."""
        self.twist += np.clip(np.asarray(command) - self.twist, [-0.1, -0.25], [0.1, 0.25])
        middle = self.pose[2] + 0.05 * self.twist[1]
        self.pose += 0.1 * np.array([self.twist[0] * np.cos(middle), self.twist[0] * np.sin(middle), self.twist[1]])
        self.circles[:, :2] += 0.1 * self.walks
        self.boxes[:, :2] += 0.1 * self.slides
        self.trail.append(self.pose.copy())

    def gap(self):
        """From the hull to the nearest of everything [m]; boxes by sampling their outline, not by the planner's way."""
        x, y = self.pose[:2]
        gaps = [x, y, ROOM - x, ROOM - y]
        gaps += [np.hypot(x - cx, y - cy) - r for cx, cy, r in self.circles]
        for bx, by, angle, half_length, half_width in [*self.boxes, *self.static]:
            u, v = np.meshgrid(np.linspace(-1, 1, 41) * half_length, np.linspace(-1, 1, 41) * half_width)
            px = bx + np.cos(angle) * u - np.sin(angle) * v
            py = by + np.sin(angle) * u + np.cos(angle) * v
            gaps.append(np.hypot(x - px, y - py).min())
        return min(gaps) - HULL

    def drive(self, seconds, each=lambda plane, t: None):
        """Let the ceiling drive; the least gap on the way and whether it arrived."""
        planner = make_planner("ceiling", Config())
        planner.reset([0])
        least = np.inf
        for k in range(round(10 * seconds)):
            each(self, 0.1 * k)
            self.move(planner.act(None, [self.info()])[0])
            least = min(least, self.gap())
            if np.hypot(*(self.pose[:2] - self.goal)) < 0.4:
                return least, True
        return least, False


def test_it_drives_straight_where_nothing_is_in_the_way():
    plane = Plane((7.0, 4.0))
    _, arrived = plane.drive(12)
    assert arrived
    assert np.abs(np.array(plane.trail)[:, 1] - 4.0).max() < 0.15
    assert len(plane.trail) < 95  # 5.6 m at 0.8 m/s and 0.8 s of acceleration take 78 steps


def test_it_goes_round_a_box_that_has_slid_into_its_way():
    def stop_in_the_way(plane, t):
        if plane.boxes[0, 1] <= 4.0:
            plane.slides[:] = 0.0

    plane = Plane((7.0, 4.0), boxes=[(3.2, 4.9, 0, 0.2, 0.2)], slides=[(0.0, -1.5)])
    least, arrived = plane.drive(20, stop_in_the_way)
    assert arrived
    assert least > 0.03


def test_it_does_not_clip_a_corner():
    plane = Plane((5.0, 6.5), static=[(3.0, 5.0, 0.0, 1.0, 1.0)], start=(1.5, 3.3, 0.0))
    least, arrived = plane.drive(20)
    assert arrived
    assert least > 0.03


def test_it_does_not_drive_into_somebody_who_blocks_a_passage():
    """A wall with one gap of 0.9 m and a person in it: wait, and go on once the person has gone."""
    wall = [(4.0, 1.775, 0, 0.1, 1.775), (4.0, 6.225, 0, 0.1, 1.775)]

    def leave_after_ten_seconds(plane, t):
        plane.walks[:] = (0.9, 0.9) if 10.0 <= t < 13.0 else (0.0, 0.0)

    plane = Plane((7.0, 4.0), circles=[(4.0, 4.0, 0.3)], walks=[(0, 0)], static=wall)
    least, arrived = plane.drive(10)
    assert not arrived
    assert least > 0.0
    plane = Plane((7.0, 4.0), circles=[(4.0, 4.0, 0.3)], walks=[(0, 0)], static=wall)
    least, arrived = plane.drive(30, leave_after_ten_seconds)
    assert arrived
    assert least > 0.0


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_it_lets_a_crossing_group_pass(direction):
    """Five abreast, aimed at a robot that drives on; straight ahead would be a collision (checked)."""
    places = [(3.0 + 0.85 * k, 4.0 - 3.2 * direction, 0.28) for k in range(5)]
    blind = Plane((7.0, 4.0), places, [(0.0, 0.8 * direction)] * 5)
    gaps = []
    for _ in range(80):
        blind.move((0.8, 0.0))
        gaps.append(blind.gap())
    assert min(gaps) < 0.0
    plane = Plane((7.0, 4.0), places, [(0.0, 0.8 * direction)] * 5)
    least, arrived = plane.drive(25)
    assert arrived
    assert least > 0.05


def test_a_cap_on_its_speed_is_kept():
    planner = make_planner("ceiling@max_speed=0.5", Config())
    plane = Plane((7.0, 4.0))
    for _ in range(30):
        command = planner.act(None, [plane.info()])[0]
        assert abs(command[0]) <= 0.5 + 1e-9
        plane.move(command)
    assert plane.twist[0] > 0.4


def test_its_costs_rank_the_command_it_takes_first():
    planner = make_planner("ceiling", Config())
    infos = [Plane((7.0, 4.0)).info(), Plane((1.0, 7.0)).info()]
    costs = np.stack([planner.costs(i, info) for i, info in enumerate(infos)])
    assert costs.shape == (2, 99)
    assert np.isfinite(costs).all()
    best = planner.grid.reshape(-1, 2)[costs.argmin(axis=1)]
    assert np.allclose(planner.act(None, infos), best)


def test_a_world_s_command_does_not_depend_on_its_neighbours():
    infos = [Plane((7.0, 4.0)).info(), Plane((1.0, 7.0), [(2.0, 5.0, 0.3)], [(0.5, 0.0)]).info()]
    together = make_planner("ceiling", Config()).act(None, infos)
    apart = [make_planner("ceiling", Config()).act(None, [info])[0] for info in infos]
    assert np.array_equal(together, apart)


def test_only_the_ceiling_asks_for_the_truth():
    assert [name for name in ARMS if getattr(ARMS[name], "needs_truth", False)] == ["ceiling"]
