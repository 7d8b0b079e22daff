"""Two sensors of a kind that fail at once, as hypotheses of the bank: one is left out, one a state.

Without the first, a fault of the second shows along one direction of the sensor frame: a bias that
may be of any size since the earliest start of the fault.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.estimator import covariance
from rrins.firmware_py.core.estimator.transition import CHANGE, TURN
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    Bank,
    Hypothesis,
    Parity,
)
from rrins.firmware_py.core.redundancy import alike

_LARGER, _GROWS = 10.0, 1e-6
"""Size of what a second sensor may be off by, in sizes of a single fault of which the parity would
show as much; growth of its variance in a second, of its square: it may change."""


@compiled
def size_fault(parity: Parity, bank: Bank, block: Floats, first: int) -> None:
    """Let a second sensor be off by more if a block shows more; `first`: of the kind's changes."""
    shown = alike.largest(parity)
    own, place = parity.projector[shown, shown], first + 3 * shown
    square, reach = 0.0, 0.0
    for axis in range(3):
        square += block[place + axis] ** 2
        reach += parity.leave_out[shown, axis] ** 2
    if reach * own > 0.0:
        most = _LARGER**2 * square / (reach * own**2)
        bank.fault_variance[parity.kind] = max(bank.fault_variance[parity.kind], most)


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
        size = bank.fault_variance[kind]
        covariance.add_along(one.P, into, row, size - one.prior + _GROWS * one.prior)
        one.prior = size
        one.into = into


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
