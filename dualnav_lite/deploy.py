"""A trained policy as files that need no training code: TorchScript and ONNX, and the driver that runs them."""

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

from dualnav_lite import __version__, embedded
from dualnav_lite.config import Config, UnknownName, UnusableInput, with_overrides, write_atomic
from dualnav_lite.encoder import num_channels
from dualnav_lite.planners import make_planner
from dualnav_lite.policy import Actor, CommandGridHead
from dualnav_lite.safety import FilteredDriver

MODEL_FOLDER = Path(__file__).resolve().parent.parent / "models"
MOST_BYTES = 8_000_000  # article 3.3
PARITY = 1e-5
CARD = "card.json"


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
    channels = num_channels_of(card)
    example = torch.rand(2, channels, 64, 64)
    with torch.no_grad():
        contents = {
            "pth": _weights(actor),
            "pt": _torch_script(model, example, card),
            "onnx": _onnx(model, example, card),
        }
        expected = model(example).numpy()
    for ending in ("pt", "onnx"):
        off = float(np.abs(_runner(contents[ending], ending)[0](example.numpy()) - expected).max())
        if not off <= PARITY:
            raise RuntimeError(f"{name}.{ending}: its output is off by {off:.1e}, at most {PARITY:.0e} is allowed")
    paths = {}
    for ending, content in contents.items():
        if len(content) >= MOST_BYTES:
            raise RuntimeError(f"{name}.{ending} has {len(content)} bytes, must stay below {MOST_BYTES}")
        paths[ending] = Path(folder) / f"{name}.{ending}"
        write_atomic(paths[ending], content)
    return paths


def num_channels_of(card: Mapping[str, Any]) -> int:
    """C of the observations that the policy of this card takes."""
    return 4 if card["observation"]["intensity"] else 3


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


def _runner(content: bytes, ending: str):
    """A function from (n, C, 64, 64) float32 to the network's output, and the card inside the file."""
    if ending == "onnx":
        return embedded.onnx_runner(content)
    extra = {CARD: b""}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        script = torch.jit.load(io.BytesIO(content), map_location="cpu", _extra_files=extra)
    script.eval()

    def run(state):
        with torch.no_grad():
            return script(torch.from_numpy(state)).numpy()

    return run, json.loads(extra[CARD])


class EmbeddedPolicy(embedded.EmbeddedPolicy):
    """An exported policy that drives: the article's `EmbeddedPolicy`, and an arm of `evaluate`.

    What drives is `embedded.EmbeddedPolicy`, which needs ONNX Runtime alone; this one also reads TorchScript and checks
    that a configuration fits.

    Args:
        model_path: an exported `.onnx` or `.pt` file.
        config: the one it will be run with, to check that the observation fits; None trusts the caller.

    Raises:
        UnusableInput: a file that cannot be read or is no exported policy; a config whose observation does not fit.

    Source: article 3.3.
    """

    def __init__(self, model_path: str | Path, config: Config | None = None):
        super().__init__(model_path)
        if config is not None:
            check_fit(self.card, config, model_path)

    def _load(self, content: bytes, ending: str):
        return _runner(content, ending)

    def own_config(self, config: Config) -> Config:
        """A config with the settings that this policy was trained under: what an ablation is run with."""
        return with_overrides(config, self.card.get("overrides", {}))


def check_fit(card: Mapping[str, Any], config: Config, source: str | Path) -> None:
    """`UnusableInput` naming the first setting in which a config's observation differs from the policy's."""
    present = {"observation": config.observation.model_dump(mode="json"), "guide": config.guide.model_dump(mode="json")}
    wanted, given = (_flat({name: block[name] for name in present}) for block in (card, present))
    if card["observation"]["motion"]["method"] != "farneback":
        wanted.pop("observation.motion.component", None)  # only Farneback reads it
    for key, value in wanted.items():
        if given.get(key) != value:
            raise UnusableInput(
                f"{source}: the policy was trained with {key}: {value}, the config has {given.get(key)}; "
                f"its observation ({num_channels(config.observation)} channels) does not fit the weights"
            )


def _flat(block: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted keys of a nested dictionary."""
    found: dict[str, Any] = {}
    for name, value in block.items():
        nested = isinstance(value, Mapping)
        found.update(_flat(value, f"{prefix}{name}.") if nested else {prefix + name: value})
    return found


def trained_ablations() -> list[str]:
    """Arm ids of the ablations that are in `models/ablations`."""
    return sorted(path.stem for path in (MODEL_FOLDER / "ablations").glob("ablation_*.onnx"))


def make_driver(arm_id: str, config: Config | None = None):
    """A trained policy or a planner by its arm id: what `evaluate` is given to make its arms.

    Args:
        arm_id: `ppo` (the shipped policy), `ablation_*`, the path of an exported policy, or one of `planners.ARMS`;
            with `_filter` behind it, the same behind the safety filter.
        config: the one the worlds run with; it must fit the policy's observation. An ablation brings its own.

    Raises:
        UnusableInput: an unknown arm, a missing or unusable file, a config that does not fit.
    """
    if arm_id.endswith("_filter"):
        return FilteredDriver(make_driver(arm_id.removesuffix("_filter"), config), config or Config())
    if arm_id.endswith((".onnx", ".pt")):
        return EmbeddedPolicy(_existing(arm_id), config)
    if arm_id != "ppo" and not arm_id.startswith("ablation_"):
        return make_planner(arm_id, config)
    is_ablation = arm_id != "ppo"
    path = MODEL_FOLDER / "ablations" / f"{arm_id}.onnx" if is_ablation else MODEL_FOLDER / "ppo_actor.onnx"
    return EmbeddedPolicy(_existing(path), None if is_ablation else config)


def _existing(path: str | Path) -> Path:
    if not Path(path).exists():
        raise UnknownName(f"{path}: no such model; train one, or name another file (.onnx or .pt)")
    return Path(path)
