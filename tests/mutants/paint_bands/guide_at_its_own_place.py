# hint: look at the distance first
import numpy as np

from dualnav_lite.encoder import BAND_EDGES


def paint_bands(ego):
    far, guide = np.hypot(*ego.goal_robot), np.hypot(*ego.guide_robot)
    goal = (ego.goal_robot[1] / far, ego.goal_robot[0] / far) if far > 0 else (0.0, 1.0)
    numbers = [np.clip(ego.twist[0] / 0.8, -1, 1), np.clip(ego.twist[1] / 1.2, -1, 1), ego.battery, far / (far + 2.0)]
    numbers += [*goal, ego.guide_robot[1] / guide, ego.guide_robot[0] / guide]
    numbers += [min(1.0, ego.map_age_s / 2.0), ego.preference]
    return np.repeat(numbers, np.diff(BAND_EDGES))[:, None] * np.ones(64)
