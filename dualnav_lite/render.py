"""One world as a picture: the room, beside it what the policy sees, above it the robot's state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dualnav_lite.canvas import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILLION,
    Canvas,
    Theme,
    coloured,
    mixed,
    number,
    theme_of,
)
from dualnav_lite.encoder import BAND_EDGES, BANDS, CHANNELS, INTENSITY, read_bands
from dualnav_lite.episodes import OUTCOMES
from dualnav_lite.floorplan import COLOUR_OF_KIND, WALL_M, FloorPlan
from dualnav_lite.pedestrians import CROSSING, FORKLIFT, PEDESTRIAN, POP_UP, PUSHABLE, UNAWARE
from dualnav_lite.semantics import Surface

if TYPE_CHECKING:
    from dualnav_lite.vector_env import DynamicNavVectorEnv

WIDTH, HEIGHT = 960, 640  # [points]; a point is a pixel at the default height
ROOM_BOX = (12, 48, 574)  # left, top, side
PANEL_BOX = (600, 48, 168)  # left, top and side of the first channel
PANEL_STEP = (180, 197)  # to the next column and row
RIGHT = 948  # where the last column of text ends
MAP_OF_CHANNEL = dict(zip(CHANNELS, ("static", "signed", "signed", "intensity"), strict=True))
TITLES = {"static": "static map", "motion": "motion", "ego": "own state", "intensity": "intensity"}
LOW_CHARGE = 0.15


def draw(env: DynamicNavVectorEnv, world: int, theme: str = "light", height: int = HEIGHT) -> np.ndarray:
    """The present state of one world.

    Args:
        env: after its first reset.
        world: which of its worlds.
        theme: "light" or "dark".
        height: of the picture [pixels]; its width is 1.5 times as much.

    Returns:
        (height, width, 3) uint8 RGB.

    Raises:
        ValueError: an unknown theme.
    """
    colours = theme_of(theme)
    canvas = Canvas(WIDTH, HEIGHT, colours.page, height / HEIGHT)
    FloorPlan(canvas, env, world, colours, *ROOM_BOX).paint()
    _paint_banner(canvas, env, world, colours)
    _paint_status(canvas, env, world, colours)
    _paint_channels(canvas, env.observations[world], env, world, colours)
    return canvas.picture()


def draw_room(env: DynamicNavVectorEnv, world: int, theme: str = "light", pixels_per_m: float = 60.0) -> np.ndarray:
    """The room alone, without text; the picture's border is `floorplan.WALL_M` outside the room.

    Returns:
        (H, W, 3) uint8 RGB, y upward.
    """
    room, colours = env.sim.layouts[world].room, theme_of(theme)
    width, height = room.width + 2 * WALL_M, room.height + 2 * WALL_M
    points_per_m = ROOM_BOX[2] / (12.0 + 2 * WALL_M)  # strokes as in `draw`, where a room of 12 m fills the box
    canvas = Canvas(width * points_per_m, height * points_per_m, colours.page, pixels_per_m / points_per_m)
    FloorPlan(canvas, env, world, colours, 0.0, 0.0, max(width, height) * points_per_m, centred=False).paint()
    return canvas.picture()


def coloured_channel(channel: str, values, theme: str = "light") -> np.ndarray:
    """A channel of an observation, (64, 64), as (64, 64, 3) uint8 RGB."""
    return coloured(values, MAP_OF_CHANNEL[channel], theme)


def _paint_status(canvas: Canvas, env, world: int, colours: Theme) -> None:
    """Scenario, time and the robot's state, in columns that do not move as the numbers change."""
    sim, y = env.sim, 30
    v, omega = sim.robots.twist[world]
    charge, clearance = float(sim.robots.battery[world]), max(float(sim.clearance[world]), 0.0)
    title = sim.scenarios[world].title
    while canvas.text_width(title, 15, 700) > 270:
        title = title.rstrip("…")[:-1] + "…"
    canvas.text(12, y, title, 15, colours.ink, 700)
    texts = (
        (372, 1.0, _clock(float(sim.times_s[world]))),
        (396, 0.0, f"v {number(v)} m/s"),
        (490, 0.0, f"ω {number(omega)} rad/s"),
        (650, 0.0, f"{charge:.0%}"),
        (700, 0.0, f"clearance {clearance:.2f} m"),
        (RIGHT, 1.0, f"energy {env.journal.energy_j[world]:.0f} J"),
    )
    for x, align, text in texts:
        canvas.text(x, y, text, 13, colours.ink, 400, align)
    canvas.rectangle(601, y - 10, 40, 11, None, colours.quiet, 1.2)
    canvas.rectangle(641, y - 7, 2.5, 5, colours.quiet)
    canvas.rectangle(603, y - 8, 36 * charge, 7, GREEN if charge > LOW_CHARGE else VERMILLION)


def _clock(seconds: float) -> str:
    """Time as 12.3 s, 4:05 min or 2:59:59 h.

    >>> _clock(12.34), _clock(245.0), _clock(10799.0)
    ('12.3 s', '4:05 min', '2:59:59 h')
    """
    if seconds < 100:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d} min" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d} h"


def _paint_banner(canvas: Canvas, env, world: int, colours: Theme) -> None:
    """How a finished episode ended, or that no goal is open, over the room."""
    if env.is_done[world]:
        outcome = env.task.outcomes[world]
        text = outcome.replace("_", " ")
        colour = GREEN if OUTCOMES.get(outcome) == "survived" else VERMILLION
    elif env.task.idle[world]:
        text, colour = "no open goal", colours.quiet
    else:
        return
    left, top, side = ROOM_BOX
    middle, width = left + 0.5 * side, canvas.text_width(text, 15, 700) + 28
    canvas.rectangle(middle - 0.5 * width, top + 14, width, 28, colours.page, colour, 2.0)
    canvas.text(middle, top + 33, text, 15, colour, 700, 0.5)


def _paint_channels(canvas: Canvas, observation, env, world: int, colours: Theme) -> None:
    """The observation, robot in the middle and heading up, and the key to the room."""
    left, top, side = PANEL_BOX
    places = {"static": (0, 0), "motion": (1, 0), "intensity": (0, 1), "ego": (0, 2)}
    for values, name in zip(observation, CHANNELS, strict=False):
        column, row = places[name]
        x, y = left + column * PANEL_STEP[0], top + row * PANEL_STEP[1]
        canvas.text(x, y + 13, TITLES[name], 13, colours.ink, 600)
        _paint_scale(canvas, name, x + side, y + 13, colours)
        y += 20
        canvas.image(coloured_channel(name, values, colours.name), x, y, side, side)
        canvas.rectangle(x, y, side, side, None, colours.quiet, 0.8)
        if name == "ego":
            _paint_bands(canvas, observation, x + side, y, side, colours)
        else:
            middle = np.array([x, y]) + 0.5 * side
            nose = [[0.0, -7.0], [5.0, 6.0], [0.0, 2.5], [-5.0, 6.0]]
            canvas.polygon(middle + np.array(nose), colours.trail, colours.page, 0.8)
    column, row = (1, 1) if len(observation) > INTENSITY else (0, 1)
    _paint_key(canvas, left + column * PANEL_STEP[0], top + row * PANEL_STEP[1], env, world, colours)


def _paint_scale(canvas: Canvas, channel: str, right: float, y: float, colours: Theme) -> None:
    """Colour bar of a channel with its ends, right-aligned on a line of text."""
    low = -1 if MAP_OF_CHANNEL[channel] == "signed" else 0
    shades = coloured_channel(channel, np.linspace(low, 1, 64)[None], colours.name)
    canvas.text(right, y, "1", 11, colours.quiet, 400, 1.0)
    canvas.image(shades, right - 54, y - 9, 44, 8)
    canvas.rectangle(right - 54, y - 9, 44, 8, None, colours.quiet, 0.6)
    canvas.text(right - 58, y, number(low, ".0f"), 11, colours.quiet, 400, 1.0)


def _paint_bands(canvas: Canvas, observation, x: float, y: float, side: float, colours: Theme) -> None:
    """Name and value of each band, beside it."""
    for k, (name, value) in enumerate(zip(BANDS, read_bands(observation), strict=True)):
        middle = y + 0.5 * (BAND_EDGES[k] + BAND_EDGES[k + 1]) * side / BAND_EDGES[-1]
        canvas.line([[x, middle], [x + 6, middle]], colours.quiet)
        canvas.text(x + 12, middle + 4, name.replace("_", " "), 12, colours.ink)
        canvas.text(RIGHT, middle + 4, number(value), 12, colours.ink, 400, 1.0)


def key_to_room(env, world: int, theme: Theme) -> list[tuple[str, str, tuple]]:
    """What stands for what in the room, of those things that this episode can show: (text, symbol, colour)."""
    layout = env.sim.layouts[world]
    kinds = {plan.kind for plan in layout.movers}
    entries = [("robot", "disc", BLUE), ("goal, radius 0.4 m", "ring", GREEN)]
    entries += [("guide point and path", "path", GREEN), ("trail", "line", theme.trail)]
    entries += [("person, 1 s of walking", "person", ORANGE)] if kinds & {PEDESTRIAN, CROSSING, UNAWARE} else []
    boxes = {POP_UP: "pop-up box", PUSHABLE: "pushable box", FORKLIFT: "forklift"}
    entries += [(text, "box", COLOUR_OF_KIND[kind]) for kind, text in boxes.items() if kind in kinds]
    entries += [("phantom, lidar only", "dashes", PURPLE)] if env.sim.num_phantoms[world] else []
    entries += [("furniture", "box", theme.furniture)]
    entries += [("door jamb", "box", PURPLE)] if Surface.DOOR in layout.room.surfaces else []
    return [*entries, ("edge of the observation", "dashes", theme.quiet)]


def _paint_key(canvas: Canvas, x: float, y: float, env, world: int, colours: Theme) -> None:
    canvas.text(x, y + 13, "in the room", 13, colours.ink, 600)
    for k, (text, symbol, colour) in enumerate(key_to_room(env, world, colours)):
        middle = np.array([x + 10.0, y + 28 + 15.5 * k])
        _paint_symbol(canvas, symbol, middle, colour, colours)
        canvas.text(x + 28, middle[1] + 4, text, 12, colours.ink)


def _paint_symbol(canvas: Canvas, symbol: str, middle, colour, colours: Theme) -> None:
    ends = middle + np.array([[-9.0, 0.0], [9.0, 0.0]])
    if symbol in ("disc", "person"):
        canvas.circle(middle, 5.5, colour, colours.edge, 1.0)
        if symbol == "person":
            canvas.arrow(middle, ends[1], colours.ink, 1.4, 5.0)
    elif symbol == "ring":
        canvas.circle(middle, 5.5, mixed(colour, colours.floor, 0.75), colour, 1.6)
    elif symbol == "box":
        canvas.rectangle(middle[0] - 5, middle[1] - 5, 10, 10, colour, colours.edge, 1.0)
    elif symbol == "line":
        canvas.line(ends, colour, 2.5)
    else:
        canvas.line(ends, colour, 1.6, dash=3.0)
        if symbol == "path":
            canvas.polygon(middle + np.array([[0, -5], [5, 0], [0, 5], [-5, 0]]), colour, colours.page, 1.0)
