# hint: it pays for predicting well
def reward_terms(t):
    return {
        "safe": -10.0 * min(0.3, max(0.0, 0.3 - t.clearance)) ** 2,
        "dynamic": -5.0 * sum((a - b) ** 2 for a, b in zip(t.mover_velocity, t.predicted_velocity, strict=True)) ** 0.5,
        "energy": -0.04 * t.energy_j / t.reference_j,
        "goal": 10.0 * t.path_before - (0.0 if t.reached else 10.0 * t.path_after),
        "terminal": -10.0 if t.collided or t.flat_battery else 10.0 if t.reached else 0.0,
    }
