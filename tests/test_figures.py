"""Figures come out in both languages, the same every time, with nothing over anything else."""

import ast
from itertools import combinations
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

import dualnav_lite.figures as figures
from dualnav_lite.config import UnusableInput
from dualnav_lite.encoder import BANDS
from dualnav_lite.figures.chinese import CHINESE
from dualnav_lite.figures.results import RESULTS
from dualnav_lite.figures.scenes import MEANINGS
from dualnav_lite.figures.sheet import Words
from dualnav_lite.judge import REFERENCE
from dualnav_lite.render import TITLES
from dualnav_lite.scenario import all_scenarios
from dualnav_lite.semantics import CONTACT_OUTCOME

QUICK = ("overview", "lidar", "power", "pop_up")
has_chinese_font = bool(set(figures.CHINESE_FONTS) & {f.name for f in figures.font_manager.fontManager.ttflist})
needs_chinese_font = pytest.mark.skipif(not has_chinese_font, reason="no Chinese font is installed")


def made(draw_figure, language):
    """A figure with its style, and the boxes [pixels] of all texts that show."""
    style = dict(figures.STYLE)
    if language == "zh":
        style["font.family"] = [figures.chinese_font(), "DejaVu Sans"]
    with matplotlib.rc_context(style):
        figure = draw_figure(Words(language))
        canvas = FigureCanvasAgg(figure)
        drawn = {}
        draw = Text.draw
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Text, "draw", lambda self, renderer: (drawn.setdefault(self), draw(self, renderer)))
            canvas.draw()
        shown = [text for text in drawn if text.get_visible() and text.get_text().strip()]
        boxes = [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in shown]
    return figure, boxes


def assert_tidy(draw_figure, language):
    figure, boxes = made(draw_figure, language)
    page = figure.bbox
    assert len(boxes) > 10
    for text, box in boxes:
        inside = box.x0 >= -1 and box.y0 >= -1 and box.x1 <= page.x1 + 1 and box.y1 <= page.y1 + 1
        assert inside, f"'{text}' leaves the page"
    for (one, a), (other, b) in combinations(boxes, 2):
        width = min(a.x1, b.x1) - max(a.x0, b.x0)
        height = min(a.y1, b.y1) - max(a.y0, b.y0)
        # The box of a line holds room for letters like g and for accents, which neighbours may share.
        assert width < 1 or height < 0.3 * min(a.height, b.height), f"'{one}' over '{other}'"


@pytest.mark.parametrize("language", ["en", pytest.param("zh", marks=needs_chinese_font)])
@pytest.mark.parametrize("name", QUICK)
def test_no_text_lies_over_another_or_leaves_the_page(name, language):
    assert_tidy(figures.all_figures()[name], language)


@pytest.mark.parametrize("language", ["en", pytest.param("zh", marks=needs_chinese_font)])
@pytest.mark.parametrize("name", ["survival", "battery_hours", "intervention"])
def test_no_text_lies_over_another_in_a_figure_of_the_published_tables(name, language):
    def read(table):
        return pd.read_csv(REFERENCE / f"{table}.csv", encoding="utf-8")

    assert_tidy(lambda words: RESULTS[name][1](words, read), language)


def test_points_beyond_the_reference_point_are_counted_and_do_not_flatten_the_rest():
    energies = (9000, 1200, 500, 400)
    rows = [("crowd_crossing", "astar", k / 3, 0.1 * k, energy, False) for k, energy in enumerate(energies)]
    columns = ["scenario", "arm", "preference", "safe_dist_m", "energy_j_per_goal", "pareto_optimal"]
    table = pd.DataFrame(rows, columns=columns)
    (axes,) = RESULTS["fronts"][1](Words("en"), lambda name: table).axes
    assert axes.get_ylim()[1] == 1000.0
    assert [text.get_text() for text in axes.texts] == ["2 points lie above, beyond the reference point"]


@pytest.mark.slow
@pytest.mark.parametrize("language", ["en", pytest.param("zh", marks=needs_chinese_font)])
@pytest.mark.parametrize("name", sorted(set(figures.all_figures()) - set(QUICK)))
def test_no_text_lies_over_another_in_any_other_figure(name, language):
    assert_tidy(figures.all_figures()[name], language)


def test_every_text_in_the_code_has_its_chinese():
    used = set(BANDS) | set(TITLES.values()) | set(MEANINGS.values()) | set(CONTACT_OUTCOME.values())
    used = {text.replace("_", " ") for text in used | {"goal", "timeout", "flat_battery"}}
    for path in Path(figures.__file__).parent.glob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_words = isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "words"
            if is_words and isinstance(call.args[0], ast.Constant):
                used.add(call.args[0].value)
    assert len(used) > 30
    assert used <= set(CHINESE)


def test_the_power_figure_names_the_speed_worked_out_by_hand(tmp_path):
    # P / v = 5 / v + 8 + 20 v is least at v = sqrt(5 / 20), and is 28 J/m there.
    _, boxes = made(figures.all_figures()["power"], "en")
    assert any(text == "0.50 m/s, 28 J/m" for text, _ in boxes)


def test_files_are_the_same_every_time_in_every_format(tmp_path):
    first = figures.make_figures(tmp_path / "a", "en", ["power"], progress=False, formats=figures.FORMATS)
    again = figures.make_figures(tmp_path / "b", "en", ["power"], progress=False, formats=figures.FORMATS)
    assert [path.name for path in first] == ["power.png", "power.svg", "power.pdf"]
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    picture = cv2.imread(str(first[0]))
    assert picture.shape[1] > 1500
    assert 0.01 < (picture < 128).any(axis=2).mean() < 0.5
    assert not np.array_equal(picture, cv2.flip(picture, 1))


def test_there_is_a_figure_for_every_scenario():
    assert set(all_scenarios()) < set(figures.all_figures())
    assert {"overview", "lidar", "light", "power"} < set(figures.all_figures())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": ["powr"]}, "unknown figure 'powr'; known: overview"),
        ({"lang": "de"}, "unknown language 'de'; known: en, zh"),
        ({"names": ["power"], "formats": ("gif",)}, "unknown format 'gif'; known: png"),
    ],
)
def test_what_is_unknown_is_named_with_what_is_known(tmp_path, changes, message):
    with pytest.raises(UnusableInput, match=message):
        figures.make_figures(tmp_path, progress=False, **changes)
    assert not list(tmp_path.iterdir())


def test_without_a_chinese_font_the_missing_one_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(figures.font_manager.fontManager, "ttflist", [])
    with pytest.raises(UnusableInput, match=r"Noto Sans CJK SC.*fonts-noto-cjk"):
        figures.make_figures(tmp_path, "zh", ["power"], progress=False)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(UnusableInput, match="cannot be written"):
        figures.make_figures(tmp_path / "file" / "deep", "en", ["power"], progress=False)
