"""Counter-based random numbers inside kernels: a pure function of key and counters, so order never matters."""

import numpy as np
from numba import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@njit(cache=True)
def hash_bits(key, counter):
    """64 random bits from a uint64 key and a non-negative counter.

    Source: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), the output function at state key + counter * golden ratio.
    """
    z = np.uint64(key) + np.uint64(counter) * _GOLDEN
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@njit(cache=True)
def hash_uniform(key, counter):
    """Uniform number in [0, 1) from a uint64 key and a non-negative counter."""
    return np.float64(hash_bits(key, counter) >> _S11) * (1.0 / 9007199254740992.0)
