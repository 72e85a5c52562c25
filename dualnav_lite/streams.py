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


class EpisodeSeeds:
    """Seeds of the episodes of n worlds: the one asked for, else the next draw of the world's own stream."""

    LAST = 1_000_000  # drawn seeds are training seeds

    def __init__(self, num_envs: int):
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def next(self, world: int, asked: int | None) -> int:
        """The seed of a world's next episode; one that is asked for begins its stream anew."""
        if asked is not None:
            self._streams[world] = stream(asked, "episodes")
            return asked
        if self._streams[world] is None:
            self._streams[world] = np.random.default_rng()
        return int(self._streams[world].integers(self.LAST))


def preference_of(seed: int, asked: float | None, configured: float | str) -> float:
    """An episode's preference: the one asked for, else the configured one, else drawn by its seed."""
    if asked is not None:
        return asked
    return configured if isinstance(configured, float) else stream(seed, "preference").random()
