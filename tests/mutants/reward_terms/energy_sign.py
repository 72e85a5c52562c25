# hint: spending energy must cost
def reward_terms(t):
    return {
        "safe": -10.0 * min(0.3, max(0.0, 0.3 - t.clearance)) ** 2,
        "dynamic": -t.intrusion,
        "energy": 0.04 * t.energy_j / t.reference_j,
        "goal": 10.0 * t.path_before - (0.0 if t.reached else 10.0 * t.path_after),
        "terminal": -10.0 if t.collided or t.flat_battery else 10.0 if t.reached else 0.0,
    }
