"""Weights on disk: written whole, read without running code."""

import pickle
from pathlib import Path

import torch

from dualnav_lite.config import UnusableInput, write_atomic


def load_weights(path: Path):
    """Tensors of `save_weights`, without running code; through a file handle, since paths may hold any script.

    Raises:
        UnusableInput: the file cannot be read as such.
    """
    try:
        with open(path, "rb") as file:
            return torch.load(file, map_location="cpu", weights_only=True)
    except (OSError, EOFError, RuntimeError, ValueError, pickle.UnpicklingError) as error:
        raise UnusableInput(f"{path}: cannot be read as weights: {str(error).splitlines()[0][:120]}") from None


def save_weights(path: Path, state) -> None:
    """Write tensors whole or not at all."""
    write_atomic(path, lambda file: torch.save(state, file))
