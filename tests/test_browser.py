"""JupyterLab is started for real; lessons are opened, run and photographed: widgets, films and formulas show."""

import json
import os
import subprocess
import sys

import nbformat
import pytest

from dualnav_lite import course
from dualnav_lite.config import ROOT

pytestmark = pytest.mark.slow
browser = pytest.importorskip("tests.browser", reason="needs what jupyterlab brings: websocket-client, requests")
SETTINGS = {
    "notebook-extension/tracker": {"windowingMode": "none"},  # every cell is on the page
    "apputils-extension/notification": {"fetchNews": "false", "checkForUpdates": False},
}
PANEL = "[...window.jupyterapp.shell.widgets('main')].find(one => one.sessionContext)"
NOTEBOOK = "document.querySelector('.jp-Notebook')"


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Address and token of a JupyterLab whose folder holds the lessons, and its folder."""
    if browser.chromium() is None and not os.environ.get("DUALNAV_NO_SKIPS"):
        pytest.skip("no Chromium here (apt: chromium)")
    home = tmp_path_factory.mktemp("家 lab")
    for name, values in SETTINGS.items():
        path = home / f"lab/user-settings/@jupyterlab/{name}.jupyterlab-settings"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(values), encoding="utf-8")
    lessons = home / "课程 lessons"
    course.write_lessons(lessons)
    for name in ("00_start_here", "07_rewards"):
        (lessons / f"{name}.ipynb").write_bytes((ROOT / "notebooks" / f"{name}.ipynb").read_bytes())
    places = {"JUPYTER_CONFIG_DIR": home, "JUPYTER_RUNTIME_DIR": home / "runtime", "IPYTHONDIR": home / "ipython"}
    places |= {"JUPYTER_DATA_DIR": home / "data", "JUPYTERLAB_WORKSPACES_DIR": home / "workspaces"}
    environment = os.environ | {name: str(place) for name, place in places.items()} | {"PYTHONPATH": str(ROOT)}
    options = ["--no-browser", "--allow-root", "--port=0", f"--ServerApp.root_dir={lessons}"]
    options += ["--IdentityProvider.token=lesson", "--LabApp.expose_app_in_browser=True"]
    with open(home / "log.txt", "w", encoding="utf-8") as log:
        command = [sys.executable, "-m", "jupyterlab", *options]
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=home)
        try:

            def address():
                assert process.poll() is None, (home / "log.txt").read_text(encoding="utf-8")
                found = list((home / "runtime").glob("jpserver-*.json"))
                return found and json.loads(found[0].read_text(encoding="utf-8"))["url"]

            yield browser.wait_for(address, 120, "JupyterLab"), lessons
        finally:
            process.terminate()
            process.wait(60)


def run_all(page, lab, name):
    """Open a lesson, run all of its cells and save it; the notebook that lies on the disk then."""
    address, lessons = lab
    page.open(f"{address}lab/tree/{name}.ipynb?token=lesson&reset")
    page.call("Page.enable")
    is_there = "!!window.jupyterapp && document.querySelectorAll('.jp-Notebook .jp-CodeCell').length > 5"
    browser.wait_for(lambda: page.ask(is_there), 120, name)
    idle = f"{PANEL}?.sessionContext.session?.kernel?.status === 'idle'"
    browser.wait_for(lambda: page.ask(idle), 120, "the kernel")
    page.ask(f"window.jupyterapp.shell.activateById({PANEL}.id)")
    page.ask("window.jupyterapp.commands.execute('notebook:run-all-cells').then(() => true)")
    page.ask(f"{PANEL}.context.save().then(() => true)")
    saved = nbformat.read(lessons / f"{name}.ipynb", as_version=4)
    outputs = [output for cell in saved.cells for output in cell.get("outputs", [])]
    assert [output for output in outputs if output.output_type == "error"] == []
    assert all(cell.execution_count for cell in saved.cells if cell.cell_type == "code")
    return saved


def keep_picture(page, folder, name):
    """A photograph of the window, for whoever wants to look."""
    path = folder / f"{name}.png"
    path.write_bytes(page.picture())
    print(path)
    assert path.stat().st_size > 20_000


def test_lesson_00_runs_in_jupyterlab_its_robot_is_driven_and_its_film_moves(lab, tmp_path):
    with browser.Browser(tmp_path) as page:
        run_all(page, lab, "00_start_here")
        film = f"{NOTEBOOK}.querySelector('img[src^=\"data:image/webp\"]')"
        assert page.ask(f"{film}.naturalWidth") == 840
        clip = page.place(film)
        shown = {page.picture(clip)}
        browser.wait_for(lambda: shown.add(page.picture(clip)) or len(shown) > 2, 20, "a film that moves")
        keep_picture(page, tmp_path, "film")
        assert page.ask(f"{NOTEBOOK}.querySelectorAll('.widget-slider').length") == 2
        photo = f"{NOTEBOOK}.querySelector('.widget-image')"
        before = page.ask(f"{photo}.src")
        page.click(f"{NOTEBOOK}.querySelector('.widget-slider .noUi-base')", 0.9)  # v
        page.click(f"[...{NOTEBOOK}.querySelectorAll('button')].find(one => one.innerText === 'drive 0.5 s')")
        driven = f"{NOTEBOOK}.innerText.includes('not there yet after 0.5 s')"
        browser.wait_for(lambda: page.ask(driven), 30, "half a second of driving")
        assert page.ask(f"{photo}.src") != before
        assert page.ask(f"{photo}.naturalWidth") > 500
        page.place(photo)
        keep_picture(page, tmp_path, "panel")


def test_lesson_07_shows_formulas_and_a_slider_draws_anew(lab, tmp_path):
    with browser.Browser(tmp_path) as page:
        run_all(page, lab, "07_rewards")
        browser.wait_for(lambda: page.ask(f"{NOTEBOOK}.querySelectorAll('mjx-container').length > 5"), 60, "formulas")
        page.click(f"{NOTEBOOK}.querySelector('.widget-slider .noUi-base')", 0.85)  # preference
        drawn = f"{NOTEBOOK}.querySelector('.jp-OutputArea .widget-output img, .widget-vbox .jp-OutputArea img')"
        browser.wait_for(lambda: page.ask(f"!!{drawn} && {drawn}.naturalWidth > 300"), 30, "a new drawing")
        page.place(drawn)
        keep_picture(page, tmp_path, "slider")
