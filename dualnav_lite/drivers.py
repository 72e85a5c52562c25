"""Trained policies at the wheel, by arm id; torch is imported for TorchScript files alone."""

import io
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dualnav_lite import embedded
from dualnav_lite.chunks import ABLATION
from dualnav_lite.config import ROOT, Config, UnknownName, UnusableInput, with_overrides
from dualnav_lite.encoder import num_channels
from dualnav_lite.planners import make_planner
from dualnav_lite.safety import FilteredDriver

MODEL_FOLDER = ROOT / "models"
ABLATION_FOLDER = MODEL_FOLDER / "ablations"
CARD = "card.json"


def runner(content: bytes, ending: str):
    """A function from (n, C, 64, 64) float32 to the network's output, and the card inside the file."""
    if ending == "onnx":
        return embedded.onnx_runner(content)
    import torch

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
        return runner(content, ending)

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
    return sorted(path.stem for path in ABLATION_FOLDER.glob(f"{ABLATION}*.onnx"))


def make_driver(arm_id: str, config: Config | None = None):
    """A trained policy or a planner by its arm id: what `evaluate` is given to make its arms.

    Args:
        arm_id: `ppo` (the shipped policy), `ablation_*`, the path of an exported policy, or one of `planners.ARMS`;
            with `_filter` behind it, the same behind the safety filter. Ablations are driven as they are, whatever
            their names end in.
        config: the one the worlds run with; it must fit the policy's observation. An ablation brings its own.

    Raises:
        UnusableInput: an unknown arm, a missing or unusable file, a config that does not fit.
    """
    if arm_id.startswith(("ppo@", ABLATION)) and "@" in arm_id:
        raise UnusableInput(f"arm '{arm_id}': a trained policy has no knob; its trade-off is --preference")
    if arm_id.startswith(ABLATION):
        return EmbeddedPolicy(_existing(ABLATION_FOLDER / f"{arm_id}.onnx"))
    if arm_id.endswith("_filter"):
        return FilteredDriver(make_driver(arm_id.removesuffix("_filter"), config), config or Config())
    if arm_id.endswith((".onnx", ".pt")):
        return EmbeddedPolicy(_existing(arm_id), config)
    if arm_id == "ppo":
        return EmbeddedPolicy(_existing(MODEL_FOLDER / "ppo_actor.onnx"), config)
    return make_planner(arm_id, config)


def _existing(path: str | Path) -> Path:
    if not Path(path).exists():
        raise UnknownName(f"{path}: no such model; train one, or name another file (.onnx or .pt)")
    return Path(path)
