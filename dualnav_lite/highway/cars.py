"""The reward's named quantities for cars: gaps between bodies, joules of a step, and the same five terms.

`rewards.py` says what a step of the robot was worth; this says it of a car, in the same terms, ranges and weights. Only
the sizes differ: a car is 5 m long, drives twenty times as fast and keeps a time gap, not a distance.
"""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.geometry import box_corners, to_robot
from dualnav_lite.rewards import FAILED, GOAL_SCALE, REACHED, shaping

LENGTH_M, WIDTH_M = 5.0, 2.0
MASS_KG = 1500.0
IDLE_W = 4000.0  # heating, pumps, computers; with it the way is cheapest at 18 m/s, so slow has a price here too
ROLLING_N, DRAG_KG_M = 150.0, 0.36  # tyres; half of air density x drag area
HORIZON_S, MOMENTS = 2.0, 10  # of the predicted intrusion, as for the robot
TIME_GAP_S = 1.5  # less than this behind another car counts as unsafe
TERM_RANGE = 0.9  # r_safe lies in [-0.9, 0], as for the robot


def gaps(car, others) -> np.ndarray:
    """Shortest distances between a car's body and other rectangles; 0 where they touch.

    Args:
        car: (5,) x, y [m], heading [rad], half length, half width [m].
        others: (k, 5) the same.

    Returns:
        (k,) [m]. Two disjoint rectangles are nearest at a corner of one of them.
    """
    car, others = np.asarray(car, float), np.asarray(others, float).reshape(-1, 5)

    def to_box(points, half):
        """(..., ) distance of points from an upright rectangle around the origin."""
        beyond = np.maximum(np.abs(points) - half, 0.0)
        return np.hypot(beyond[..., 0], beyond[..., 1])

    theirs = to_box(to_robot(box_corners(others), car[:3]), car[3:])
    mine = to_box(to_robot(box_corners(car)[None], others[:, None, :3]), others[:, None, 3:])
    return np.minimum(theirs.min(axis=1, initial=np.inf), mine.min(axis=1, initial=np.inf))


def step_energy(speed_before: float, speed_after: float, dt: float) -> float:
    """Joules of a step of evenly changing speed: idle, rolling, drag, acceleration; braking gives nothing back."""
    middle = 0.5 * abs(speed_before + speed_after)
    resistance = (ROLLING_N + DRAG_KG_M * middle**2) * middle * dt
    return IDLE_W * dt + max(0.0, resistance + kinetic_energy(speed_after) - kinetic_energy(speed_before))


def kinetic_energy(speed: float) -> float:
    """Joules that a speed [m/s] holds."""
    return 0.5 * MASS_KG * speed**2


def predicted_intrusion(positions, velocities, margin_m: float) -> float:
    """How far a car that keeps its velocity will drive into where others will be in the next 2 s, in [0, 1].

    Args:
        positions, velocities: (k, 2) of the others in the car's frame, velocities relative to its own [m], [m/s].
        margin_m: gap below which closeness begins.

    Returns:
        The worst moment: 1 where bodies touch now, 0 where every gap stays above the margin, later moments counting
        less, as in `kernels.intrusion`. All cars are taken to point the same way.
    """
    if not len(positions):
        return 0.0
    moments = np.arange(1, MOMENTS + 1)
    ways = positions[:, None] + velocities[:, None] * (HORIZON_S / MOMENTS * moments)[:, None]
    beyond = np.maximum(np.abs(ways) - [LENGTH_M, WIDTH_M], 0.0)
    closeness = np.clip(1.0 - np.hypot(beyond[..., 0], beyond[..., 1]) / margin_m, 0.0, 1.0)
    return float((closeness * (1.0 - (moments - 1) / MOMENTS)).max())


def time_gap(positions, speed: float) -> float:
    """Seconds until the car stands where the nearest body ahead in its way ends now; inf where there is none.

    Args:
        positions: (k, 2) of the others in the car's frame [m].
        speed: of the car [m/s].
    """
    ahead = (positions[:, 0] > 0.0) & (np.abs(positions[:, 1]) < WIDTH_M + 0.3)
    gap = np.maximum(positions[ahead, 0] - LENGTH_M, 0.0).min(initial=np.inf)
    return float(gap / max(speed, 0.1))


@dataclass
class CarTransition:
    """What one control step did; the counterpart of `rewards.Transition`.

    Attributes:
        clearance: least gap to another body or a wall [m]; safe_m: below it r_safe begins.
        time_gap: see `time_gap` [s].
        intrusion: `predicted_intrusion`.
        lost_j: joules drawn in this step less what the speed gained; at a run's end the usual speed's are not lost.
        reference_j: drawn in a step at the task's usual speed.
        energy_scale: what a step at the usual speed costs.
        way_before, way_after: to the goal [m]; way_scale: metres of it that are worth one of the robot's.
        reached, collided: how the step ended the run, if it did.
    """

    clearance: float
    safe_m: float
    time_gap: float
    intrusion: float
    lost_j: float
    reference_j: float
    energy_scale: float
    way_before: float
    way_after: float
    way_scale: float
    reached: bool
    collided: bool


def car_safe(clearance, time_gap, safe_m: float) -> float:
    """r_safe of a car in [-0.9, 0]: a squared hinge of the gap or of the time gap, whichever is worse.

    Args:
        clearance: least gap to another body or a wall [m]; safe_m: below it the gap counts [m].
        time_gap: see `time_gap` [s]; below 1.5 s it counts.

    Source: article 4.2, for bodies that cannot stop at once.
    """
    return -TERM_RANGE * max(1.0 - clearance / safe_m, 1.0 - time_gap / TIME_GAP_S, 0.0) ** 2


def car_terms(t: CarTransition) -> dict[str, float]:
    """The five terms of a step, before any weight, in the order of `rewards.TERMS` and in the robot's ranges.

    safe: `car_safe`; dynamic: minus the predicted intrusion; energy: joules lost over those of the usual speed; goal:
    metres of way gained, so a way back costs what the way forth paid; terminal: arrival and contact.

    Joules are charged when they are lost (idling, rolling, drag, brakes), not when drawn: over a run the sum is
    the same but for a constant, and speeding up does not cost at once what it earns later. Charged when drawn, thrifty
    drivers of traffic let their car roll until the time was up.

    The goal term is not discounted, as the robot's is not (`rewards.shaping`): otherwise 0 of 50 cars arrived after
    60,000 steps of parking.
    """
    return {
        "safe": car_safe(t.clearance, t.time_gap, t.safe_m),
        "dynamic": -t.intrusion,
        "energy": -t.energy_scale * t.lost_j / t.reference_j,
        "goal": float(shaping(t.way_before, t.way_after, t.reached, 1.0, lambda way: -GOAL_SCALE * way / t.way_scale)),
        "terminal": FAILED if t.collided else REACHED if t.reached else 0.0,
    }
