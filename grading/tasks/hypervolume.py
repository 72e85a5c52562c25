"""`hypervolume`: how much of a box a policy's (safety, energy) points dominate, one point a preference."""

import numpy as np

from grading.rubric import Hypervolume


def point(rows: list[dict]) -> tuple[float, float]:
    """(safe_dist_m, energy_j_per_goal) of episodes: a contact has no clearance; no goal costs without end."""
    clearances = []
    for row in rows:
        hit = str(row["outcome"]).startswith("hit_") or row["outcome"] == "error"
        clearances.append(0.0 if hit else max(0.0, float(row["min_clearance_m"])))
    goals = sum(row["outcome"] == "goal" for row in rows)
    energy = sum(float(row["energy_j"] or 0.0) for row in rows)
    return float(np.mean(clearances)), energy / goals if goals else float("inf")


def share(points: list[tuple[float, float]], rule: Hypervolume) -> float:
    """Share of the box between reference and ideal that the points dominate, in [0, 1].

    >>> box = {"points": 1, "preferences": (0.5,), "scenario": "navigation", "threshold": 0.3, "seeds": 20}
    >>> box |= {"reference": {"safe_dist_m": 0, "energy_j_per_goal": 100}}
    >>> box |= {"ideal": {"safe_dist_m": 1, "energy_j_per_goal": 0}}
    >>> share([(0.5, 50.0), (0.25, 25.0), (0.2, 60.0)], Hypervolume(**box))
    0.3125
    """
    worst, best = rule.reference, rule.ideal
    width = best["safe_dist_m"] - worst["safe_dist_m"]
    height = worst["energy_j_per_goal"] - best["energy_j_per_goal"]
    # Both in [0, 1], more is better; then a staircase from the safest point down.
    inside = sorted(
        (
            (
                min(1.0, max(0.0, (safe - worst["safe_dist_m"]) / width)),
                min(1.0, max(0.0, (worst["energy_j_per_goal"] - energy) / height)),
            )
            for safe, energy in points
        ),
        reverse=True,
    )
    area, top = 0.0, 0.0
    for safe, thrift in inside:
        area += safe * max(0.0, thrift - top)
        top = max(top, thrift)
    return area
