"""White Gaussian noise from a state of eight bytes per sensor, repeatable by its seed.

SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014) and
Marsaglia's polar method.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.host_tools.hardware.memory import (
    AltimeterState,
    GnssState,
    OdometerState,
    Sensors,
)

Source = Sensors | AltimeterState | GnssState | OdometerState
"""A record with the state of random numbers."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_TO_UNIT = 2.0**-53


@compiled
def uniform(source: Source, k: int) -> float:
    """Return the next uniform number in [0, 1) of a source's sensor `k`."""
    state = source.noise_state[k] + _GOLDEN
    source.noise_state[k] = state
    mixed = (state ^ (state >> np.uint64(30))) * _MIX_1
    mixed = (mixed ^ (mixed >> np.uint64(27))) * _MIX_2
    mixed ^= mixed >> np.uint64(31)
    return np.float64(mixed >> np.uint64(11)) * _TO_UNIT


@compiled
def normal(source: Source, k: int) -> float:
    """Return the next standard normal number of a source's sensor `k`."""
    if source.noise_has_spare[k]:
        source.noise_has_spare[k] = 0
        return source.noise_spare[k]
    while True:
        u = 2.0 * uniform(source, k) - 1.0
        v = 2.0 * uniform(source, k) - 1.0
        s = u * u + v * v
        if 0.0 < s < 1.0:
            scale = math.sqrt(-2.0 * math.log(s) / s)
            source.noise_spare[k] = v * scale
            source.noise_has_spare[k] = 1
            return u * scale
