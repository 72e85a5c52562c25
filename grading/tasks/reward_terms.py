"""`reward_terms`: five named numbers of a transition, against formulas written out here."""

import numpy as np

from grading.tasks import Question
from grading.tasks.goal import SINGLE


def _right(t: dict[str, np.ndarray]) -> np.ndarray:
    rows = []
    for k in range(len(t["clearance"])):
        missing = max(0.0, 0.3 - max(0.0, t["clearance"][k]))
        after = 0.0 if t["reached"][k] else -10.0 * t["path_after"][k]
        failed = t["collided"][k] or t["flat_battery"][k]
        rows.append(
            [
                -10.0 * missing**2,
                -t["intrusion"][k],
                -0.04 * t["energy_j"][k] / t["reference_j"][k],
                after + 10.0 * t["path_before"][k],
                -10.0 if failed else 10.0 if t["reached"][k] else 0.0,
            ]
        )
    return np.array(rows)


def transitions(rng: np.random.Generator, n: int, **fixed) -> dict[str, np.ndarray]:
    """Fields of n transitions without an end; `fixed` replaces some."""
    before = rng.uniform(0.5, 9.0, n)
    drawn = {
        "clearance": rng.uniform(-0.05, 1.0, n),
        "min_range": rng.uniform(0.2, 3.0, n),
        "action": rng.uniform(-1.0, 1.0, (n, 2)),
        "mover_velocity": rng.normal(size=(n, 2)),
        "predicted_velocity": rng.normal(size=(n, 2)),
        "intrusion": rng.uniform(0.0, 1.0, n),
        "energy_j": rng.uniform(0.5, 5.0, n),
        "reference_j": rng.uniform(2.0, 3.0, n),
        "path_before": before,
        "path_after": before - rng.uniform(-0.08, 0.08, n),
        "goal_distance": rng.uniform(0.5, 9.0, n),
        "reached": np.zeros(n, bool),
        "collided": np.zeros(n, bool),
        "flat_battery": np.zeros(n, bool),
    }
    return drawn | {name: np.full(n, value) if np.ndim(value) == 0 else value for name, value in fixed.items()}


def questions(rng: np.random.Generator) -> list[Question]:
    """One term at a time, then the ends."""

    def ask(hint, share, **fixed):
        t = transitions(rng, 8, **fixed)
        return Question(hint, t, {"values": _right(t)}, share, SINGLE)

    still = {"clearance": 2.0, "intrusion": 0.0, "energy_j": 0.0}
    way, gained = rng.uniform(1.0, 8.0, 8), rng.uniform(-0.08, 0.08, 8)
    return [
        ask("dynamic_is_minus_intrusion", 0.1, **(still | {"intrusion": rng.uniform(0.1, 1.0, 8)})),
        ask("energy_costs_its_share", 0.2, **(still | {"energy_j": rng.uniform(0.5, 5.0, 8)})),
        ask("safe_is_of_the_clearance", 0.1, **(still | {"clearance": rng.uniform(0.0, 0.29, 8)})),
        ask("goal_is_of_the_way", 0.1, **(still | {"path_before": way, "path_after": way - gained})),
        ask("arrival_pays", 0.1, reached=True),
        ask("collision_costs", 0.1, collided=True),
        ask("flat_battery_costs", 0.1, flat_battery=True),
        ask("contact_at_arrival_is_a_failure", 0.2, reached=True, collided=True),
    ]
