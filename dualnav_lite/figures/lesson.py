"""What the lessons draw with: figures that read on a light and on a dark page, films, and one driven episode."""

import base64
import io
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from PIL import Image

from dualnav_lite.config import Config
from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.evaluate import library_arm

BLUE, ORANGE, RED, GREEN, PURPLE, GREY = "#3b8fd0", "#e08a00", "#e0603a", "#22a37c", "#b877a8", "#74797f"
COLOURS = (BLUE, ORANGE, RED, GREEN, PURPLE)


def lesson_style() -> None:
    """Set matplotlib for both themes: lines of a grey dark enough for Jupyter to put a light card behind."""
    grey = {name: GREY for name in ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")}
    clear = {name: "none" for name in ("figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor")}
    shape: dict[Any, Any] = {
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": GREY,
        "grid.alpha": 0.25,
        "axes.prop_cycle": plt.cycler(color=COLOURS),
        "axes.titlesize": 11,
        "legend.frameon": False,
        "lines.linewidth": 2.0,
        "figure.constrained_layout.use": True,
        "figure.dpi": 90,
    }
    plt.rcParams.update(shape | grey | clear)


def film(pictures, milliseconds: int = 150, width: int = 720):
    """(H, W, 3) uint8 pictures as an HTML film that repeats; show it with `display`."""
    from IPython.display import HTML

    frames = []
    for picture in pictures:
        height = round(width * picture.shape[0] / picture.shape[1])
        frames.append(Image.fromarray(picture).resize((width, height)))
    file = io.BytesIO()  # WebP keeps every colour; a GIF's 256 tint the floor, in each frame another way
    exact: dict[str, Any] = {"lossless": True, "quality": 0, "method": 0}
    frames[0].save(file, "WEBP", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0, **exact)
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return HTML(f'<img src="data:image/webp;base64,{data}" alt="the run as a film">')


def photo(figure) -> np.ndarray:
    """A figure as a (H, W, 3) uint8 picture on white, for `film`; closes the figure."""
    figure.patch.set(facecolor="white")
    figure.canvas.draw()
    picture = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()
    plt.close(figure)
    return picture


def planned(arm: str, config: Config | None = None):
    """A chooser for `drive` that asks an arm: a planner, `ppo` (the policy that is shipped), or a policy's file."""
    planner = library_arm(arm, config or Config())
    planner.reset(np.arange(1))
    return lambda observation, info: planner.act(observation[None], [info])[0]


def drive(choose, scenario="navigation", seed=37, config=None, every: int = 0, steps: int = 10**9, **parts) -> dict:
    """One episode, driven by `choose(observation, info) -> (v, omega)`.

    Args:
        choose: the driver.
        scenario, seed, config: of the episode.
        every: keep a picture each so many steps; 0 for none.
        steps: end here if the episode did not end before.
        parts: `encoder`, `reward_function`, `predictor`, `truth`, as in `DynamicNavVectorEnv`.

    Returns:
        table: a row a step with time_s, clearance_m, energy_j (so far), reward and the five reward terms;
        pictures; observation and info of the last step; outcome, None where the run was cut short.
    """
    env = DynamicNavEnv(config=config, scenario=scenario, render_mode="rgb_array" if every else None, **parts)
    observation, info = env.reset(seed=seed)
    capacity, start = env.config.power.capacity_wh * 3600.0, info["battery"]
    rows: list[dict] = []
    pictures, ended = [env.render()] if every else [], False
    while not ended and len(rows) < steps:
        observation, reward, terminated, truncated, info = env.step(choose(observation, info))
        ended = terminated or truncated
        row = {"time_s": info["time_s"], "clearance_m": float(env.worlds.sim.clearance[0])}
        row |= {"energy_j": (start - info["battery"]) * capacity, "reward": reward, **info["reward_terms"]}
        rows.append(row)
        if every and (ended or len(rows) % every == 0):
            pictures.append(env.render())
    return {
        "table": pd.DataFrame(rows),
        "pictures": pictures,
        "observation": observation,
        "info": info,
        "outcome": info["summary"]["outcome"] if "summary" in info else None,
    }
