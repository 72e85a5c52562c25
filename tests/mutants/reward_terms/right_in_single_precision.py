# right
import numpy as np


def reward_terms(t):
    clearance, before, after = (np.float32(one) for one in (t.clearance, t.path_before, t.path_after))
    missing = np.float32(0.3) - np.clip(clearance, np.float32(0.0), np.float32(0.3))
    return {
        "safe": np.float32(-10.0) * missing**2,
        "dynamic": -np.float32(t.intrusion),
        "energy": np.float32(-0.04) * np.float32(t.energy_j) / np.float32(t.reference_j),
        "goal": np.where(t.reached, np.float32(0.0), np.float32(-10.0) * after) - np.float32(-10.0) * before,
        "terminal": np.float32(-10.0 if t.collided or t.flat_battery else 10.0 if t.reached else 0.0),
    }
