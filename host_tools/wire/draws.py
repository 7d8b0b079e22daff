"""Random numbers of numpy's default generator in compiled code: the same ones, one by one.

PCG XSL RR 128/64 (O'Neill, "PCG: a family of simple fast space-efficient statistically good
algorithms for random number generation", HMC-CS-2014-0905).
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, U8, Record

_HIGH, _LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
"""The halves of the multiplier."""

_HALF, _LOWER = np.uint64(32), np.uint64(0xFFFFFFFF)
_TO_UNIT = 2.0**-53


class Draws(Record):
    """The state of a generator: numbers of 128 bits in halves."""

    high: U8
    low: U8
    step_high: U8  #: what is added
    step_low: U8
    left: I8  #: of a number of which half was used; -1: none


def begin(draws: Draws, seed: list[int]) -> None:
    """Begin with the numbers of ``numpy.random.default_rng(seed)``."""
    state = np.random.PCG64(seed).state["state"]
    draws.high, draws.low = map(np.uint64, divmod(state["state"], 1 << 64))
    draws.step_high, draws.step_low = map(np.uint64, divmod(state["inc"], 1 << 64))
    draws.left = -1


@compiled
def _upper_product(a: np.uint64, b: np.uint64) -> np.uint64:
    """Return the upper 64 bits of a product."""
    low = (a & _LOWER) * (b & _LOWER)
    middle = (a >> _HALF) * (b & _LOWER) + (low >> _HALF)
    other = (a & _LOWER) * (b >> _HALF) + (middle & _LOWER)
    return (a >> _HALF) * (b >> _HALF) + (middle >> _HALF) + (other >> _HALF)


@compiled
def _word(draws: Draws) -> np.uint64:
    """Return the next 64 bits."""
    product = draws.low * _LOW
    high = _upper_product(draws.low, _LOW) + draws.low * _HIGH + draws.high * _LOW
    low = product + draws.step_low
    high += draws.step_high + np.uint64(low < product)
    draws.high, draws.low = high, low
    turn, mixed = high >> np.uint64(58), high ^ low
    return (mixed >> turn) | (mixed << ((np.uint64(64) - turn) & np.uint64(63)))


@compiled
def uniform(draws: Draws) -> float:
    """Return what ``random()`` returns: a number in [0, 1)."""
    return np.float64(np.int64(_word(draws) >> np.uint64(11))) * _TO_UNIT


@compiled
def bit(draws: Draws) -> int:
    """Return what ``integers(64)`` returns."""
    half = np.uint64(draws.left)
    if draws.left >= 0:
        draws.left = -1
    else:
        word = _word(draws)
        half = word & _LOWER
        draws.left = int(np.int64(word >> _HALF))
    return int(np.int64(half >> np.uint64(26)))
