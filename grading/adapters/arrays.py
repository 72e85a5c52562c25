"""What adapters share: the student's function, copies for it to have, plain numbers from what it returns."""

import numpy as np


class NotDefined(Exception):
    """The notebook defines no such name: its cell raised, or names its function otherwise."""


def theirs(names, word: str):
    """The student's function."""
    if word not in names:
        raise NotDefined
    return names[word]


def numbers(value) -> np.ndarray:
    """float64 of whatever came back; an object that only pretends to be a number raises here or is converted."""
    return np.array(value, dtype=np.float64, subok=False)


def each(function, *columns) -> np.ndarray:
    """A function called with plain Python numbers, row by row."""
    return np.array([float(function(*(value.item() for value in row))) for row in zip(*columns, strict=True)])


def tensor(value):
    """A copy for torch."""
    import torch

    return torch.from_numpy(value.copy())
