"""The folder for a robot's computer: complete, small, free of the simulator, and right."""

import ast
import sys

import numpy as np
import pytest

from dualnav_lite.beyond import onboard
from dualnav_lite.drivers import MODEL_FOLDER

ALLOWED = {"numpy", "cv2", "numba", "onnxruntime", "dualnav_lite"}
needs_model = pytest.mark.skipif(not (MODEL_FOLDER / "ppo_actor.onnx").exists(), reason="no policy is shipped")


def test_imports_are_followed_to_the_kernels_and_not_to_the_simulator():
    found = onboard.needed_modules()
    assert {"encoder", "embedded", "tracking", "kernels.encode", "command_reader"} <= set(found)
    assert not {"world", "env", "simulation", "policy", "planners.sampling", "deploy", "config"} & set(found)


@needs_model
def test_the_folder_is_small_and_imports_nothing_else(tmp_path):
    folder = tmp_path / "板 上"
    assert onboard.build(folder, frames=4) < 10.0  # MB
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            for top in {name.split(".")[0] for name in names}:
                assert top in ALLOWED or top in sys.stdlib_module_names, f"{path.name} imports {top}"
    log = np.load(folder / "scans.npz")
    assert log["scan"].shape == (4, 1080, 2)
    assert log["action"].shape == (4, 2)


@needs_model
def test_the_folder_alone_gives_the_commands_that_the_whole_system_gave(tmp_path):
    folder = tmp_path / "板 上"
    onboard.build(folder, frames=20)
    numbers = onboard.replay(folder)
    assert numbers["frames"] == 15
    assert numbers["most_different"] < 1e-9
    assert numbers["foreign_modules"] == 0
