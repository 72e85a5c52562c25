"""Power and the best speed, what darkness does to a scan, and how long a battery lasts."""

import numpy as np
from matplotlib.figure import Figure

from dualnav_lite.config import Config, Hardware
from dualnav_lite.figures.sheet import COLOURS, SMALL, Sheet, Words, play, play_until, show_key, show_room
from dualnav_lite.kernels.drive import power as power_drawn
from dualnav_lite.kernels.scan_noise import noise_levels
from dualnav_lite.robot import drive_parameters

LIGHT = ("navigation", "low_light", "low_light_phantoms")
LIGHT_SEED, LIGHT_TIME_S = 1_000_003, 3.0
BATTERY_SEED, BATTERY_TIME_S = 1_000_001, 300.0
BATTERY_SPEEDS = (0.5, 0.8)  # [m/s]
POWER_MINUTES = 1.0
TURN_RAD_S = 0.6


def power(words: Words) -> Figure:
    """Power over speed, energy per metre over speed, and the speed that is cheapest."""
    config = Config()
    parameters, top = drive_parameters(config), config.hardware.max_lin_vel
    speeds = np.linspace(0.0, top, 401)[1:]
    sheet = Sheet(13.0, 4.9)
    left, right = sheet.axes(0.85, 0.5, 5.3, 3.6), sheet.axes(7.2, 0.5, 5.5, 3.6)
    for omega, colour, text in (
        (0.0, COLOURS[0], "driving straight"),
        (TURN_RAD_S, COLOURS[1], "turning at 0.6 rad/s"),
    ):
        watts = np.array([power_drawn(v, omega, 0.0, parameters) for v in speeds])
        joules = watts / speeds
        best = int(np.argmin(joules))
        left.plot(speeds, watts, color=colour, linewidth=2.5, label=words(text))
        right.plot(speeds, joules, color=colour, linewidth=2.5, label=words(text))
        right.plot(speeds[best], joules[best], "o", color=colour, markersize=9)
        text = words.row(f"{speeds[best]:.2f} m/s", f"{joules[best]:.0f} J/m")
        offset, side = ((20, 12), "right") if omega else ((0, -26), "center")
        right.annotate(text, (speeds[best], joules[best]), offset, textcoords="offset points", ha=side)
    left.set(xlabel=words("speed v [m/s]"), ylabel=words("power [W]"), xlim=(0, top), ylim=(0, None))
    right.set(xlabel=words("speed v [m/s]"), ylabel=words("energy per metre [J/m]"), xlim=(0, top), ylim=(0, 90))
    for axes in (left, right):
        axes.grid(True)
        axes.legend(loc="upper left" if axes is left else "upper right")
    return sheet.figure


def light(words: Words) -> Figure:
    """The same room in the light, in the dark, and in the dark with phantoms; below, the formula behind it."""
    sheet = Sheet(13.4, 9.9)
    for k, name in enumerate(LIGHT):
        env = play_until(LIGHT_TIME_S, name, LIGHT_SEED)
        show_room(sheet.axes(0.6 + 4.3 * k, 0.5, 4.1, 4.6), env, k == 0)
        scenario = env.sim.scenarios[0]
        title = words.row(words.title(scenario), f"{scenario.sensing.ambient_lux:.0f} lux")
        sheet.text(0.65 + 4.3 * k, 0.36, title, fontweight="bold")
    lux = np.geomspace(1.0, 1000.0, 121)
    levels = np.array([noise_levels(value) for value in lux]) * 100.0  # metres to cm, shares to percent
    at = np.array([noise_levels(value) for value in (5.0, 300.0)]) * 100.0
    titles = ("range noise [cm]", "beams lost [%]", "ghost beams [%]", "intensity scale [%]")
    for k, text in enumerate(titles):
        axes = sheet.axes(0.7 + 3.25 * k, 6.15, 2.6, 1.8)
        axes.semilogx(lux, levels[:, k], color=COLOURS[k], linewidth=2.5)
        axes.semilogx((5.0, 300.0), at[:, k], "o", color=COLOURS[k], markersize=7)
        axes.set_title(words(text), fontsize=SMALL, fontweight="normal", loc="left")
        axes.set(xlabel=words("light [lux]"), ylim=(0, 1.12 * levels[:, k].max()))
        axes.set_xticks([1, 10, 100, 1000], ["1", "10", "100", "1000"])
        axes.minorticks_off()
        axes.grid(True)
    show_key(sheet, env, words, 4)
    return sheet.figure


def battery(words: Words) -> Figure:
    """Five minutes of a long run: the room, the power drawn, and the charge at two speeds."""
    config = Config()
    sheet = Sheet(13.4, 7.2)
    upper, lower = sheet.axes(7.4, 0.6, 5.7, 2.1), sheet.axes(7.4, 3.75, 5.7, 2.1)
    for speed, colour in zip(BATTERY_SPEEDS, COLOURS, strict=False):
        limited = config.model_copy(update={"hardware": Hardware(max_lin_vel=speed)})
        run = play("battery", BATTERY_SEED, limited)
        seconds, joules, charge = [], [], []
        for env in run:
            seconds.append(env.sim.times_s[0])
            joules.append(env.sim.robots.energy_j[0])
            charge.append(100.0 * env.sim.robots.battery[0])
            if seconds[-1] >= BATTERY_TIME_S - 1e-9:
                break
        minutes, watts = np.array(seconds) / 60.0, np.array(joules) / config.control_dt_s
        shown = slice(1, 2 + round(60.0 * POWER_MINUTES / config.control_dt_s))
        upper.step(minutes[shown], watts[shown], color=colour, linewidth=1.8, label=f"{speed} m/s")
        label = _forecast(words, speed, seconds[-1], charge[-1], env.sim.scenarios[0].dispatcher.duration_s)
        lower.plot(minutes, charge, color=colour, linewidth=2.5, label=label)
        if speed == BATTERY_SPEEDS[-1]:
            room = env.sim.layouts[0].room
            width = 5.4 * min(1.0, (room.width + 0.28) / (room.height + 0.28))
            show_room(sheet.axes(0.65, 0.6, width, 5.4), env)
            title = words.row(words.title(env.sim.scenarios[0]), f"{minutes[-1]:.0f} min", f"{speed} m/s")
            sheet.text(0.7, 0.45, title, fontweight="bold")
            show_key(sheet, env, words, 4)
    upper.set(xlim=(0, POWER_MINUTES), ylim=(0, None), xlabel=words("time [min]"), ylabel=words("power [W]"))
    lower.set(xlim=(0, minutes[-1]), xlabel=words("time [min]"), ylabel=words("charge [%]"))
    lower.set_ylim(top=100.0)
    upper.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    lower.legend(loc="lower left")
    for axes in (upper, lower):
        axes.grid(True)
    return sheet.figure


def _forecast(words: Words, speed: float, seconds: float, charge: float, duration_s: float) -> str:
    """What would be left after the whole run if it went on as it began."""
    left = 100.0 - (100.0 - charge) * duration_s / seconds
    if left < 0.0:
        empty = duration_s / 3600.0 * 100.0 / (100.0 - left)
        return words("{speed} m/s: at this rate empty after {empty:.1f} h").format(speed=speed, empty=empty)
    hours = duration_s / 3600.0
    return words("{speed} m/s: at this rate {left:.0f} % after {hours:.0f} h").format(
        speed=speed, left=left, hours=hours
    )
