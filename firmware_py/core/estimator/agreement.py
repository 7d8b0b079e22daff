"""Whether a receiver's velocities agree with the filter, over windows as over the parity.

A receiver that is led away slowly passes the gate with every fix. Innovations of sound aids are
white: the sum of w of them, over their sigmas, has the variance w. Once a sum says otherwise while
an odometer agrees, two stand against one, and the receiver is not used until its velocities agree
again. Without an odometer the filter cannot know which is wrong. Groves (2nd ed., 2013), 17.3.2.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import doubt
from rrins.firmware_py.core.records.estimator_records import (
    AGREEMENT_FIXES,
    LEVEL,
    NO_TRUST,
    Aid,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Ram

RECEIVER, ODOMETER = 0, 1
"""Rows of `Estimator.agreement_sum`: level velocities, and the ways along and across."""

_ODOMETER = int(Aid.ODOMETER)

_WINDOWS = (1, 3, 10, 30, 100)
"""Measurements. The longest is shorter than `AGREEMENT_FIXES`."""

_AGREES = 10
"""Fixes over which a receiver has to agree before it is used again."""

_DOUBTED, _SOUND = 6.0, 3.0
"""Standard deviations that raise the doubt, fewer than one in 1000 h of sums; and usual ones."""


@compiled
def begin(estimator: Estimator) -> None:
    """Begin with the filter."""
    estimator.receiver_doubted = False
    estimator.agreement_count[:] = 0
    estimator.agreement_sum[:] = 0.0


@compiled
def _largest(estimator: Estimator, aid: int, window: int) -> float:
    """Return the larger sum over a window that ends now, in standard deviations."""
    now = estimator.agreement_count[aid]
    begin = now - min(window, now)
    largest = 0.0
    for i in range(LEVEL):
        total = estimator.agreement_sum[aid, now % AGREEMENT_FIXES, i]
        total -= estimator.agreement_sum[aid, begin % AGREEMENT_FIXES, i]
        largest = max(largest, abs(total))
    return float(largest / math.sqrt(window))


@compiled
def note(state: Ram, aid: int, component: int, normalised: float) -> None:
    """Note an innovation over its sigma; with the last one of a fix, test."""
    estimator = state.estimator
    sums, count = estimator.agreement_sum[aid], estimator.agreement_count[aid]
    kept = max(-estimator.gate, min(estimator.gate, normalised))  # one outlier raises nothing
    before = sums[count % AGREEMENT_FIXES, component]
    sums[(count + 1) % AGREEMENT_FIXES, component] = before + kept
    if component == LEVEL - 1:
        estimator.agreement_count[aid] += 1
        if aid == RECEIVER:
            _judge(state)


@compiled
def _judge(state: Ram) -> None:
    """Doubt the receiver where it alone disagrees, as long as it does."""
    estimator = state.estimator
    if doubt.explains(estimator, state.epoch):
        estimator.receiver_doubted = False
        return
    if estimator.receiver_doubted:
        if _largest(estimator, RECEIVER, _AGREES) < _SOUND:
            begin(estimator)  # longer windows have the doubtful fixes in them
        return
    helps = state.odometer.available and estimator.sources[_ODOMETER].distrust < NO_TRUST
    for window in _WINDOWS:
        if not helps or min(estimator.agreement_count[0], estimator.agreement_count[1]) < window:
            return
        odd = _largest(estimator, RECEIVER, window) > _DOUBTED
        if odd and _largest(estimator, ODOMETER, window) < _SOUND:
            estimator.receiver_doubted = True
