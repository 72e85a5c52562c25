"""What a real sensor makes of a clean scan: range noise, drop-outs, ghosts, intensity, and the front end's labels."""

import math

import numpy as np
from numba import njit

from dualnav_lite.kernels.hashing import hash_uniform

# Noise is read from tables drawn once, from a hashed offset on: drawing 1080 normals takes longer than the cast.
# The tables are exact where a draw is not: mean 0 and variance 1; every share present once.
TABLE_SIZE = 1 << 16


def _noise_tables():
    """Standard normals and uniforms in random order, (TABLE_SIZE,) float32 each, always the same."""
    rng = np.random.default_rng(20240607)
    normal = rng.standard_normal(TABLE_SIZE)
    uniform = (rng.permutation(TABLE_SIZE) + 0.5) / TABLE_SIZE
    return ((normal - normal.mean()) / normal.std()).astype(np.float32), uniform.astype(np.float32)


NORMAL, UNIFORM = _noise_tables()

BRIGHT_LUX = 300.0  # an office; nothing gets better above it
INTENSITY_SIGMA = 0.01
GHOST_TRIALS = 16  # chances for a ghost burst in a turn
GHOST_SHORTEST, GHOST_LONGEST = 3, 8  # beams in a burst
GHOST_INTENSITY = (0.01, 0.07)
_DRAWS = 64  # counters reserved for a turn: 4 starts in the tables, 3 for each ghost trial


@njit(cache=True)
def noise_levels(ambient_lux):
    """Range sigma [m], drop-out share, ghost share and intensity scale at an ambient light; the one formula.

    With darkness q = 1 - log10(lux) / log10(300), held in [0, 1]: sigma 0.01 + 0.042 q, drop-outs 0.005 + 0.20 q,
    ghosts 0.001 + 0.01 q, scale 1 - 0.557 q. At 5 lux: 4 cm, 15 %, 0.8 %, 0.6.

    A lidar brings its own light, so this is not physics: low light stands for a low signal-to-noise ratio
    (article, section 4.4, reads it literally).
    """
    q = 1.0 - math.log10(max(ambient_lux, 1.0)) / math.log10(BRIGHT_LUX)
    q = min(max(q, 0.0), 1.0)
    return 0.01 + 0.042 * q, 0.005 + 0.20 * q, 0.001 + 0.01 * q, 1.0 - 0.557 * q


@njit(cache=True)
def path_loss(distance):
    """How many times weaker a return is than from 1 m: 1 up to there, 5 at 10 m. Its inverse is the range law."""
    beyond = max(distance - 1.0, 0.0) / 9.0
    return 1.0 + 4.0 * beyond * beyond


@njit(cache=True)
def _table_window(key, counter, length):
    """Start of a window of the given length in a noise table."""
    return int(hash_uniform(key, counter) * (TABLE_SIZE - length + 1))


@njit(cache=True)
def _add_ghosts(ranges, uniform, share, key, counter, range_min, label, scan, labels):
    """Bursts of neighbouring faint returns from nothing, each at one random range, in front of what is there.

    Args:
        ranges: (beams,) clean ranges of one world.
        uniform: at least (beams,) uniform numbers, one a beam.
        share: expected share of beams in bursts; each of GHOST_TRIALS chances makes one burst or none.
        key, counter: of the draws, three a chance.
        scan, labels: (beams, 2), (beams,) changed in place.
    """
    beams = len(ranges)
    weakest, strongest = GHOST_INTENSITY
    chance = share * beams / (GHOST_TRIALS * 0.5 * (GHOST_SHORTEST + GHOST_LONGEST))
    for trial in range(GHOST_TRIALS):
        drawn = hash_uniform(key, counter + 3 * trial) / chance
        if drawn >= 1.0:
            continue
        length = GHOST_SHORTEST + int(drawn * (GHOST_LONGEST - GHOST_SHORTEST + 1))
        first = int(hash_uniform(key, counter + 3 * trial + 1) * beams)
        distance = max(range_min, hash_uniform(key, counter + 3 * trial + 2) * ranges[first])
        for j in range(first, first + length):
            k = j % beams
            if distance < ranges[k]:
                scan[k, 0], scan[k, 1] = distance, weakest + (strongest - weakest) * uniform[k]
                labels[k] = label


@njit(cache=True)
def spoil_scans(
    ranges,
    surfaces,
    incidence,
    ambient_lux,
    keys,
    step,
    range_min,
    range_max,
    reflectivity,
    label_table,
    ghost_label,
    confusion,
    normal,
    uniform,
    scans,
    labels,
):
    """Turn clean casts of n worlds into readings.

    Args:
        ranges, surfaces, incidence: (n, beams) from `kernels.lidar.cast_scans`.
        ambient_lux: (n,).
        keys: (n,) u64, one stream a world.
        step: (n,) i64 turns since reset; the same key and step give the same noise.
        range_min, range_max: limits of a reading [m].
        reflectivity, label_table: tables of `semantics`, by surface code.
        ghost_label: what the front end calls a ghost.
        confusion: share of hits given one of the three other labels among 1 to 4.
        normal, uniform: (TABLE_SIZE,) noise tables.
        scans: (n, beams, 2) f32 out: range [m] and intensity; `range_max` and 0 where nothing came back.
        labels: (n, beams) u8 out, label of each reading, 0 where nothing came back.
    """
    beams = ranges.shape[1]
    for i in range(len(ranges)):
        sigma, lost, ghosts, scale = noise_levels(ambient_lux[i])
        first = step[i] * _DRAWS
        along = normal[_table_window(keys[i], first, beams) :]
        drop = uniform[_table_window(keys[i], first + 1, beams) :]
        flicker = normal[_table_window(keys[i], first + 2, beams) :]
        mistake = uniform[_table_window(keys[i], first + 3, beams) :]
        for k in range(beams):
            surface = surfaces[i, k]
            distance = ranges[i, k]
            returned = surface > 0 and drop[k] >= lost
            reading = min(max(distance + sigma * along[k], range_min), range_max)
            strength = reflectivity[surface] * (0.3 + 0.7 * incidence[i, k]) * scale / path_loss(distance)
            strength = min(max(strength + INTENSITY_SIGMA * flicker[k], 0.0), 1.0)
            scans[i, k, 0] = reading if returned else range_max
            scans[i, k, 1] = strength if returned else 0.0
            label = label_table[surface]
            if mistake[k] < confusion and label > 0:  # `mistake` over `confusion` is uniform again
                label = (label + int(3.0 * mistake[k] / confusion)) % 4 + 1
            labels[i, k] = label if returned else 0
        _add_ghosts(ranges[i], drop, ghosts, keys[i], first + 4, range_min, ghost_label, scans[i], labels[i])
