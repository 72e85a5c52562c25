"""`encode_state`: map, motion, bands, intensity in this order; the motion is the library's, the rest written out."""

import numpy as np

from dualnav_lite.config import Motion
from dualnav_lite.motion import STEPS, Prediction, motion_fields
from grading.tasks import Question
from grading.tasks.paint_bands import an_ego, bands_of
from grading.tasks.project_intensity import a_scan, image_of

FORECAST = ("positions", "velocities", "valid", "radii")
ALSO = {
    "static": "channel_0_is_the_map",
    "motion": "channel_1_is_the_motion",
    "ego": "channel_2_is_the_bands",
    "intensity": "channel_3_is_the_newest_scan",
}


def questions(rng: np.random.Generator) -> list[Question]:
    """Three states, each with movers near the robot."""

    def ask(share):
        scans = np.stack([a_scan(rng, 400, 0.3, 6.0) for _ in range(3)])
        poses = np.cumsum(rng.uniform(-0.05, 0.05, (3, 3)), axis=0)
        crop = rng.choice([0.0, 1 / 6, 1 / 3, 2 / 3, 1.0], (64, 64)).astype(np.float32)
        ego = an_ego(rng)
        start, pace = rng.uniform(-2.0, 2.0, (3, 1, 2)), rng.uniform(-1.0, 1.0, (3, 1, 2))
        positions = start + pace * 0.1 * np.arange(1, STEPS + 1)[None, :, None]
        forecast = Prediction(positions, pace[:, 0], np.ones(3, bool), np.full(3, 0.3))
        told = {name: getattr(forecast, name) for name in FORECAST}
        batched = Prediction(*(value[None] for value in told.values()))
        right = {
            "static": crop,
            "motion": motion_fields(scans[None], poses[None], batched, Motion(method="forecast"))[0],
            "ego": bands_of(ego),
            "intensity": image_of(scans[-1]),
        }
        arrays = {"scans": scans, "poses": poses, "map_crop": crop, **ego, **told}
        return Question("channel_0_is_the_map", arrays, right, share, 1e-5, ALSO)

    return [ask(0.4), ask(0.3), ask(0.3)]
