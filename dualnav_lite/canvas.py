"""A picture to draw on with OpenCV: smooth shapes, text, two themes, and colour maps for the observation's channels."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

SMOOTHING = 2  # every picture is drawn this many times larger and averaged down
_SHIFT = 4  # fractional bits of OpenCV's coordinates
_FONT = cv2.FontFace("sans")

# Okabe and Ito, "Color universal design", 2008: told apart with any kind of colour vision.
ORANGE, SKY, GREEN, YELLOW = (230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66)
WHITE = (255, 255, 255)
BLUE, VERMILLION, PURPLE = (0, 114, 178), (213, 94, 0), (204, 121, 167)


@dataclass(frozen=True)
class Theme:
    """Colours (RGB) of what is neither a thing in the room nor a value of a channel.

    Attributes:
        name: key in `THEMES`.
        page: behind everything; floor: of the room; grid: its metre lines; ink: text; quiet: lesser text and frames.
        wall, furniture, edge: solids and the outline of everything drawn on the floor.
        trail: where the robot has been; rim: outline of the robot.
    """

    name: str
    page: tuple
    floor: tuple
    grid: tuple
    ink: tuple
    quiet: tuple
    wall: tuple
    furniture: tuple
    edge: tuple
    trail: tuple
    rim: tuple


THEMES = {
    "light": Theme(
        name="light",
        page=(255, 255, 255),
        floor=(248, 248, 246),
        grid=(232, 232, 228),
        ink=(28, 30, 34),
        quiet=(110, 114, 120),
        wall=(58, 62, 70),
        furniture=(178, 176, 170),
        edge=(48, 50, 56),
        trail=BLUE,
        rim=(48, 50, 56),
    ),
    "dark": Theme(
        name="dark",
        page=(17, 19, 24),
        floor=(30, 33, 40),
        grid=(44, 48, 57),
        ink=(236, 238, 242),
        quiet=(150, 156, 166),
        wall=(168, 174, 186),
        furniture=(92, 96, 106),
        edge=(12, 13, 16),
        trail=SKY,
        rim=WHITE,
    ),
}


def theme_of(name: str) -> Theme:
    """The theme with this name; `ValueError` naming the known ones otherwise."""
    if name not in THEMES:
        raise ValueError(f"unknown theme '{name}'; known: {', '.join(THEMES)}")
    return THEMES[name]


# Corner points of each colour map in CIELAB, walked at constant speed: equal steps of a value look equally large.
# Hues differ along blue and yellow, and lightness is monotone (on each side of 0 where values are signed).
_WALKS = {
    "light": {
        "static": [(98, 0, 1), (16, 1, -7)],
        "signed": [(38, 6, -44), (97, 0, 1), (48, 48, 52)],
        "intensity": [(98, 0, 2), (80, 14, 52), (57, 52, 34), (34, 48, -22), (14, 22, -34)],
    },
    "dark": {
        "static": [(9, 0, -3), (92, 0, 3)],
        "signed": [(74, -12, -34), (11, 0, -3), (74, 26, 62)],
        "intensity": [(9, 1, -4), (26, 40, -46), (50, 62, 2), (72, 34, 56), (96, -4, 34)],
    },
}


@cache
def colour_map(name: str, theme: str = "light") -> np.ndarray:
    """(256, 3) uint8 RGB from the lowest to the highest value, read-only; `static`, `signed` or `intensity`."""
    corners = np.array(_WALKS[theme][name], float)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.linspace(0.0, reached[-1], 256)
    if name == "signed":  # 0 stays in the middle, whichever arm is longer
        at = np.interp(np.linspace(-1.0, 1.0, 256), [-1.0, 0.0, 1.0], reached)
    lab = np.stack([np.interp(at, reached, corners[:, k]) for k in range(3)], axis=-1).astype(np.float32)
    rgb = cv2.cvtColor(lab[None], cv2.COLOR_LAB2RGB)[0]
    table = np.rint(255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)
    table.setflags(write=False)
    return table


def coloured(values, name: str, theme: str = "light") -> np.ndarray:
    """(..., 3) uint8 RGB of values in [0, 1], or in [-1, 1] for the map `signed`."""
    share = 0.5 * (np.asarray(values) + 1.0) if name == "signed" else np.asarray(values)
    return colour_map(name, theme)[np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)]


def mixed(colour, other, share: float) -> tuple:
    """A colour moved towards another by a share in [0, 1]."""
    return tuple(round((1.0 - share) * a + share * b) for a, b in zip(colour, other, strict=True))


def number(value, form: str = "+.2f") -> str:
    """A number as text, with a real minus sign and without a negative zero.

    >>> number(-0.001), number(-0.5, ".1f") == "\N{MINUS SIGN}0.5"
    ('+0.00', True)
    """
    text = format(value, form)
    if float(text) == 0.0:
        text = format(0.0, form)
    return text.replace("-", "\N{MINUS SIGN}")


class Canvas:
    """An RGB picture with coordinates in points from the top left corner.

    Args:
        width, height: size [points].
        colour: background.
        zoom: pixels a point in the finished picture.
    """

    def __init__(self, width: float, height: float, colour, zoom: float = 1.0):
        self._size = round(width * zoom), round(height * zoom)
        self._scale = SMOOTHING * zoom
        shape = self._size[1] * SMOOTHING, self._size[0] * SMOOTHING, 3
        row = np.tile(np.array(colour, np.uint8), (shape[1], 1))
        self._image = np.empty(shape, np.uint8)
        self._image[:] = row  # ten times faster than one colour broadcast over all pixels

    def picture(self) -> np.ndarray:
        """(height, width, 3) uint8, a new array."""
        return cv2.resize(self._image, self._size, interpolation=cv2.INTER_AREA)

    def _fixed(self, points) -> np.ndarray:
        # OpenCV's integer coordinates mean pixel centres, hence the half.
        return np.rint((np.asarray(points, float) * self._scale - 0.5) * (1 << _SHIFT)).astype(np.int32)

    def _thick(self, width: float) -> int:
        return max(1, round(width * self._scale))

    def polygon(self, points, fill=None, edge=None, width: float = 1.0) -> None:
        """A closed polygon through (k, 2) points."""
        corners = self._fixed(points)[None]
        if fill is not None:
            cv2.fillPoly(self._image, corners, fill, cv2.LINE_AA, _SHIFT)
        if edge is not None:
            cv2.polylines(self._image, corners, True, edge, self._thick(width), cv2.LINE_AA, _SHIFT)

    def rectangle(self, x, y, width, height, fill=None, edge=None, line: float = 1.0) -> None:
        """An upright rectangle with (x, y) as its top left corner."""
        corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]]
        self.polygon(corners, fill, edge, line)

    def line(self, points, colour, width: float = 1.0, dash: float = 0.0) -> None:
        """A line through (k, 2) points; `dash` is the length of a dash and of a gap, 0 for a solid line."""
        points = np.asarray(points, float)
        if dash <= 0.0:
            cv2.polylines(
                self._image, self._fixed(points)[None], False, colour, self._thick(width), cv2.LINE_AA, _SHIFT
            )
            return
        reached = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        for begin in np.arange(0.0, reached[-1], 2.0 * dash):
            inside = points[(reached > begin) & (reached < begin + dash)]
            ends = [[np.interp(s, reached, points[:, k]) for k in range(2)] for s in (begin, begin + dash)]
            self.line(np.concatenate([ends[:1], inside, ends[1:]]), colour, width)

    def circle(self, centre, radius: float, fill=None, edge=None, width: float = 1.0) -> None:
        """A circle round (2,) `centre`."""
        x, y = self._fixed(centre).tolist()
        r = round(radius * self._scale * (1 << _SHIFT))
        if fill is not None:
            cv2.circle(self._image, (x, y), r, fill, -1, cv2.LINE_AA, _SHIFT)
        if edge is not None:
            cv2.circle(self._image, (x, y), r, edge, self._thick(width), cv2.LINE_AA, _SHIFT)

    def arrow(self, begin, end, colour, width: float = 1.5, head: float = 6.0) -> None:
        """A line with a filled head at its end; nothing where it is shorter than a point."""
        begin, end = np.asarray(begin, float), np.asarray(end, float)
        length = float(np.hypot(*(end - begin)))
        if length < 1.0:
            return
        along = (end - begin) / length
        across = np.array([-along[1], along[0]])
        head = min(head, 0.8 * length)
        neck = end - head * along
        self.line([begin, neck], colour, width)
        self.polygon([end, neck + 0.45 * head * across, neck - 0.45 * head * across], colour, colour, 0.5)

    def dots(self, points, colours, radius: float, opacity: float) -> None:
        """Many small discs at once, let through to what lies below; (k, 2) points and (k, 3) colours."""
        if not len(points):
            return
        low, high = np.asarray(points).min(axis=0) - radius - 1.0, np.asarray(points).max(axis=0) + radius + 1.0
        left, top = np.maximum(np.floor(low * self._scale), 0).astype(int)
        right, bottom = np.ceil(high * self._scale).astype(int)
        part = self._image[top:bottom, left:right]
        below = part.copy()
        r = max(1, round(radius * self._scale * (1 << _SHIFT)))
        for (x, y), colour in zip(self._fixed(points).tolist(), colours.tolist(), strict=True):
            cv2.circle(self._image, (x, y), r, colour, -1, cv2.LINE_AA, _SHIFT)
        part[:] = cv2.addWeighted(part, opacity, below, 1.0 - opacity, 0.0)

    def image(self, pixels, x: float, y: float, width: float, height: float) -> None:
        """An RGB image stretched to a rectangle, its cells kept sharp."""
        left, top = round(x * self._scale), round(y * self._scale)
        right, bottom = round((x + width) * self._scale), round((y + height) * self._scale)
        stretched = cv2.resize(pixels, (right - left, bottom - top), interpolation=cv2.INTER_NEAREST)
        self._image[top:bottom, left:right] = stretched

    def text_width(self, text: str, size: float, weight: int = 400) -> float:
        """How long a text would be [points]."""
        return cv2.getTextSize((0, 0), text, (0, 0), _FONT, round(size * self._scale), weight)[2] / self._scale

    def text(self, x: float, y: float, text: str, size: float, colour, weight: int = 400, align: float = 0.0) -> None:
        """One line of text whose baseline is at y and which starts (`align` 0), centres (0.5) or ends (1) at x."""
        x -= align * self.text_width(text, size, weight)
        place = round(x * self._scale), round(y * self._scale)
        cv2.putText(self._image, text, place, colour, _FONT, round(size * self._scale), weight)
