"""What a student moves by hand: a robot, and sliders for the numbers of a drawing.

Where no widgets show (no `ipywidgets`, a printed notebook), the same is done by code: by `HandDriver.go` and by a call
of the drawing function.
"""

import time
from collections.abc import Callable

import numpy as np
from IPython.display import clear_output, display

from dualnav_lite.config import Config
from dualnav_lite.env import DynamicNavEnv

STEPS_A_PICTURE = 2  # of 0.1 s each
NO_WIDGETS = "no sliders here (pip install ipywidgets): change the numbers in the code instead"


def widgets():
    """The module `ipywidgets`, or None where it is not installed."""
    try:
        import ipywidgets
    except ImportError:
        return None
    return ipywidgets


def _show(box) -> None:
    if box is None:
        print(NO_WIDGETS)
    else:
        display(box)


class HandDriver:
    """One episode that somebody drives: by `go`, or by the sliders and buttons of `panel`.

    Args:
        scenario, seed, config: of the episode.
        pace_s: seconds that the panel shows each picture, so that it looks like driving.
    """

    def __init__(self, scenario="navigation", seed: int = 37, config: Config | None = None, pace_s: float = 0.1):
        self._env = DynamicNavEnv(config=config, scenario=scenario, render_mode="rgb_array")
        self._seed, self._pace_s = seed, pace_s
        self.again()

    def again(self) -> None:
        """Back to the start."""
        _, info = self._env.reset(seed=self._seed)
        self._full = info["battery"]
        self.time_s, self.clearance_m, self.energy_j, self.outcome = 0.0, np.inf, 0.0, ""

    def go(self, v: float, omega: float, seconds: float, watch: Callable[[], None] | None = None) -> "HandDriver":
        """Drive on with v [m/s] and omega [rad/s] until the time is up or the episode ends; itself, to chain.

        Args:
            watch: called every few steps and at the end.
        """
        capacity_j = self._env.config.power.capacity_wh * 3600.0
        for step in range(round(seconds / self._env.config.control_dt_s)):
            if self.outcome:
                break
            _, _, _, _, info = self._env.step([v, omega])
            self.time_s = info["time_s"]
            self.clearance_m = min(self.clearance_m, max(0.0, float(self._env.worlds.sim.clearance[0])))
            self.energy_j = (self._full - info["battery"]) * capacity_j
            self.outcome = info["summary"]["outcome"] if "summary" in info else ""
            if watch and (self.outcome or step % STEPS_A_PICTURE == 0):
                watch()
        if watch:
            watch()
        return self

    @property
    def point(self) -> tuple[float, float]:
        """Least clearance [m] and energy [J] so far: both objectives."""
        return self.clearance_m, self.energy_j

    def picture(self) -> np.ndarray:
        """(H, W, 3) uint8, the room and what a policy would see."""
        return self._env.render()

    def words(self) -> str:
        """How it stands, in one line."""
        least = f"{self.clearance_m:.2f} m" if np.isfinite(self.clearance_m) else "-"
        state = self.outcome or "not there yet"
        return f"{state} after {self.time_s:.1f} s: safe distance {least}, energy {self.energy_j:.0f} J"

    def panel(self) -> None:
        """Show the sliders, the buttons and the picture; a line in place of them where there are no widgets."""
        _show(self.controls())

    def controls(self):
        """The widgets of `panel`, or None where there are none."""
        ipywidgets = widgets()
        if ipywidgets is None:
            return None
        limits = self._env.config.hardware
        wide = {"style": {"description_width": "8em"}, "layout": {"width": "26em"}}
        v = ipywidgets.FloatSlider(0.5, min=0.0, max=limits.max_lin_vel, step=0.05, description="v [m/s]", **wide)
        omega = ipywidgets.FloatSlider(
            0.0, min=-limits.max_ang_vel, max=limits.max_ang_vel, step=0.1, description="omega [rad/s]", **wide
        )
        image = ipywidgets.Image(value=png(self.picture()), format="png", layout={"max_width": "840px"})
        line = ipywidgets.Label(self.words())

        def show():
            image.value, line.value = png(self.picture()), self.words()
            time.sleep(self._pace_s)

        buttons = []
        for seconds in (0.5, 2.0):
            button = ipywidgets.Button(description=f"drive {seconds} s", button_style="primary")
            button.on_click(lambda _, seconds=seconds: self.go(v.value, omega.value, seconds, show))
            buttons.append(button)
        start = ipywidgets.Button(description="from the start")
        start.on_click(lambda _: (self.again(), show()))
        row = ipywidgets.HBox([*buttons, start])
        return ipywidgets.VBox([ipywidgets.HBox([v, omega]), row, line, image])


def png(picture: np.ndarray) -> bytes:
    """A (H, W, 3) uint8 picture as the bytes of a PNG."""
    import cv2

    return cv2.imencode(".png", picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes()


def sliders(draw: Callable, **ranges: tuple[float, float, float, float]) -> None:
    """Show a slider for each argument of a drawing function, which draws below them when one is let go.

    Args:
        draw: takes numbers by name and shows a figure.
        ranges: least, most, step and first value of each.
    """
    _show(slider_box(draw, **ranges))


def slider_box(draw: Callable, **ranges: tuple[float, float, float, float]):
    """The widgets of `sliders`, or None where there are none."""
    ipywidgets = widgets()
    if ipywidgets is None:
        return None
    made = {
        name: ipywidgets.FloatSlider(
            first,
            min=least,
            max=most,
            step=step,
            description=name.replace("_", " "),
            continuous_update=False,
            style={"description_width": "8em"},
            layout={"width": "30em"},
        )
        for name, (least, most, step, first) in ranges.items()
    }
    page = ipywidgets.Output()

    def draw_anew(_):
        with page:
            clear_output(wait=True)
            draw(**{name: slider.value for name, slider in made.items()})

    for slider in made.values():
        slider.observe(draw_anew, "value")
    return ipywidgets.VBox([*made.values(), page])
