"""Named random streams: one generator or hash key per consumer, so a new consumer moves no other's draws."""

import zlib

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Random generator that depends on the seed and the consumer's name alone."""
    return np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(name.encode("utf-8"))]))


def stream_key(seed: int, name: str) -> np.uint64:
    """64-bit key for the counter-based draws of `kernels.hashing`, one per seed and consumer."""
    low, high = np.random.SeedSequence([seed, zlib.crc32(name.encode("utf-8"))]).generate_state(2, np.uint32)
    return np.uint64((int(high) << 32) | int(low))
