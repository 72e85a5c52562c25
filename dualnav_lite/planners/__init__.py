"""Drivers to compare a policy with, by id: what they see ranges from nothing to everything."""

import inspect
import math
from collections.abc import Callable

from dualnav_lite.config import Config, UnknownName, UnusableInput
from dualnav_lite.planners.base import Planner
from dualnav_lite.planners.dwa import DynamicWindow
from dualnav_lite.planners.orca import Orca
from dualnav_lite.planners.pursuit import AStar
from dualnav_lite.planners.rrtstar import RrtStar
from dualnav_lite.planners.sampling import Ceiling, CvSampling
from dualnav_lite.planners.scripted import Crawl, DriveWaitStraight, StandStill, Straight, WaitThenStraight

__all__ = ["ARMS", "Planner", "make_planner"]

ARMS: dict[str, Callable[..., Planner]] = {
    "ceiling": Ceiling,
    "stand_still": StandStill,
    "straight": Straight,
    "crawl": Crawl,
    "wait_then_straight": WaitThenStraight,
    "drive_wait_straight": DriveWaitStraight,
    "astar": AStar,
    "rrtstar": RrtStar,
    "dwa": DynamicWindow,
    "orca": Orca,
    "cv_sampling": CvSampling,
}


def make_planner(arm_id: str, config: Config | None = None, **knobs) -> Planner:
    """A planner by its arm id.

    Args:
        arm_id: one of `ARMS`, with knobs if wanted: `astar@max_speed=0.5`, `drive_wait_straight@share=0.4+wait_s=8`.
        config: the configuration the worlds run with; the defaults if None.
        knobs: of the planner's class, as `max_speed`.

    Raises:
        UnusableInput: an unknown arm or knob, a knob that is negative or not finite, or a missing package that the arm
            needs.
    """
    name, _, tail = arm_id.partition("@")
    if name not in ARMS:
        raise UnknownName(f"unknown arm '{name}'; known: {', '.join(ARMS)}")
    for knob in tail.split("+") if tail else ():
        key, _, value = knob.partition("=")
        try:
            knobs[key] = float(value)
        except ValueError:
            raise UnusableInput(f"arm '{arm_id}': a knob reads name=number, got '{knob}'") from None
    known = [parameter for parameter in inspect.signature(ARMS[name]).parameters if parameter != "settings"]
    unknown = sorted(set(knobs) - set(known))
    if unknown:
        raise UnusableInput(f"arm '{name}': unknown knob '{unknown[0]}'; known: {', '.join(known) or 'none'}")
    for key, value in knobs.items():
        if not 0.0 <= value < math.inf:
            raise UnusableInput(f"arm '{arm_id}': {key} must be a finite number of at least 0, got {value:g}")
    return ARMS[name](config or Config(), **knobs)
