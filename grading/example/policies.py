"""Tiny exported policies that know nothing, made without torch."""

import json

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from dualnav_lite.encoder import BAND_ROWS, BANDS, EGO

CHANNELS = 4
CARD = {"observation": {"intensity": True}, "grid": None, "memory": 0.0}


def constant_policy(v: float, omega: float, training_seed: int = 0) -> bytes:
    """An `.onnx` file that commands the same whatever it sees.

    Args:
        v: [m/s]; omega: [rad/s].
        training_seed: of its card; two seeds give two files.
    """
    # One row a world: the batch's size comes from the observation itself.
    nodes = [
        helper.make_node("ReduceMean", ["state", "axes"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Unsqueeze", ["nothing", "last"], ["column"]),
        helper.make_node("Add", ["column", "command"], ["output"]),
    ]
    constants = {
        "axes": np.array([1, 2, 3], np.int64),
        "zero": np.zeros(1, np.float32),
        "last": np.array([1], np.int64),
        "command": np.array([[v, omega]], np.float32),
    }
    return _exported(nodes, constants, {"training_seed": training_seed})


def follows_the_guide(speed: float = 0.4) -> bytes:
    """An `.onnx` file that turns towards the guide point and drives the faster, the more it lies ahead.

    Args:
        speed: [m/s] where the guide point lies straight ahead.
    """
    rows = np.array([BAND_ROWS[BANDS.index(name)] for name in ("guide_cos", "guide_sin")], np.int64)
    nodes = [
        helper.make_node("Gather", ["state", "channel"], ["ego"], axis=1),
        helper.make_node("Gather", ["ego", "rows"], ["bands"], axis=1),
        helper.make_node("Gather", ["bands", "first"], ["cos_sin"], axis=2),
        helper.make_node("Mul", ["cos_sin", "gains"], ["wanted"]),
        helper.make_node("Max", ["wanted", "least"], ["output"]),
    ]
    constants = {
        "channel": np.array(EGO, np.int64),
        "rows": rows,
        "first": np.array(0, np.int64),
        "gains": np.array([[speed, 1.2]], np.float32),
        "least": np.array([[0.0, -1.2]], np.float32),  # it never drives backwards
    }
    return _exported(nodes, constants)


def _exported(nodes, constants: dict[str, np.ndarray], more: dict | None = None) -> bytes:
    graph = helper.make_graph(
        nodes,
        "example",
        [helper.make_tensor_value_info("state", TensorProto.FLOAT, ["batch", CHANNELS, 64, 64])],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, ["batch", 2])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    onnx.helper.set_model_props(model, {"card": json.dumps(CARD | (more or {}))})
    return model.SerializeToString()


def standing_still() -> bytes:
    """A policy that never moves: it survives no journey."""
    return constant_policy(0.0, 0.0)
