"""A lidar with intensity, and the semantic front end behind it, for n worlds at once."""

import numpy as np

from dualnav_lite import config
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels.lidar import cast_scans
from dualnav_lite.kernels.scan_noise import NORMAL, UNIFORM, spoil_scans
from dualnav_lite.scene import Scene
from dualnav_lite.semantics import LABEL, REFLECTIVITY, Surface


class Lidar:
    """Turns of `settings.beams` beams over 360 degrees, one a control step.

    The front end that labels hits is the simulator's own knowledge with a share of mistakes; it stands in for a
    segmentation network. A box and a reflection look like furniture to it, a robot like a person.

    Args:
        settings: beams, limits and the front end's mistakes.
        num_envs: number of worlds n.
    """

    def __init__(self, settings: config.Lidar, num_envs: int):
        self.settings = settings
        self.num_envs = num_envs
        shape = (num_envs, settings.beams)
        self._clean = np.empty(shape), np.empty(shape, np.uint8), np.empty(shape)

    def cast(self, poses, scene: Scene):
        """Clean readings of every beam.

        Args:
            poses: (n, 3) true poses, world frame.
            scene: what the worlds look like.

        Returns:
            ranges (n, beams) [m], surfaces (n, beams) u8 `Surface`, incidence (n, beams) cosine. The arrays are
            overwritten by the next `cast` or `scan`.
        """
        cast_scans(
            poses,
            scene.segments,
            scene.segment_surface,
            scene.num_segments,
            scene.circles,
            scene.circle_surface,
            scene.num_circles,
            self.settings.range_max_m,
            *beam_directions(self.settings.beams),
            *self._clean,
        )
        return self._clean

    def scan(self, poses, scene: Scene, ambient_lux, keys, step):
        """Readings as the robot gets them.

        Args:
            poses: (n, 3) true poses, world frame.
            scene: what the worlds look like.
            ambient_lux: (n,) light in each world; `kernels.scan_noise.noise_levels` has the formula.
            keys: (n,) u64 `streams.stream_key` of each world.
            step: (n,) i64 turns since reset.

        Returns:
            scans: (n, beams, 2) f32, range [m] in [range_min_m, range_max_m] and intensity in [0, 1]; a lost beam
                reads range_max_m and 0. New at every call.
            labels: (n, beams) u8 `Surface` code the front end gives each hit, 0 for a lost beam. New at every call.
        """
        settings = self.settings
        scans = np.empty((self.num_envs, settings.beams, 2), np.float32)
        labels = np.empty((self.num_envs, settings.beams), np.uint8)
        spoil_scans(
            *self.cast(poses, scene),
            ambient_lux,
            keys,
            step,
            settings.range_min_m,
            settings.range_max_m,
            REFLECTIVITY,
            LABEL,
            LABEL[Surface.PHANTOM],
            settings.label_confusion,
            NORMAL,
            UNIFORM,
            scans,
            labels,
        )
        if settings.faintest > 0.0:
            is_faint = scans[..., 1] < settings.faintest
            scans[is_faint] = settings.range_max_m, 0.0
            labels[is_faint] = 0
        return scans, labels
