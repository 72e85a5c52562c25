"""The examples in docstrings come out as they say."""

import doctest
import importlib

import pytest

from dualnav_lite.config import ROOT

FILES = [path for folder in ("dualnav_lite", "grading") for path in sorted((ROOT / folder).rglob("*.py"))]
NAMES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in FILES
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", NAMES)
def test_an_example_comes_out_as_its_docstring_says(name):
    if name.startswith("grading"):
        pytest.importorskip("fcntl")  # grading runs on Linux
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted > 0
    assert found.failed == 0
