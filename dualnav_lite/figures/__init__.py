"""Figures for the README, the notebooks and a thesis, in English or Chinese; the only place that knows matplotlib."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib import font_manager
from matplotlib.figure import Figure
from tqdm import tqdm

from dualnav_lite.config import UnusableInput
from dualnav_lite.figures import curves, scenes
from dualnav_lite.figures.sheet import DPI, Words
from dualnav_lite.scenario import all_scenarios

__all__ = ["CHINESE_FONTS", "FORMATS", "LANGUAGES", "all_figures", "make_figures"]

LANGUAGES = ("en", "zh")
FORMATS = ("png", "svg", "pdf")
CHINESE_FONTS = (
    "Noto Sans CJK SC", "Noto Sans SC", "Source Han Sans SC", "Microsoft YaHei", "SimHei", "PingFang SC", "Heiti SC",
)  # fmt: skip
STYLE: dict[Any, Any] = {
    "font.size": 14.5,
    "axes.titlesize": 14.5,
    "axes.titleweight": "bold",
    "axes.labelsize": 14.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#6e7278",
    "xtick.labelsize": 13.5,
    "ytick.labelsize": 13.5,
    "legend.fontsize": 13.5,
    "xtick.color": "#6e7278",
    "ytick.color": "#6e7278",
    "text.color": "#1c1e22",
    "axes.labelcolor": "#1c1e22",
    "grid.color": "#e4e4e0",
    "legend.frameon": False,
    "svg.hashsalt": "dualnav-lite",  # the same bytes every time
    "pdf.fonttype": 42,  # text stays text
}


def all_figures() -> dict[str, Callable[[Words], Figure]]:
    """How to make each figure, by name: `overview`, one for every scenario and variant, and the curves."""
    made: dict[str, Callable[[Words], Figure]] = {"overview": scenes.overview}
    for name, scenario in all_scenarios().items():
        made[name] = curves.battery if scenario.dispatcher else scenes.moments(name)
    return made | {"lidar": scenes.lidar, "light": curves.light, "power": curves.power}


def chinese_font() -> str:
    """The first Chinese font found here.

    Raises:
        UnusableInput: none is installed; says which would do.
    """
    known = {font.name for font in font_manager.fontManager.ttflist}
    for name in CHINESE_FONTS:
        if name in known:
            return name
    raise UnusableInput(
        f"figures in Chinese need one of these fonts, none is installed: {', '.join(CHINESE_FONTS)} "
        "(Debian and Ubuntu: apt-get install fonts-noto-cjk)"
    )


def style_of(lang: str) -> dict[Any, Any]:
    """matplotlib's settings for figures in one language; `UnusableInput` where its font is missing."""
    return STYLE | ({"font.family": [chinese_font(), "DejaVu Sans"]} if lang == "zh" else {})


def make_figures(
    out: Path,
    lang: str = "en",
    names: list[str] | None = None,
    progress: bool = True,
    formats: tuple[str, ...] = ("png",),
) -> list[Path]:
    """Draw figures into a folder, each as `<name>.<format>`; Chinese ones as `<name>.zh.<format>`.

    Args:
        out: folder, made if it is missing.
        lang: "en" or "zh".
        names: figures wanted, of `all_figures`; None for all of them.
        progress: show a bar.
        formats: of `FORMATS`.

    Returns:
        The files written.

    Raises:
        UnusableInput: an unknown name, language or format, a missing font, a folder that cannot be written.
    """
    known = all_figures()
    wanted = list(known) if names is None else list(names)
    _check(wanted, known, "figure")
    _check([lang], LANGUAGES, "language")
    _check(formats, FORMATS, "format")
    written = []
    with matplotlib.rc_context(style_of(lang)):
        for name in tqdm(wanted, desc="figures", disable=not progress):
            figure = known[name](Words(lang))
            for kind in formats:
                written.append(_save(figure, Path(out), f"{name}{'.zh' if lang == 'zh' else ''}.{kind}", kind))
    return written


def _check(asked, known, what: str) -> None:
    for name in asked:
        if name not in known:
            raise UnusableInput(f"unknown {what} '{name}'; known: {', '.join(known)}")


def _save(figure: Figure, folder: Path, file: str, kind: str) -> Path:
    # No date and no version: the same figure is the same file.
    options: dict[str, dict[str, Any]] = {
        "png": {"metadata": {"Software": None}, "pil_kwargs": {"optimize": True}},
        "svg": {"metadata": {"Date": None}},
        "pdf": {"metadata": {"CreationDate": None, "Producer": None}},
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(folder / file, dpi=DPI, facecolor="white", **options[kind])
    except OSError as error:
        raise UnusableInput(f"{folder / file}: cannot be written: {error.strerror}") from None
    return folder / file
