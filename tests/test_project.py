"""What the project says about itself is so: floors, commands, links, languages."""

import itertools
import re
import tomllib
from pathlib import Path

import pytest

from dualnav_lite.__main__ import app

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("README.md", "README.zh-CN.md")


def page(name):
    return (ROOT / name).read_text(encoding="utf-8")


def drawing(name):
    """The floors as a page draws them, lines of words, the highest first."""
    block = re.search(r"```\n(10  __main__.*?)```", page(name), re.DOTALL)[1]
    return [re.findall(r"[a-z_]+", line) for line in block.splitlines()]


def modules():
    folder = ROOT / "dualnav_lite"
    files = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    return files | {path.parent.name for path in folder.glob("*/__init__.py")}


def test_the_readme_draws_every_module_and_no_upward_import():
    lines = drawing("README.md")
    floor_of = {word: i for i, words in enumerate(lines) for word in words}
    assert modules() - set(floor_of) == set()
    layers = tomllib.loads(page("pyproject.toml"))["tool"]["importlinter"]["contracts"][0]["layers"]
    ordered = [[name.strip(" ()") for name in layer.split(":")] for layer in layers]
    floors = [[floor_of[name] for name in layer if name in modules()] for layer in ordered]
    for upper, lower in itertools.pairwise(floors):
        assert max(upper, default=0) <= min(lower, default=99)


def test_both_readmes_draw_the_same_floors():
    assert drawing(PAGES[0]) == drawing(PAGES[1])


@pytest.mark.parametrize("name", PAGES)
def test_every_command_stands_in_the_readme_and_every_link_leads_somewhere(name):
    text = page(name)
    for command in app.registered_commands:
        assert f"kit.py {command.callback.__name__}" in text, command.callback.__name__
    for target in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (ROOT / target).exists(), target


def test_kit_py_knows_every_command_of_the_library():
    known = re.search(r"usage:.*?environment that", (ROOT / "kit.py").read_text(encoding="utf-8"), re.DOTALL)[0]
    for command in app.registered_commands:
        assert re.search(rf"^  {command.callback.__name__} ", known, re.MULTILINE), command.callback.__name__


def test_no_file_names_a_folder_of_the_machine_it_was_written_on():
    suffixes = {".py", ".md", ".toml", ".txt", ".yml", ".yaml", ".ipynb", ".sh"}
    skipped = {".git", ".venv", "results", "course", "build"}
    for path in ROOT.rglob("*"):
        if path.suffix in suffixes and not skipped & set(path.relative_to(ROOT).parts) and path != Path(__file__):
            found = re.search(r"/(home|root|Users|work)/[a-z]", path.read_text(encoding="utf-8", errors="replace"))
            assert found is None, f"{path.relative_to(ROOT)}: {found}"
