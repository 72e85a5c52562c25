"""What every figure is made of: words in two languages, places in inches, rooms, channels and the key to them."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualnav_lite.canvas import theme_of
from dualnav_lite.config import Config
from dualnav_lite.encoder import BAND_EDGES, BANDS, CHANNELS
from dualnav_lite.figures.chinese import CHINESE
from dualnav_lite.floorplan import VIEW_M, WALL_M
from dualnav_lite.render import coloured_channel, draw_room, key_to_room
from dualnav_lite.scenario import Scenario
from dualnav_lite.traces import drive
from dualnav_lite.vector_env import DynamicNavVectorEnv

DPI = 120
PIXELS_PER_M = 72.0
SMALL = 13.5  # points; read at half the size in a README
QUIET = "#6e7278"
LEGEND_COLUMNS = 5
# Okabe and Ito's palette: told apart with every common colour blindness; markers differ as well, for print in grey.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c8c8c")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")


Read = Callable[[str], pd.DataFrame]  # from a table's name to its rows


class Words:
    """Texts in one language.

    >>> Words("en")("time [s]"), Words("zh")("time [s]")
    ('time [s]', '时间 [s]')
    """

    def __init__(self, language: str):
        self.language = language

    def __call__(self, english: str) -> str:
        """The text, which is written in English in the code; `KeyError` where its translation is missing."""
        return english if self.language == "en" else CHINESE[english]

    def row(self, *parts: str) -> str:
        """Texts one after another, separated as the language does."""
        return (", " if self.language == "en" else "，").join(parts)  # noqa: RUF001

    def title(self, scenario: Scenario) -> str:
        """Name of a scenario."""
        return scenario.title if self.language == "en" else scenario.title_zh


class Sheet:
    """A white page with places in inches from its top left corner."""

    def __init__(self, width: float, height: float):
        self.figure = Figure(figsize=(width, height))
        self._size = width, height

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """New axes in a rectangle."""
        page_width, page_height = self._size
        bottom = page_height - top - height
        place = (left / page_width, bottom / page_height, width / page_width, height / page_height)
        return self.figure.add_axes(place)

    def text(self, left: float, top: float, text: str, **style) -> None:
        """A text whose baseline is at `top`."""
        self.figure.text(left / self._size[0], 1.0 - top / self._size[1], text, **style)


def play(scenario: str | Scenario, seed: int, config: Config | None = None) -> Iterator:
    """The environment of one episode at its start and after each step, driven by the ceiling, until it ends."""
    return (env for env, _ in drive("ceiling", scenario, seed, "rgb_array", config))


def play_until(time_s: float, scenario: str | Scenario, seed: int, config: Config | None = None) -> DynamicNavVectorEnv:
    """The environment of an episode some time after its start, or at its end where that comes first."""
    for env in play(scenario, seed, config):
        if env.sim.times_s[0] >= time_s - 1e-9:
            break
    return env


def show_room(axes: Axes, env: DynamicNavVectorEnv, is_first: bool = True) -> None:
    """The room as it is now, with metres on its axes; rooms beside the first one need no second scale."""
    room = env.sim.layouts[0].room
    axes.imshow(
        draw_room(env, 0, pixels_per_m=PIXELS_PER_M),
        extent=(-WALL_M, room.width + WALL_M, -WALL_M, room.height + WALL_M),
        interpolation="antialiased",
    )
    axes.set_xticks(np.arange(0, room.width, 2))
    axes.set_yticks(np.arange(0, room.height, 2))
    axes.tick_params(length=0, labelsize=SMALL)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("x [m]", labelpad=1)
    if is_first:
        axes.set_ylabel("y [m]", labelpad=2)
    else:
        axes.set_yticks([])


def show_channel(axes: Axes, channel: str, observation, words: Words, ticks: bool = False) -> None:
    """One channel of an observation, with metres on its axes, or with the names of the bands."""
    half = 0.5 * VIEW_M
    values = observation[CHANNELS.index(channel)]
    axes.imshow(coloured_channel(channel, values), extent=(half, -half, -half, half), interpolation="nearest")
    axes.spines[:].set_visible(True)
    axes.tick_params(length=0, labelsize=SMALL)
    axes.set_xticks([])
    axes.set_yticks([])
    if channel == "ego":
        middles = half - VIEW_M * 0.5 * (BAND_EDGES[1:] + BAND_EDGES[:-1]) / BAND_EDGES[-1]
        axes.yaxis.tick_right()
        axes.set_yticks(middles, [words(name.replace("_", " ")) for name in BANDS], color="#1c1e22")
        return
    axes.plot(0.0, 0.0, marker=[(-0.8, -1), (0, 1), (0.8, -1), (0, -0.5), (-0.8, -1)], color="#0072b2", markersize=8)
    if ticks:
        axes.set_xticks([3, 0, -3])
        axes.set_yticks([-3, 0, 3])
        axes.set_xlabel(words("left [m]"), labelpad=1)
        axes.set_ylabel(words("ahead [m]"), labelpad=-4)


def show_key(sheet: Sheet, env: DynamicNavVectorEnv, words: Words, columns: int = LEGEND_COLUMNS) -> None:
    """What stands for what in the room, along the foot of the page."""

    def rgb(colour):
        return tuple(part / 255.0 for part in colour)

    looks: dict[str, dict[str, Any]] = {
        "disc": {"marker": "o", "linestyle": "", "markersize": 10, "markeredgecolor": "#303238"},
        "person": {"marker": "o", "linestyle": "", "markersize": 10, "markeredgecolor": "#303238"},
        "ring": {"marker": "o", "linestyle": "", "markersize": 11, "markerfacecolor": "#bde1d5", "mew": 2},
        "path": {"marker": "D", "linestyle": (0, (2, 1)), "markersize": 6},
        "line": {"linewidth": 3},
        "box": {"marker": "s", "linestyle": "", "markersize": 9, "markeredgecolor": "#303238"},
        "dashes": {"linestyle": (0, (2, 1))},
    }
    handles = []
    for text, symbol, colour in key_to_room(env, 0, theme_of("light")):
        handles.append(Line2D([], [], color=rgb(colour), label=words(text), **looks[symbol]))
    sheet.figure.legend(
        handles=handles, loc="lower center", ncols=columns, fontsize=SMALL, columnspacing=1.6, handletextpad=0.6
    )
