"""What networks see of an observation, images and exact bands, and the trunks that turn both into features."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from dualnav_lite.encoder import BANDS, EGO, STATIC, read_bands
from dualnav_lite.kernels.raster import SIZE

HIDDEN = 256


class Grain(NamedTuple):
    """How closely a network looks at an image.

    Attributes:
        halve: whether four cells are averaged into one before anything is learned.
        convolutions: channels, kernel, stride and padding of each.
    """

    halve: bool
    convolutions: tuple[tuple[int, int, int, int], ...]


# `coarse` sees cells of 0.2 m, in windows of 1.2 m that are 0.8 m apart; `fine` cells of 0.1 m in windows of 0.5 m.
# It costs a sixth of the arithmetic, so a student's ten minutes hold several times the steps.
GRAINS = {
    "fine": Grain(False, ((16, 5, 2, 2), (32, 3, 2, 1), (32, 3, 2, 1))),
    "coarse": Grain(True, ((32, 6, 4, 1), (32, 3, 2, 1))),
}


def layer(module, gain: float = math.sqrt(2.0)):
    """The module with orthogonal weights and zero biases."""
    nn.init.orthogonal_(module.weight, gain)
    nn.init.zeros_(module.bias)
    return module


def split_observations(observations):
    """Images and bands of a batch: the ego channel holds ten numbers, so no convolution has to look for them.

    Args:
        observations: (n, C, 64, 64) tensor.

    Returns:
        (n, C - 1, 64, 64) the other channels and (n, 10) the bands, exactly as `encoder.read_bands` gives them.
    """
    images = torch.cat([observations[:, :EGO], observations[:, EGO + 1 :]], dim=1)
    return images, read_bands(observations)


@dataclass(frozen=True)
class Seen:
    """Observations as a trunk takes them, before anything learned: made once, looked at in every epoch.

    Rows are taken out as of a tensor: `seen[rows]`, `seen.split(64)`, `len(seen)`.

    Attributes:
        images: (n, H, W, C - 1), the ego channel left out, cells averaged as the grain says.
        bands: (n, 10).
    """

    images: torch.Tensor
    bands: torch.Tensor

    @classmethod
    def of(cls, images, bands, halve: bool) -> "Seen":
        """From the two parts of `split_observations`; halved, 2 x 2 cells become their mean."""
        if halve:
            rows = images[:, :, ::2] + images[:, :, 1::2]  # four times as fast as `avg_pool2d`
            images = 0.25 * (rows[..., ::2] + rows[..., 1::2])
        return cls(images.permute(0, 2, 3, 1).contiguous(), bands)

    @classmethod
    def cat(cls, parts: "Sequence[Seen]") -> "Seen":
        """All of them, in order."""
        return cls(torch.cat([part.images for part in parts]), torch.cat([part.bands for part in parts]))

    def __getitem__(self, rows) -> "Seen":
        return Seen(self.images[rows], self.bands[rows])

    def __len__(self) -> int:
        return len(self.images)

    @property
    def shape(self) -> torch.Size:
        """Of the images; the first number counts observations."""
        return self.images.shape

    def split(self, size: int) -> "list[Seen]":
        """Parts of at most this many observations."""
        pairs = zip(self.images.split(size), self.bands.split(size), strict=True)
        return [Seen(images, bands) for images, bands in pairs]

    def to(self, device) -> "Seen":
        """The same on another device."""
        return Seen(self.images.to(device), self.bands.to(device))


class SeenTrunk(nn.Module):
    """Features of an observation: something learned of the images (`of_images`), which the bands then join."""

    features, halve = HIDDEN, False

    def look(self, observations) -> Seen:
        """What this trunk takes from (n, C, 64, 64) observations."""
        images, bands = split_observations(observations)
        return Seen.of(images, bands, self.halve)

    def forward(self, observations):
        """(n, HIDDEN) features of (n, C, 64, 64) observations, or of the `Seen` of them."""
        seen = observations if isinstance(observations, Seen) else self.look(observations)
        return self.joined(torch.cat([self.of_images(seen.images), seen.bands], dim=1))


class ImageTrunk(SeenTrunk):
    """Features by convolutions, each of which shrinks the image.

    Args:
        channels: C of the observation, the ego channel included.
        grain: "fine" or "coarse" (`GRAINS`).
    """

    def __init__(self, channels: int, grain: str = "fine"):
        super().__init__()
        self.halve, convolutions = GRAINS[grain]
        layers, depth, side = [], channels - 1, SIZE // (1 + self.halve)
        for width, kernel, stride, padding in convolutions:
            layers += [layer(nn.Conv2d(depth, width, kernel, stride, padding)), nn.ReLU()]
            depth, side = width, (side + 2 * padding - kernel) // stride + 1
        self.convolutions = nn.Sequential(*layers, nn.Flatten())
        self.joined = nn.Sequential(layer(nn.Linear(depth * side**2 + len(BANDS), HIDDEN)), nn.ReLU())
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def of_images(self, images):
        """(n, ...) of (n, H, W, C - 1) images."""
        return self.convolutions(images.permute(0, 3, 1, 2))  # a view in `channels_last`


class FlatTrunk(SeenTrunk):
    """Features of a flat observation (`observation.layout`), whose readings are a plain vector."""

    def __init__(self):
        super().__init__()
        self.readings = nn.Sequential(layer(nn.Linear(SIZE * SIZE, HIDDEN)), nn.ReLU())
        self.joined = nn.Sequential(layer(nn.Linear(HIDDEN + len(BANDS), HIDDEN)), nn.ReLU())

    def of_images(self, images):
        """(n, HIDDEN) of (n, H, W, C - 1) images."""
        return self.readings(images[..., STATIC].flatten(1))


class VectorTrunk(nn.Module):
    """Features of a plain vector: two layers of 64, for environments without an image."""

    features = 64

    def __init__(self, size: int):
        super().__init__()
        self.layers = nn.Sequential(layer(nn.Linear(size, 64)), nn.Tanh(), layer(nn.Linear(64, 64)), nn.Tanh())

    def look(self, observations):
        """A vector is taken as it is."""
        return observations

    def forward(self, observations):
        """(n, 64) features of (n, size) observations."""
        return self.layers(observations)


def device_of(network: nn.Module) -> torch.device:
    """Where a network's weights are."""
    return next(network.parameters()).device


def trunk_for(observation_shape: Sequence[int], grain: str = "fine") -> nn.Module:
    """The trunk that fits observations of this shape: (C, 64, 64) or (size,)."""
    shape = tuple(observation_shape)
    if len(shape) == 1:
        return VectorTrunk(shape[0])
    if len(shape) == 3 and shape[0] in (3, 4) and shape[1:] == (64, 64):
        return FlatTrunk() if grain == "flat" else ImageTrunk(shape[0], grain)
    raise ValueError(f"observations must be (size,), (3, 64, 64) or (4, 64, 64), got {shape}")


def looked(network: nn.Module, observations: np.ndarray):
    """(n, ...) float32 observations as the network's trunk takes them, on its device."""
    return network.trunk.look(torch.from_numpy(observations).to(device_of(network)))


def joined(parts: Sequence):
    """Several of what `looked` gives, as one."""
    return Seen.cat(parts) if isinstance(parts[0], Seen) else torch.cat(list(parts))
