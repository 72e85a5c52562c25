"""Tiny exported policies that know nothing, made without torch."""

import json

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

CHANNELS = 4


def constant_policy(v: float, omega: float, training_seed: int = 0) -> bytes:
    """An `.onnx` file that commands the same whatever it sees.

    Args:
        v: [m/s]; omega: [rad/s].
        training_seed: of its card; two seeds give two files.
    """
    shape = {"observation": {"intensity": True}, "grid": None, "memory": 0.0, "training_seed": training_seed}
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
    graph = helper.make_graph(
        nodes,
        "constant",
        [helper.make_tensor_value_info("state", TensorProto.FLOAT, ["batch", CHANNELS, 64, 64])],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, ["batch", 2])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    onnx.helper.set_model_props(model, {"card": json.dumps(shape)})
    return model.SerializeToString()


def standing_still() -> bytes:
    """A policy that never moves: it survives no journey."""
    return constant_policy(0.0, 0.0)
