"""A trained policy on a robot: numpy and ONNX Runtime, no torch, no simulator. `onboard` packs it into a folder."""

import hashlib
import json
from pathlib import Path

import numpy as np
import onnxruntime

from dualnav_lite.command_reader import CommandReader
from dualnav_lite.config import UnusableInput


def onnx_runner(content: bytes):
    """A function from (n, C, 64, 64) float32 to the network's output, and the card inside the file."""
    options = onnxruntime.SessionOptions()
    # One thread: the same bits for every batch size and number of cores.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    card = json.loads(session.get_modelmeta().custom_metadata_map["card"])
    return (lambda state: session.run(None, {"state": state})[0]), card


class EmbeddedPolicy:
    """An exported policy that drives: the article's `EmbeddedPolicy`.

    The network gives probabilities of a grid of commands; a vote over the last steps smooths them, and the command is
    read between the points around the highest vote (`command_reader`).

    Args:
        model_path: an exported `.onnx` file.

    Raises:
        UnusableInput: a file that cannot be read or is no exported policy.

    Source: article 3.3.
    """

    needs_truth = False
    needs_full_map = False

    def __init__(self, model_path: str | Path):
        path = Path(model_path)
        try:
            content = path.read_bytes()
        except OSError as error:
            raise UnusableInput(f"{path}: cannot be read: {error.strerror}") from None
        try:
            self._run, self.card = self._load(content, path.suffix.lstrip("."))
        except Exception as error:
            first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise UnusableInput(f"{path}: not an exported policy (.onnx or .pt): {first[:120]}") from None
        self.fingerprint = hashlib.sha256(content).hexdigest()
        self.training_seed = self.card["training_seed"]
        self._shape = (4 if self.card["observation"]["intensity"] else 3, 64, 64)
        self._reader = CommandReader(self.card["grid"], self.card["memory"]) if self.card["grid"] else None

    def _load(self, content: bytes, ending: str):
        """The runner and the card of a file's content."""
        return onnx_runner(content)

    def reset(self, indices) -> None:
        """Forget the past of these worlds, as at the start of an episode."""
        if self._reader:
            self._reader.reset(indices)

    def output(self, observations) -> np.ndarray:
        """What the network says of (n, C, 64, 64) observations: (n, commands) probabilities, without the vote."""
        state = np.asarray(observations, np.float32)
        if state.ndim != 4 or state.shape[1:] != self._shape:
            raise ValueError(
                f"the policy takes observations (n, {', '.join(map(str, self._shape))}), got {state.shape}"
            )
        return self._run(state)

    def act(self, observations, infos=None) -> np.ndarray:
        """(n, 2) float64 v [m/s], omega [rad/s] for n worlds; zero, unasked, where no goal is open (`info["idle"]`)."""
        observations = np.asarray(observations)
        commands, asked = np.zeros((len(observations), 2)), np.arange(len(observations))
        if infos is not None:
            asked = np.flatnonzero([not info.get("idle", False) for info in infos])
        if len(asked):
            output = self.output(observations[asked])
            commands[asked] = self._reader(output, asked) if self._reader else output
        return commands

    def get_action(self, state) -> np.ndarray:
        """(2,) v [m/s], omega [rad/s] from a (1, C, 64, 64) array or tensor: `act` for one robot."""
        return self.act(np.asarray(state))[0]
