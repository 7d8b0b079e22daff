"""Two sensors of a kind that fail at once, as hypotheses of the bank: one is left out, one a state.

Without the first, a fault of the second shows along one direction of the sensor frame: a bias that
may be of any size since the earliest start of the fault.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import covariance
from rrins.firmware_py.core.estimator.transition import CHANGE, TURN
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    WINDOWS_S,
    Bank,
    Hypothesis,
    Parity,
)
from rrins.firmware_py.core.redundancy import windows

_LARGER, _GROWS = 10.0, 1e-5
"""Size of what a second sensor may be off by, in sizes of a single fault that the parity would show
as much of; growth of its variance in a second, of its square: it may change."""


@compiled
def size_fault(parity: Parity, bank: Bank) -> None:
    """Note the variance of what a second sensor may be off by."""
    level, suspect = windows.begun_level(parity, 0.0), max(0, int(parity.suspect))
    own = parity.projector[suspect, suspect] * WINDOWS_S[level]
    total = parity.window_sum[level, suspect] ** 2 / own**2 if own > 0.0 else 0.0
    bank.fault_variance[parity.kind] = _LARGER**2 * total


@compiled
def widen(state: Ram, one: Hypothesis) -> None:
    """Let the bias change by what the second sensor may be off by, once its fault may be there."""
    bank, row = state.redundancy.bank, one.direction
    parity, fusion, into = state.redundancy.gyros, state.gyros, TURN
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, fusion, into = state.redundancy.accelerometers, state.accelerometers, CHANGE
        first, second = one.sensor[kind], one.second[kind]
        if second < 0 or bank.at < bank.fault_at:
            continue
        for axis in range(3):
            row[axis] = fusion.gain[axis, second]
            row[axis] += parity.leave_out[first, axis] * parity.projector[first, second]
        variance = bank.fault_variance[kind]
        if bank.at != bank.fault_at:
            variance *= _GROWS
        else:
            one.prior = variance
            one.into = into
        covariance.add_along(one.P, into, row, variance)


@compiled
def fitted(one: Hypothesis) -> float:
    """Return by how much the size of the second fault was learned, as part of twice the likelihood.

    Without it, the likelihood is that of the size that fits best: no size is held against a pair.
    """
    row, square, along = one.direction, 0.0, 0.0
    if one.prior <= 0.0:
        return 0.0
    for i in range(3):
        square += row[i] * row[i]
        for k in range(3):
            along += row[i] * one.P[one.into + i, one.into + k] * row[k]
    return max(0.0, math.log(one.prior * square * square / along))
