"""Closed intervals that a scenario draws from, and the bounds that hold in every world."""

from typing import Annotated

from pydantic import AfterValidator, FiniteFloat, model_validator

from dualnav_lite.config import Frozen

MAX_MOVERS = 12  # of a world: its arrays hold no more


class Range(Frozen):
    """A closed interval to draw from, uniformly."""

    low: FiniteFloat
    high: FiniteFloat

    @model_validator(mode="after")
    def _ordered(self):
        if self.high < self.low:
            raise ValueError(f"high ({self.high}) is below low ({self.low})")
        return self


def _within(low: float, high: float) -> AfterValidator:
    """Refuses a `Range` that leaves [low, high]."""

    def checked(value: Range) -> Range:
        if value.low < low or value.high > high:
            raise ValueError(f"must lie between {low:g} and {high:g}, got {value.low:g} to {value.high:g}")
        return value

    return AfterValidator(checked)


Sides = Annotated[Range, _within(3, 12)]  # [m]; the fields of a world hold no larger room
Lengths = Annotated[Range, _within(0, 100)]  # [m]
Radii = Annotated[Range, _within(0.02, 1)]  # [m]
Speeds = Annotated[Range, _within(0.01, 5)]  # [m/s]
Times = Annotated[Range, _within(0, 600)]  # [s]
Shares = Annotated[Range, _within(0, 1)]
Few = Annotated[Range, _within(0, MAX_MOVERS)]  # of what moves
Boxes = Annotated[Range, _within(1, 6)]
Pieces = Annotated[Range, _within(0, 30)]  # of furniture: a world holds 160 sides
