"""The counterfactual twin: the same episode without the thing; what it changed, and how soon (SPEC 11)."""

import numpy as np

DIFFERS = (0.05, 0.1)  # v [m/s], omega [rad/s]


def commands_differ(one, other):
    """Whether commands (..., 2) of v [m/s] and omega [rad/s] differ by more than 0.05 m/s or 0.1 rad/s."""
    gap = np.abs(np.asarray(one, float) - np.asarray(other, float))
    return (gap > DIFFERS).any(axis=-1)


def ticks_to_answer(driven, twin, seen: int) -> float:
    """Control steps from the first scan that shows something to the first command that it changed.

    Args:
        driven, twin: (steps, 2) commands of the same episode with it and without.
        seen: number of the step whose scan shows it first; its own command is tick 1.

    Returns:
        Ticks; nan where no command from there on differs (`commands_differ`).
    """
    differing = np.flatnonzero(commands_differ(driven, twin)[seen:])
    return float(differing[0] + 1) if len(differing) else float("nan")
