"""CrowdNav's circle crossing, rebuilt: a protocol that this kit did not make, to be judged by.

People on a circle of 4 m walk to its other side by ORCA, a step every 0.25 s. The robot crosses from (0, -4) to (0, 4)
and is **invisible to them**, so all the avoiding is its own, and their paths do not depend on what it does: a case is
drawn and walked once (`make_case`), and every arm meets the same paths.

Source: Chen, Liu, Kreiss, Alahi, "Crowd-robot interaction", ICRA 2019, and the settings and the order of draws of the
authors' code (vita-epfl/CrowdNav): 500 test cases with seeds 1000 to 1499, validation cases from seed 0; radius 0.3 m
and 1 m/s for all; a run ends at 24 s, one second short of the nominal 25 s. Rebuilt from the description, none copied.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dualnav_lite.config import UnusableInput

CIRCLE_M, RADIUS_M, SPEED_M_S, STEP_S, LIMIT_S = 4.0, 0.3, 1.0, 0.25, 24.0
APART_M = 2 * RADIUS_M + 0.2  # between any two starts or ends
TEST_SEED, TEST_CASES = 1000, 500
START, GOAL = np.array([0.0, -CIRCLE_M]), np.array([0.0, CIRCLE_M])
# ORCA as the authors set it: neighbours within [m], at most so many, horizons [s] for people and (unused) for walls.
ORCA = (10.0, 10, 5.0, 5.0)
ORCA_GAP_M = 0.01  # by which everybody is drawn larger in ORCA's eyes
# success, collision, mean time of successes [s]; the first from the paper's table of the invisible robot
KNOWN = {("orca", 5): (0.43, 0.57, 10.9), ("orca", 10): (0.21, None, None)}


def _simulator() -> Callable:
    try:
        from pyrvo import RVOSimulator
    except ImportError:
        raise UnusableInput(
            "the CrowdNav protocol needs pyrvo, which is not installed: pip install -r requirements-bench.txt"
        ) from None
    return RVOSimulator


@dataclass(frozen=True)
class Case:
    """One test case: where everybody is at each step of 0.25 s.

    Attributes:
        positions: (steps, people, 2) [m], from time 0 on.
        velocities: (steps, people, 2) [m/s] with which they arrived there; they start at rest.
    """

    positions: np.ndarray
    velocities: np.ndarray


def draw_starts(seed: int, people: int) -> np.ndarray:
    """(people, 2) starts; each walks to the point opposite. The draws are the original's, so the cases are too."""
    rng = np.random.RandomState(seed)
    starts, ends = [START], [GOAL]
    while len(starts) <= people:
        angle = rng.random_sample() * 2.0 * np.pi
        noise = rng.random_sample(2) - 0.5
        place = CIRCLE_M * np.array([np.cos(angle), np.sin(angle)]) + noise * SPEED_M_S
        if all(np.hypot(*(place - other)) >= APART_M for other in starts + ends):
            starts.append(place)
            ends.append(-place)
    return np.array(starts[1:])


def orca_velocity(position, velocity, goal, others, other_velocities) -> np.ndarray:
    """(2,) velocity that ORCA chooses for one body that knows where the others are and how they move now."""
    simulator = _simulator()(STEP_S, *ORCA, RADIUS_M, SPEED_M_S)
    size = RADIUS_M + ORCA_GAP_M
    simulator.add_agent(tuple(position.tolist()), *ORCA, size, SPEED_M_S, tuple(velocity.tolist()))
    for place, motion in zip(others.tolist(), other_velocities.tolist(), strict=True):
        simulator.add_agent(tuple(place), *ORCA, size, SPEED_M_S, tuple(motion))
    way = goal - position
    wanted = way / max(float(np.hypot(*way)), 1.0)
    simulator.set_agent_pref_velocity(0, tuple(wanted.tolist()))
    for other in range(len(others)):
        simulator.set_agent_pref_velocity(other + 1, (0.0, 0.0))  # where they want to go is not known
    simulator.do_step()
    return np.array(simulator.get_agent_velocity(0).to_tuple())


def make_case(seed: int, people: int) -> Case:
    """Draw a case and let its people walk to the time limit."""
    places = draw_starts(seed, people)
    goals, motion = -places, np.zeros_like(places)
    positions, velocities = [places], [motion]
    for _ in range(round(LIMIT_S / STEP_S) + 1):
        chosen = []
        for i in range(people):
            rest = np.arange(people) != i
            chosen.append(orca_velocity(places[i], motion[i], goals[i], places[rest], motion[rest]))
        motion = np.array(chosen)
        places = places + motion * STEP_S
        positions.append(places)
        velocities.append(motion)
    return Case(np.array(positions), np.array(velocities))


class Seen(NamedTuple):
    """What a holonomic arm is told: its own position and velocity, and everybody's, all true."""

    position: np.ndarray
    velocity: np.ndarray
    people: np.ndarray
    people_velocities: np.ndarray


def orca_arm(seen: Seen) -> np.ndarray:
    """The protocol's own baseline: ORCA, which trusts the others to do half of the avoiding. They do not."""
    return orca_velocity(seen.position, seen.velocity, GOAL, seen.people, seen.people_velocities)


_ANGLES = 2.0 * np.pi * np.arange(32) / 32
_RINGS = [share * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1) for share in (0.2, 0.4, 0.6, 0.8, 1.0)]
VELOCITIES = np.concatenate([np.zeros((1, 2)), *_RINGS])
# Chosen on validation cases 0 to 199 among 18 settings each for 5 and 10 people; test cases were not looked at.
URGENCY, MARGIN_M, HORIZON_S = 4.0, 0.1, 6.0


def sampling_arm(seen: Seen) -> np.ndarray:
    """The cheapest of 161 velocities if everybody keeps their own: |v - wanted| + urgency / time to collision.

    Source: van den Berg, Lin, Manocha, "Reciprocal velocity obstacles", ICRA 2008, section V, with none of the
    avoiding left to the others.
    """
    way = GOAL - seen.position
    distance = max(float(np.hypot(*way)), 1e-9)
    wanted = way / distance * min(SPEED_M_S, distance / STEP_S)
    gap, relative = seen.people - seen.position, VELOCITIES[:, None] - seen.people_velocities
    # |gap - relative t| = reach, a quadratic in t; b < 0 while they come closer.
    a, b = (relative**2).sum(axis=-1), -(gap * relative).sum(axis=-1)
    c = (gap**2).sum(axis=-1) - (2 * RADIUS_M + MARGIN_M) ** 2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    time = np.where((b < 0) & (b * b > a * c), (-b - root) / np.maximum(a, 1e-9), np.inf)
    soonest = np.maximum(time.min(axis=1), 0.02)  # closer than the margin and closing in: at once
    cost = np.hypot(*(VELOCITIES - wanted).T) + np.where(soonest < HORIZON_S, URGENCY / soonest, 0.0)
    return VELOCITIES[cost.argmin()]


def least_distance(gaps, relative_steps) -> np.ndarray:
    """(...) closest that points come to the origin on straight ways from `gaps` (..., 2) by `relative_steps`."""
    length = np.maximum((relative_steps**2).sum(axis=-1), 1e-12)
    share = np.clip(-(gaps * relative_steps).sum(axis=-1) / length, 0.0, 1.0)
    nearest = gaps + share[..., None] * relative_steps
    return np.hypot(nearest[..., 0], nearest[..., 1])


def run_holonomic(case: Case, arm: Callable[[Seen], np.ndarray]) -> tuple[str, float]:
    """Outcome (`success`, `collision`, `timeout`) and time [s] of an arm that moves as it likes, by their rules.

    As in the original, a collision is looked for along the step with the velocity that people had *before* it.
    """
    position, velocity = START, np.zeros(2)
    for step in range(round(LIMIT_S / STEP_S)):
        people, motion = case.positions[step], case.velocities[step]
        velocity = arm(Seen(position, velocity, people, motion))
        if (least_distance(people - position, (motion - velocity) * STEP_S) < 2 * RADIUS_M).any():
            return "collision", step * STEP_S
        position = position + velocity * STEP_S
        if np.hypot(*(position - GOAL)) < RADIUS_M:
            return "success", (step + 1) * STEP_S
    return "timeout", LIMIT_S


HOLONOMIC = {"orca": orca_arm, "constant_velocity_sampling": sampling_arm}
