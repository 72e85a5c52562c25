"""What every planner is: one command a world from what its info holds; and steering to a point."""

from abc import ABC, abstractmethod

import numpy as np

from dualnav_lite.config import Config


class Planner(ABC):
    """A driver of n worlds, asked like a policy; subclasses say what they see and give `command`.

    Attributes:
        needs_truth: reads `info["truth"]`; needs_full_map: reads `info["received_map"]`.
    """

    needs_truth = False
    needs_full_map = False

    def __init__(self, settings: Config):
        self.settings = settings
        self.max_v, self.max_omega = settings.hardware.max_lin_vel, settings.hardware.max_ang_vel

    def reset(self, indices) -> None:  # noqa: B027 (most planners remember nothing)
        """Forget what is remembered about the worlds listed."""

    def act(self, observations, infos) -> np.ndarray:
        """Commands of n worlds, each from its own info alone.

        Args:
            observations: (n, C, 64, 64); planners do not look at them.
            infos: n dictionaries. A world whose `idle` is set is commanded to stand.

        Returns:
            (n, 2) v [m/s], omega [rad/s], inside the hardware limits.
        """
        actions = np.zeros((len(infos), 2))
        for i, info in enumerate(infos):
            if not info.get("idle", False):
                actions[i] = self.command(i, info)
        limits = [self.max_v, self.max_omega]
        return np.clip(actions, np.negative(limits), limits)

    @abstractmethod
    def command(self, i: int, info: dict) -> tuple[float, float]:
        """v [m/s], omega [rad/s] of world i."""

    def turn_then_drive(self, point_robot, speed: float) -> tuple[float, float]:
        """Command that turns to a point in place and drives towards it once it lies ahead."""
        bearing = float(np.arctan2(point_robot[1], point_robot[0]))
        omega = 2.0 * bearing  # [1/s]
        return (speed if abs(bearing) < 0.35 else 0.0), min(max(omega, -self.max_omega), self.max_omega)
