"""Figures of single runs, driven when they are drawn: paths over the map, and the reward terms of one run."""

import numpy as np
from matplotlib.figure import Figure

from dualnav_lite import rewards
from dualnav_lite.episodes import SEEDS
from dualnav_lite.figures.sheet import COLOURS, QUIET, SMALL, Sheet, Words, show_room
from dualnav_lite.traces import step_trace

TRAJECTORY_ARMS = ("ppo", "astar", "straight")
TRAJECTORY_SCENARIOS = ("pop_up", "crowd_crossing", "navigation")
SEED = SEEDS["tuning"].start + 22  # a crossing that is easy to see
TERM_COLOURS = (*COLOURS[:4], COLOURS[6])
DASHES = ("-", (0, (5, 2)), (0, (1, 1.3)), (0, (6, 2, 1, 2)), (0, (3, 1, 1, 1, 1, 1)))


def trajectories(words: Words) -> Figure:
    """Paths of three arms through the same rooms, as they stand when the first arm's run has ended."""
    sheet = Sheet(13.6, 5.6)
    handles = {}
    for k, scenario in enumerate(TRAJECTORY_SCENARIOS):
        axes = sheet.axes(0.6 + 4.4 * k, 0.5, 4.1, 4.1)
        for arm, colour, dashes in zip(TRAJECTORY_ARMS, TERM_COLOURS, DASHES, strict=False):
            trace, env = step_trace(arm, scenario, SEED)
            if arm == TRAJECTORY_ARMS[0]:
                env.trails[0] = env.trails[0][:1]  # the paths are drawn here, not by the room
                show_room(axes, env, k == 0)
                sheet.text(0.65 + 4.4 * k, 0.36, words.title(env.sim.scenarios[0]), fontweight="bold")
            # Outlines lie below every line, so that where two paths are the same both are seen.
            axes.plot(trace.x, trace.y, color="white", linewidth=4.5, zorder=2)
            (line,) = axes.plot(trace.x, trace.y, color=colour, linewidth=2.4, linestyle=dashes, label=arm, zorder=3)
            is_hit = env.task.outcomes[0].startswith("hit_")
            axes.plot(
                trace.x.iloc[-1],
                trace.y.iloc[-1],
                "X" if is_hit else "o",
                color=colour,
                markersize=11,
                mec="white",
                zorder=4,
            )
            handles[arm] = line
    sheet.figure.legend(handles=list(handles.values()), loc="lower center", ncols=3, fontsize=SMALL)
    return sheet.figure


def reward_terms(words: Words) -> Figure:
    """Weighted reward terms summed up over one crossing, with speed and clearance below."""
    trace, _ = step_trace("ppo", "crowd_crossing", SEED)
    sheet = Sheet(12.0, 6.6)
    upper, lower = sheet.axes(1.0, 0.4, 8.2, 3.0), sheet.axes(1.0, 4.1, 8.2, 1.6)
    for name, colour, dashes in zip(rewards.TERMS, TERM_COLOURS, DASHES, strict=True):
        upper.plot(trace.time_s, trace[name].cumsum(), color=colour, linestyle=dashes, linewidth=2.2, label=words(name))
    upper.set(ylabel=words("weighted reward so far"), xlim=(0, trace.time_s.max()))
    upper.set_yscale("symlog", linthresh=1.0)
    upper.yaxis.set_major_formatter("{x:g}")
    upper.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    lower.plot(trace.time_s, trace.v, color=TERM_COLOURS[0], linewidth=2.0, label=words("speed v [m/s]"))
    near = np.minimum(trace.clearance_m, 1.5)
    lower.plot(
        trace.time_s, near, color=TERM_COLOURS[1], linewidth=2.0, linestyle=DASHES[1], label=words("clearance [m]")
    )
    lower.axhline(0.0, color=QUIET, linewidth=1.0)
    lower.set(xlabel=words("time [s]"), xlim=(0, trace.time_s.max()))
    lower.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    for axes in (upper, lower):
        axes.grid(True)
    return sheet.figure
