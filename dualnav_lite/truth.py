"""The simulator's own state as plain arrays, for the ceiling planner and judges; no robot has a sensor for it."""

import numpy as np

from dualnav_lite.simulation import Simulation


def truth_of(sim: Simulation) -> dict[str, np.ndarray]:
    """What is really there in n worlds, world frame, fresh arrays.

    Returns:
        pose (n, 3); twist (n, 2); goal (n, 2); size (n, 2) of the room [m]; segments (n, S, 4) with num_segments (n,)
        in use; circles (n, M, 3) of people, circle_velocities (n, M, 2), num_circles (n,); boxes (n, M, 5) that move or
        can be moved (x, y, angle, half length, half width), box_velocities (n, M, 2), num_boxes (n,); static_field
        (n, H, W) distance from each 0.1 m cell's centre to the nearest wall or furniture [m]; goal_field (n, H, W) way
        to the goal [m], inf inside solids.
    """
    movers = sim.movers
    n, most = movers.kinds.shape
    is_box = movers.halves[..., 0] > 0
    circles, circle_velocities = np.zeros((n, most, 3)), np.zeros((n, most, 2))
    boxes, box_velocities = np.zeros((n, most, 5)), np.zeros((n, most, 2))
    num_circles, num_boxes = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(n):
        round_ones = np.flatnonzero(movers.active[i] & ~is_box[i])
        boxed = np.flatnonzero(movers.active[i] & is_box[i])
        states = movers.states[i]
        num_circles[i], num_boxes[i] = len(round_ones), len(boxed)
        circles[i, : len(round_ones), :2] = states[round_ones, :2]
        circles[i, : len(round_ones), 2] = movers.radii[i, round_ones]
        circle_velocities[i, : len(round_ones)] = states[round_ones, 3:5]
        boxes[i, : len(boxed), :3] = states[boxed, :3]
        boxes[i, : len(boxed), 3:] = movers.halves[i, boxed]
        box_velocities[i, : len(boxed)] = states[boxed, 3:5]
    unused = np.arange(sim.scene.segments.shape[1]) >= sim.scene.num_segments[:, None]
    size = [(layout.room.width, layout.room.height) if layout else (0.0, 0.0) for layout in sim.layouts]
    return {
        "pose": sim.poses.copy(),
        "twist": sim.robots.twist.copy(),
        "goal": sim.goals.copy(),
        "size": np.array(size),
        "segments": np.where(unused[..., None], 0.0, sim.scene.segments),
        "num_segments": sim.scene.num_segments.copy(),
        "circles": circles,
        "circle_velocities": circle_velocities,
        "num_circles": num_circles,
        "boxes": boxes,
        "box_velocities": box_velocities,
        "num_boxes": num_boxes,
        "static_field": sim.static_fields.copy(),
        "goal_field": sim.goal_fields.copy(),
    }
