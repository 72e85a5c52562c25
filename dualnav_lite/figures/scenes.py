"""Scenarios at three moments, the overview at the head of the README, and the lidar with what is made of it."""

from collections.abc import Callable

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from dualnav_lite.canvas import colour_map, number
from dualnav_lite.config import Config
from dualnav_lite.encoder import CHANNELS
from dualnav_lite.figures.sheet import QUIET, SMALL, Sheet, Words, play, play_until, show_channel, show_key, show_room
from dualnav_lite.geometry import beam_directions, to_world
from dualnav_lite.render import TITLES
from dualnav_lite.scenario import load_scenario

# Tuning seeds whose rooms are nearly square and whose event is easy to see.
SEEDS = {
    "navigation": 1_000_009,
    "pop_up": 1_000_004,
    "pop_up_cover": 1_000_007,
    "pop_up_head_on": 1_000_002,
    "crowd_crossing": 1_000_022,
    "crowd_reactive": 1_000_000,
    "low_light": 1_000_003,
    "low_light_phantoms": 1_000_002,
    "comms_dropout": 1_000_003,
    "comms_dropout_bursts": 1_000_009,
}
OTHER_SEED = 1_000_001  # of a scenario added since
OVERVIEW = (5.0, "crowd_crossing", 1_000_005)  # time [s], scenario, seed
LIDAR = (11.4, "navigation", 1_000_012)
MEANINGS = {
    "static": "0 free to 1 wall",
    "motion": "movers, up to 2 s ahead",
    "intensity": "strongest return of a cell",
    "ego": "ten bands",
}
BEAM_BEGINS_M = 0.3
BEFORE_S, SLIDING_S, AFTER_S, CROSSING_S = 0.4, 0.4, 2.5, 7.0  # moments round an event


def _steps_to_show(name: str, seed: int) -> tuple[list[int], list[str]]:
    """Three steps of an episode worth a picture, and what to call them."""
    events, nearest, dt = [], [], Config().control_dt_s
    for env in play(name, seed):
        movers = env.sim.movers
        gap = np.hypot(*(movers.states[0, :, :2] - env.sim.poses[0, :2]).T) - movers.radii[0]
        events.append(int(movers.events[0]))
        nearest.append(np.where(movers.active[0], gap, np.inf).min())
    last = len(events) - 1
    before, sliding, after, crossing = (round(seconds / dt) for seconds in (BEFORE_S, SLIDING_S, AFTER_S, CROSSING_S))
    scenario = load_scenario(name)
    if scenario.pop_up or scenario.crowd:
        begin = next((step for step, count in enumerate(events) if count), last // 2)
        during = begin + sliding if scenario.pop_up else begin + int(np.argmin(nearest[begin : begin + crossing]))
        steps = [max(begin - before, 0), min(during, last), min(during + after, last)]
        return steps, ["before", "during", "after"]
    return [round(0.2 * last), round(0.5 * last), round(0.85 * last)], ["start", "under way", "near the goal"]


def moments(name: str) -> Callable[[Words], Figure]:
    """The figure of a scenario: room and channels at three moments."""

    def make(words: Words) -> Figure:
        seed = SEEDS.get(name, OTHER_SEED)
        steps, labels = _steps_to_show(name, seed)
        sheet = None
        for step, env in enumerate(play(name, seed)):
            for column in np.flatnonzero(np.array(steps) == step):
                room = env.sim.layouts[0].room
                height = 4.1 * (room.height + 0.28) / (room.width + 0.28)
                sheet = sheet or Sheet(13.4, height + 3.75)
                _show_moment(sheet, env, words, words(labels[column]), 0.6 + 4.3 * column, height, column == 0)
        show_key(sheet, env, words)
        sheet.text(0.6, 0.3, words.title(load_scenario(name)), fontsize=17, fontweight="bold")
        return sheet.figure

    return make


def _show_moment(sheet: Sheet, env, words: Words, label: str, left: float, height: float, is_first: bool) -> None:
    sim = env.sim
    axes = sheet.axes(left, 0.75, 4.1, height)
    show_room(axes, env, is_first)
    sheet.text(left + 0.05, 0.66, words.row(label, f"{sim.times_s[0]:.1f} s"), fontweight="bold")
    state = f"v {number(sim.robots.twist[0, 0], '.2f')} m/s"
    if env.is_done[0]:
        state = words(env.task.outcomes[0].replace("_", " "))
    elif env.percept.map_age_s[0] > 0:
        state = f"{words('map age')} {env.percept.map_age_s[0]:.1f} s"
    sheet.text(left + 4.05, 0.66, state, ha="right", color=QUIET, fontsize=SMALL)
    shown = [name for name in CHANNELS[: len(env.observations[0])] if name != "ego"]
    for k, channel in enumerate(shown):
        axes = sheet.axes(left + 0.05 + 1.37 * k, height + 1.55, 1.27, 1.27)
        show_channel(axes, channel, env.observations[0], words)
        axes.set_title(words(TITLES[channel]), fontsize=SMALL, fontweight="normal", pad=4)


def overview(words: Words) -> Figure:
    """One moment of a crossing crowd, and what the policy sees of it."""
    env = play_until(*OVERVIEW)
    room = env.sim.layouts[0].room
    sheet = Sheet(14.0, 7.6)
    width = 5.8 * min(1.0, (room.width + 0.28) / (room.height + 0.28))
    show_room(sheet.axes(0.65, 0.5, width, 5.8), env)
    sheet.text(
        0.7, 0.34, words.row(words.title(env.sim.scenarios[0]), f"{env.sim.times_s[0]:.1f} s"), fontweight="bold"
    )
    left = 0.65 + width + 0.55
    sheet.text(left, 0.34, words("What the policy sees: four images, heading up"), fontweight="bold")
    for k, channel in enumerate(("static", "motion", "intensity", "ego")):
        axes = sheet.axes(left + 2.85 * (k % 2), 0.8 + 2.9 * (k // 2), 2.6, 2.6)
        show_channel(axes, channel, env.observations[0], words)
        axes.set_title(words(TITLES[channel]), fontsize=SMALL, fontweight="normal", pad=5, loc="left")
    show_key(sheet, env, words, 4)
    return sheet.figure


def lidar(words: Words) -> Figure:
    """One turn of the lidar in the room, as numbers, and the four channels made of it."""
    env = play_until(*LIDAR)
    room, scan, pose = env.sim.layouts[0].room, env.percept.scans[0], env.sim.poses[0]
    hit = scan[:, 1] > 0
    bearings = np.degrees(-np.pi + 2 * np.pi * np.arange(len(scan)) / len(scan))
    shades = ListedColormap(colour_map("intensity")[60:] / 255.0)
    sheet = Sheet(13.7, 9.6)
    width = 4.9 * (room.width + 0.28) / (room.height + 0.28)
    axes = sheet.axes(0.6, 0.5, width, 4.9)
    show_room(axes, env)
    axes.set_title(words("the room and every sixth beam"), loc="left")
    every = np.flatnonzero(hit)[::6]
    ends = to_world(scan[every, :1] * np.stack(beam_directions(len(scan)), axis=1)[every], pose)
    begins = pose[:2] + (ends - pose[:2]) * (BEAM_BEGINS_M / scan[every, :1])  # so that the robot stays in sight
    beams = np.stack([begins, ends], axis=1)
    axes.add_collection(
        LineCollection(beams, array=scan[every, 1], cmap=shades, clim=(0, 1), linewidths=0.7, alpha=0.7)
    )
    left = 0.6 + width + 0.9
    axes = sheet.axes(left, 0.5, 13.7 - left - 1.35, 4.9)
    dots = axes.scatter(bearings[hit], scan[hit, 0], c=scan[hit, 1], cmap=shades, vmin=0, vmax=1, s=5)
    axes.set(xlim=(180, -180), ylim=(0, 10.4), xlabel=words("bearing [°], counter-clockwise from straight ahead"))
    axes.set_xticks(range(-180, 181, 90))
    axes.set_ylabel(words("range [m]"))
    axes.axhline(env.config.lidar.range_max_m, color=QUIET, linewidth=1, linestyle=(0, (4, 3)))
    axes.text(175, 10.05, words("longest range"), color=QUIET, fontsize=SMALL, va="bottom")
    axes.set_title(words("one turn of the lidar: 1080 beams"), loc="left")
    sheet.figure.colorbar(dots, cax=sheet.axes(13.7 - 1.15, 0.5, 0.18, 4.9), label=words("intensity"))
    for k, channel in enumerate(MEANINGS):
        axes = sheet.axes(0.75 + 3.05 * k, 6.55, 2.4, 2.4)
        show_channel(axes, channel, env.observations[0], words, ticks=True)
        text = f"{words(TITLES[channel])}\n{words(MEANINGS[channel])}"
        axes.set_title(text, fontsize=SMALL, fontweight="normal", loc="left", pad=5)
    return sheet.figure
