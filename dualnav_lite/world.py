"""One world's bodies and contacts in pymunk, top-down; the only file that knows pymunk."""

import numpy as np
import pymunk
from pymunk import batch

from dualnav_lite.interrupt import hold_in_pymunk
from dualnav_lite.layout import Layout
from dualnav_lite.pedestrians import PEDESTRIAN, PUSHABLE, SURFACE_OF_KIND
from dualnav_lite.semantics import Surface

ROBOT_CONTACT = 100  # collision type of the hull; solids carry their `Surface`
FLOOR_FRICTION = 0.4  # of a pushable box
GRAVITY_M_S2 = 9.81
_READ = batch.BodyFields.POSITION | batch.BodyFields.ANGLE | batch.BodyFields.VELOCITY
# The property's setter: pymunk's attribute hook costs more than the call.
_set_velocity = vars(pymunk.Body)["velocity"].fset


class World:
    """Rigid bodies of one episode: the robot, its room and its movers.

    People who react, pushable boxes and the robot are dynamic; a crossing group, the unaware, pop-up boxes and
    the forklift are kinematic, so nothing stops them. There is no gravity; a pushable box is held by friction with the
    floor.

    Attributes:
        contact: `Surface` the hull touched first since `clear_contact`, `NOTHING` if none.
    """

    def __init__(self, layout: Layout, hull_radius: float, mass: float):
        hold_in_pymunk()
        self.contact = Surface.NOTHING
        self._space = pymunk.Space()
        self._add_room(layout)
        self._robot = self._add_robot(layout.start, hull_radius, mass)
        self._movers = [self._add_mover(plan) for plan in layout.movers]
        self._driven = [m for m, plan in enumerate(layout.movers) if plan.kind != PUSHABLE]
        for surface in (Surface.WALL, Surface.DOOR, Surface.FURNITURE, Surface.PERSON, Surface.BOX):
            self._space.on_collision(ROBOT_CONTACT, int(surface), begin=self._touch, data={"surface": surface})
        self._buffer = batch.Buffer()
        bodies = [self._robot, *self._movers]
        self._rows = self._rows_of(bodies)

    def _add_room(self, layout: Layout) -> None:
        room, static = layout.room, self._space.static_body
        corners = [(0.0, 0.0), (room.width, 0.0), (room.width, room.height), (0.0, room.height)]
        for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
            wall = pymunk.Segment(static, begin, end, 0.0)
            wall.collision_type = int(Surface.WALL)
            self._space.add(wall)
        sides = room.segments().reshape(-1, 4, 4)
        for box, surface in zip(sides, room.surfaces, strict=True):
            shape = pymunk.Poly(static, [tuple(side[:2]) for side in box.tolist()])
            shape.collision_type = int(surface)
            self._space.add(shape)

    def _add_robot(self, pose, radius: float, mass: float) -> pymunk.Body:
        body = pymunk.Body(mass, pymunk.moment_for_circle(mass, 0.0, radius))
        body.position, body.angle = (float(pose[0]), float(pose[1])), float(pose[2])
        shape = pymunk.Circle(body, radius)
        shape.collision_type = ROBOT_CONTACT
        self._space.add(body, shape)
        return body

    def _add_mover(self, plan) -> pymunk.Body:
        if plan.kind == PEDESTRIAN:
            body = pymunk.Body(plan.mass, float("inf"))
        elif plan.kind == PUSHABLE:
            size = (2 * plan.half_length, 2 * plan.half_width)
            body = pymunk.Body(plan.mass, pymunk.moment_for_box(plan.mass, size))
        else:
            body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position, body.angle = (float(plan.pose[0]), float(plan.pose[1])), float(plan.pose[2])
        if plan.radius > 0:
            shape: pymunk.Shape = pymunk.Circle(body, plan.radius)
        else:
            shape = pymunk.Poly.create_box(body, (2 * plan.half_length, 2 * plan.half_width))
        shape.collision_type = int(SURFACE_OF_KIND[plan.kind])
        self._space.add(body, shape)
        if plan.kind == PUSHABLE:
            self._hold_by_floor(body, plan)
        return body

    def _hold_by_floor(self, body: pymunk.Body, plan) -> None:
        """Dry friction with the floor, as joints of limited force (Chipmunk's top-down idiom)."""
        force = FLOOR_FRICTION * plan.mass * GRAVITY_M_S2
        slide = pymunk.PivotJoint(self._space.static_body, body, (0, 0), (0, 0))
        slide.max_bias, slide.max_force = 0.0, force
        turn = pymunk.GearJoint(self._space.static_body, body, 0.0, 1.0)
        turn.max_bias, turn.max_force = 0.0, force * plan.half_length
        self._space.add(slide, turn)

    def _touch(self, arbiter, space, data) -> None:
        if self.contact == Surface.NOTHING:
            self.contact = data["surface"]

    def _rows_of(self, bodies) -> list[int]:
        """Row of each body in a batch read, whose order pymunk chooses."""
        ids = batch.Buffer()
        batch.get_space_bodies(self._space, batch.BodyFields.BODY_ID, ids)
        order = np.frombuffer(ids.int_buf(), np.uintp).tolist()
        return [order.index(body.id) for body in bodies]

    def advance(self, displacement, velocities, dt: float, substeps: int) -> None:
        """Move everything through one control step.

        Args:
            displacement: (3,) dx, dy [m], world frame, and turn [rad] of the robot if nothing is in its way.
            velocities: (M, 2) of the movers [m/s], world frame; a pushable box's is not read.
            dt: physics step [s]; substeps: of them.
        """
        period = dt * substeps
        dx, dy, turn = displacement.tolist()
        _set_velocity(self._robot, (dx / period, dy / period))
        self._robot.angular_velocity = turn / period
        if self._driven:
            wanted = velocities.tolist()
            for m in self._driven:
                _set_velocity(self._movers[m], wanted[m])
        step = self._space.step
        for _ in range(substeps):
            step(dt)

    def read(self, robot_pose, mover_states) -> None:
        """Write the present state into (3,) `robot_pose` and (M, 5) `mover_states` (x, y, angle, vx, vy)."""
        self._buffer.clear()
        batch.get_space_bodies(self._space, _READ, self._buffer)
        rows = np.frombuffer(self._buffer.float_buf()).reshape(-1, 5)[self._rows]
        robot_pose[:] = rows[0, :3]
        mover_states[: len(rows) - 1] = rows[1:]

    def show(self, mover: int, pose) -> None:
        """Put a mover at a pose, as a pop-up box that appears."""
        body = self._movers[mover]
        body.position, body.angle = (float(pose[0]), float(pose[1])), float(pose[2])
        self._space.reindex_shapes_for_body(body)

    def place_robot(self, pose) -> None:
        """Put the robot at rest at a pose, as after a contact in a long run."""
        self._robot.position, self._robot.angle = (float(pose[0]), float(pose[1])), float(pose[2])
        self._robot.velocity, self._robot.angular_velocity = (0.0, 0.0), 0.0
        self._space.reindex_shapes_for_body(self._robot)

    def clear_contact(self) -> None:
        """Forget what was touched."""
        self.contact = Surface.NOTHING
