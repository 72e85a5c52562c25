"""A trained policy as files that need no training code: TorchScript and ONNX; `drivers` runs them."""

import contextlib
import io
import json
import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import nn

from dualnav_lite import __version__
from dualnav_lite.config import Config, write_atomic
from dualnav_lite.drivers import CARD, EmbeddedPolicy, runner
from dualnav_lite.policy import Actor, CommandGridHead

__all__ = ["Deployed", "EmbeddedPolicy", "card_of", "export"]

MOST_BYTES = 8_000_000  # article 3.3
PARITY = 1e-5


class Deployed(nn.Module):
    """What is exported: probabilities of the command grid, or of a Gaussian head its mean command."""

    def __init__(self, actor: Actor):
        super().__init__()
        self.actor = actor

    def forward(self, state):
        """(n, commands) probabilities, or (n, 2) commands, of (n, C, 64, 64) observations."""
        parameters = self.actor(state)
        if isinstance(self.actor.head, CommandGridHead):
            return parameters.exp()
        return self.actor.head.physical(parameters.chunk(2, dim=1)[0])


def card_of(actor: Actor, config: Config, memory: float, training_seed: int | None = None, **more) -> dict[str, Any]:
    """What a driver must know besides the weights; travels inside the exported files.

    Args:
        actor: with either head.
        config: the one it was trained with; its observation and guide must be those it is run with.
        memory: of the `CommandReader`.
        training_seed: for the tables.
        more: further entries (steps, hours, ...).
    """
    grid = None
    if isinstance(actor.head, CommandGridHead):
        commands = actor.head.commands.reshape(*actor.head.grid_shape, 2)
        grid = np.round(commands.double().numpy(), 6).tolist()
    return {
        "kit_version": __version__,
        "training_seed": training_seed,
        "observation": config.observation.model_dump(mode="json"),
        "guide": config.guide.model_dump(mode="json"),
        "grid": grid,  # None: the output is a command
        "memory": memory,
        **more,
    }


def export(actor: Actor, card: Mapping[str, Any], folder: str | Path, name: str = "ppo_actor") -> dict[str, Path]:
    """Write `<name>.pth` (weights), `<name>.pt` (TorchScript) and `<name>.onnx`, and check that they agree.

    Args:
        actor: the policy.
        card: from `card_of`.
        folder: where to.
        name: file name without its ending.

    Returns:
        Path of each file by its ending.

    Raises:
        UnusableInput: the folder refuses.
        RuntimeError: exports that differ by more than 1e-5, or a file of 8 MB and more.
    """
    model = Deployed(actor).eval()
    example = torch.rand(2, 4 if card["observation"]["intensity"] else 3, 64, 64)
    with torch.no_grad():
        contents = {
            "pth": _weights(actor),
            "pt": _torch_script(model, example, card),
            "onnx": _onnx(model, example, card),
        }
        expected = model(example).numpy()
    for ending in ("pt", "onnx"):
        off = float(np.abs(runner(contents[ending], ending)[0](example.numpy()) - expected).max())
        if not off <= PARITY:
            raise RuntimeError(f"{name}.{ending}: its output is off by {off:.1e}, at most {PARITY:.0e} is allowed")
    paths = {}
    for ending, content in contents.items():
        if len(content) >= MOST_BYTES:
            raise RuntimeError(f"{name}.{ending} has {len(content)} bytes, must stay below {MOST_BYTES}")
        paths[ending] = Path(folder) / f"{name}.{ending}"
        write_atomic(paths[ending], content)
    return paths


def _weights(actor: Actor) -> bytes:
    buffer = io.BytesIO()
    torch.save(actor.state_dict(), buffer)
    return buffer.getvalue()


def _torch_script(model: Deployed, example, card) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # TorchScript is deprecated; the article's `.pt` is still promised
        traced = torch.jit.trace(model, example)
        torch.jit.save(traced, buffer, _extra_files={CARD: json.dumps(card).encode("utf-8")})
    return buffer.getvalue()


def _onnx(model: Deployed, example, card) -> bytes:
    batch = torch.export.Dim("batch")
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)  # it reports at length that torchvision is not installed
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                model,
                (example,),
                input_names=["state"],
                output_names=["output"],
                dynamic_shapes=({0: batch},),
                dynamo=True,
            )
    finally:
        logger.setLevel(level)
    proto = program.model_proto
    for part in (*proto.graph.node, *proto.graph.input, *proto.graph.output, *proto.graph.value_info, proto.graph):
        del part.metadata_props[:]  # where in whose files each operator came from
        part.doc_string = ""
    onnx.helper.set_model_props(proto, {"card": json.dumps(card)})
    return proto.SerializeToString()
