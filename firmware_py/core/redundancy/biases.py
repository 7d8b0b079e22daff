"""Whether the biases are as the data sheet says: the mean parity since the sensors are compared.

What an alignment says of its own accuracy rests on the biases of the data sheet. A sensor that
failed before enough was learned of the parity is within the limits of its bias, for all that the
tests of the parity know, but its parity is larger than the standard deviations.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import ABSOLUTE, Parity
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM

_BEYOND = 4.0
"""Standard deviations beyond which biases are larger than stated; sound ones are not: of sixteen
alike in size, whatever their signs, the parity is four at most."""


@compiled
def excess(parity: Parity, fusion: Fusion) -> float:
    """Return by how many standard deviations biases are off that the data sheet does not have.

    0 where they are as it says, or nothing shows them.
    """
    regressors = parity.now.regressors
    seconds, largest = regressors[0], 0.0
    if not parity.redundant or not seconds > 0.0:
        return 0.0
    variance = parity.bias_variance
    for k in range(1, ABSOLUTE + fusion.count):
        variance += parity.parity.usual[k] * (regressors[k] / seconds) ** 2
    for i in range(fusion.count):
        if parity.projector[i, i] <= CHECKED_FROM:
            continue
        squares = 0.0
        for j in range(fusion.count):
            squares += parity.projector[i, j] ** 2
        own = squares * variance + parity.second_variance[i] / seconds
        largest = max(largest, (parity.now.residual[i] / seconds) ** 2 / own)
    return math.sqrt(largest) if largest > _BEYOND * _BEYOND else 0.0


@compiled
def doubtful_sigma(parity: Parity, fusion: Fusion) -> float:
    """Return what a fused component may be off by, with the excess, rad/s or m/s²; 0: none."""
    seconds = max(1.0, parity.now.regressors[0])
    return excess(parity, fusion) * math.sqrt(
        parity.bias_variance + parity.vector_variance / seconds
    )
