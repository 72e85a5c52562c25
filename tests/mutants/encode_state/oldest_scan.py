# hint: the newest scan
import numpy as np

from dualnav_lite.config import Motion
from dualnav_lite.encoder import BAND_EDGES
from dualnav_lite.motion import Prediction, motion_fields


def bands(ego):
    def direction(point):
        angle = np.arctan2(point[1], point[0])
        return np.sin(angle), np.cos(angle)

    far = np.linalg.norm(ego.goal_robot)
    numbers = [np.clip(ego.twist[0] / 0.8, -1, 1), np.clip(ego.twist[1] / 1.2, -1, 1), ego.battery, far / (far + 2.0)]
    numbers += [*direction(ego.goal_robot), *direction(ego.guide_robot), min(1.0, ego.map_age_s / 2.0), ego.preference]
    return np.repeat(numbers, np.diff(BAND_EDGES))[:, None] * np.ones(64)


def intensity(scan):
    angles = np.linspace(-np.pi, np.pi, len(scan), endpoint=False)
    cells = np.floor(32 - 10 * scan[:, 0] * np.stack([np.cos(angles), np.sin(angles)])).astype(int)
    seen = ((cells >= 0) & (cells < 64)).all(0)
    image = np.zeros((64, 64))
    np.maximum.at(image, tuple(cells[:, seen]), np.minimum(scan[seen, 1], 1.0))
    return image


def motion(scans, poses, ego):
    forecast = (ego.forecast.positions, ego.forecast.velocities, ego.forecast.valid, ego.forecast.radii)
    return motion_fields(scans[None], poses[None], Prediction(*(p[None] for p in forecast)), Motion(method="forecast"))[
        0
    ]


def encode_state(scans, poses, map_crop, ego):
    moving = motion(scans, poses, ego)
    return np.stack([map_crop, moving, bands(ego), intensity(scans[0])]).astype(np.float32)
