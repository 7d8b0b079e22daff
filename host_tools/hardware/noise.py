"""White Gaussian noise from a state of eight bytes per sensor, repeatable by its seed.

SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014) and
Marsaglia's polar method.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats, Integers
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
_LOG_2 = math.log(2.0)
_ROOT_OF_HALF = np.float64(math.sqrt(0.5)).view(np.int64)


@compiled
def _uniform_of(state: np.uint64) -> float:
    """Return the uniform number in [0, 1) of a state."""
    mixed = (state ^ (state >> np.uint64(30))) * _MIX_1
    mixed = (mixed ^ (mixed >> np.uint64(27))) * _MIX_2
    mixed ^= mixed >> np.uint64(31)
    return np.float64(np.int64(mixed >> np.uint64(11))) * _TO_UNIT


@compiled
def uniform(source: Source, k: int) -> float:
    """Return the next uniform number in [0, 1) of a source's sensor `k`."""
    state = source.noise_state[k] + _GOLDEN
    source.noise_state[k] = state
    return _uniform_of(state)


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


@compiled
def normals(source: Source, k: int, out: Floats, work: Floats, bits: Integers) -> None:
    """Write the next standard normal numbers of a source's sensor `k` to `out`, shape (n,).

    What `normal` returns n times, but for the rounding of the logarithm, and faster.
    `work` has shape (5, m), m at least 8; `bits` is its last row as integers.
    """
    u, v, s, mantissa = work[0], work[1], work[2], work[4]
    at, wanted = 0, out.shape[0]
    if wanted > 0 and source.noise_has_spare[k]:
        source.noise_has_spare[k] = 0
        out[0] = source.noise_spare[k]
        at = 1
    while at < wanted:
        pairs = (wanted - at + 1) // 2
        tried = min(u.shape[0], pairs + pairs // 3 + 4)
        first = source.noise_state[k]
        for i in range(tried):
            state = first + _GOLDEN * np.uint64(2 * i + 1)
            u[i] = 2.0 * _uniform_of(state) - 1.0
            v[i] = 2.0 * _uniform_of(state + _GOLDEN) - 1.0
            s[i] = u[i] * u[i] + v[i] * v[i]
        found = i = 0
        while i < tried and found < pairs:
            square = s[i]
            u[found], v[found], s[found], mantissa[found] = u[i], v[i], square, square
            found += 0.0 < square < 1.0
            i += 1
        source.noise_state[k] = first + _GOLDEN * np.uint64(2 * i)
        _scale(s, work[3], mantissa, bits, found)
        left = out[at:]
        whole = min(found, left.shape[0] // 2)
        for i in range(whole):
            left[2 * i], left[2 * i + 1] = u[i] * s[i], v[i] * s[i]
        if found > whole:
            left[2 * whole], source.noise_spare[k] = u[whole] * s[whole], v[whole] * s[whole]
            source.noise_has_spare[k] = 1
        at += 2 * found


@compiled_with(error_model="numpy")
def _scale(s: Floats, logarithm: Floats, mantissa: Floats, bits: Integers, count: int) -> None:
    """Turn s in (0, 1) into ``sqrt(-2 log(s) / s)``, to 1e-15 of it; `mantissa` is s, too.

    Loops without a branch. `bits` is `mantissa` as integers; its exponent goes, and
    ``log(m) = 2 artanh((m - 1) / (m + 1))`` for the m between the roots of 1/2 and 2 that is left.
    """
    for i in range(count):
        exponent = (bits[i] - _ROOT_OF_HALF) >> 52
        bits[i] -= exponent << 52
        logarithm[i] = exponent * _LOG_2
    for i in range(count):
        x = (mantissa[i] - 1.0) / (mantissa[i] + 1.0)
        y = x * x
        series = 1.0 / 19.0 + y * (1.0 / 21.0)
        series = 1.0 / 15.0 + y * (1.0 / 17.0 + y * series)
        series = 1.0 / 11.0 + y * (1.0 / 13.0 + y * series)
        series = 1.0 / 7.0 + y * (1.0 / 9.0 + y * series)
        series = y * (1.0 / 3.0 + y * (1.0 / 5.0 + y * series))
        logarithm[i] += 2.0 * (x + x * series)
    for i in range(count):
        s[i] = math.sqrt(-2.0 * logarithm[i] / s[i])
