"""Drivers that know nothing but where the goal is: the floor that every scenario must hold against."""

import numpy as np

from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.planners.base import Planner


class StandStill(Planner):
    """Sees nothing and never moves."""

    def command(self, i, info):
        """Always zero."""
        return 0.0, 0.0


class Straight(Planner):
    """Sees the goal's bearing: turns to it and drives at one speed, blind to everything else.

    Args:
        settings: the configuration.
        speed: [m/s]; the hardware's limit if None.
    """

    def __init__(self, settings: Config, speed: float | None = None):
        super().__init__(settings)
        self.speed = self.max_v if speed is None else speed

    def command(self, i, info):
        """Towards the goal."""
        return self.turn_then_drive(info["goal_robot"], self.speed)


class Crawl(Straight):
    """`straight` at 0.29 m/s: slow enough that events tied to a speed would never happen."""

    def __init__(self, settings: Config, speed: float = 0.29):
        super().__init__(settings, speed)


class WaitThenStraight(Straight):
    """Stands for some seconds from the start, then `straight`; sees the goal and the clock.

    Args:
        settings: the configuration.
        wait_s: how long to stand.
    """

    def __init__(self, settings: Config, wait_s: float = 6.0):
        super().__init__(settings)
        self.wait_s = wait_s

    def command(self, i, info):
        """Nothing, then towards the goal."""
        return (0.0, 0.0) if info["time_s"] < self.wait_s else super().command(i, info)


class DriveWaitStraight(Straight):
    """`straight` for a share of the way, a wait, then the rest; sees the goal and the clock.

    Args:
        settings: the configuration.
        share: of the goal's distance at the start, after which to wait.
        wait_s: how long to stand there.
    """

    def __init__(self, settings: Config, share: float = 0.3, wait_s: float = 6.0):
        super().__init__(settings)
        if not 0.0 <= share <= 1.0:
            raise UnusableInput(f"drive_wait_straight: share must lie in [0, 1], got {share}")
        self.share, self.wait_s = share, wait_s
        self._begin: dict[int, float] = {}  # distance of the goal at the start [m]
        self._until: dict[int, float] = {}  # when the wait ends [s]

    def reset(self, indices):
        """Forget where these worlds began and waited."""
        for i in indices:
            self._begin.pop(int(i), None)
            self._until.pop(int(i), None)

    def command(self, i, info):
        """Towards the goal, but for the wait."""
        left = float(np.hypot(*info["goal_robot"]))
        begin = self._begin.setdefault(i, left)
        if left <= (1.0 - self.share) * begin and i not in self._until:
            self._until[i] = float(info["time_s"]) + self.wait_s
        if info["time_s"] < self._until.get(i, 0.0):
            return 0.0, 0.0
        return super().command(i, info)
