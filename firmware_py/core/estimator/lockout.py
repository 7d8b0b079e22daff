"""A filter that its own gate locks out: it rejects all fixes, and nothing else helps.

Its P promises more than it keeps, so it would go on without aid for ever. After two minutes in
which positions and velocities were rejected, P is made as large as the innovations say, and the
filter goes on with the receiver. It tells so, for it cannot know which of the two was wrong. Where
velocities agree, as of a receiver that has jumped, or of a car that stops, these minutes wait.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import agreement, doubt, refusals
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.records.estimator_records import (
    BIASES,
    LATITUDE,
    NO_TRUST,
    VELOCITY,
    Aid,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Ram

PATIENCE_S = 120
"""Jumps and pulls of a receiver last shorter, as a rule; the navigation stays useful meanwhile."""

_LARGEST_ATTITUDE = 0.2
"""rad, of attitude's sigma: the filter is linear."""

_ALONE = 0.5
"""Share of a variance that is missing which goes to what is measured alone."""

_ZERO_VELOCITY, _KNOWN_POSITION = int(Aid.ZERO_VELOCITY), int(Aid.KNOWN_POSITION)
_GNSS_POSITION, _GNSS_VELOCITY = int(Aid.GNSS_POSITION), int(Aid.GNSS_VELOCITY)
_ODOMETER = int(Aid.ODOMETER)


@compiled
def begin(estimator: Estimator) -> None:
    """Begin with the filter."""
    estimator.others_used = 0
    estimator.locked_s = 0
    estimator.excess = 0.0
    estimator.reopened = False
    estimator.reopenings = 0


@compiled
def follow(state: Ram) -> None:
    """Close a second; open the gate after too many of them."""
    estimator = state.estimator
    excess = estimator.excess
    estimator.excess = 0.0
    estimator.reopened = False
    velocity, still = estimator.sources[_GNSS_VELOCITY], estimator.sources[_ZERO_VELOCITY]
    has_fixes = state.gnss.available
    trusts = has_fixes and estimator.sources[_GNSS_POSITION].distrust < NO_TRUST
    rejects = still.distrust >= NO_TRUST or (has_fixes and velocity.distrust >= NO_TRUST)
    if _is_helped(estimator) or trusts:
        estimator.locked_s = 0
    elif rejects:
        estimator.locked_s += 1
    odometer = estimator.sources[_ODOMETER]
    both = has_fixes and state.odometer.available
    if both and velocity.distrust >= NO_TRUST and odometer.distrust >= NO_TRUST:
        estimator.doubted_epoch = state.epoch  # two against one
    if estimator.locked_s >= PATIENCE_S and excess > 1.0:
        _open(state, math.sqrt(excess))
        refusals.believe_all(state.integrity)
        estimator.locked_s = 0
        estimator.doubted_epoch = state.epoch
        agreement.begin(estimator)
        estimator.reopened = True
        estimator.reopenings += 1


@compiled
def _is_helped(estimator: Estimator) -> bool:
    """Return whether something else aided the level navigation in the second."""
    odometer = estimator.sources[_ODOMETER]
    used = estimator.sources[_ZERO_VELOCITY].used + estimator.sources[_KNOWN_POSITION].used
    if odometer.distrust < NO_TRUST:
        used += odometer.used
    helped = used != estimator.others_used
    estimator.others_used = used
    return bool(helped)


@compiled
def _open(state: Ram, factor: float) -> None:
    """Multiply the sigmas by a factor: correlations stay; biases no further than at the beginning.

    ``D P D`` with a diagonal D is as definite as P.
    """
    estimator, P, scale = state.estimator, state.estimator.P, state.estimator.gain
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    for i in range(estimator.states):
        scale[i] = 1.0
        sigma = math.sqrt(max(P[i, i], 1e-30))
        if i < VELOCITY:
            scale[i] = max(1.0, min(factor, _LARGEST_ATTITUDE / sigma))
        elif i < BIASES:
            scale[i] = factor
        elif i < BIASES + gyros:
            scale[i] = max(1.0, min(factor, estimator.bias_sigma[0] / sigma))
        elif i < BIASES + gyros + accelerometers:
            scale[i] = max(1.0, min(factor, estimator.bias_sigma[1] / sigma))
    for i in range(estimator.states):
        for k in range(estimator.states):
            P[i, k] *= scale[i] * scale[k]
    doubt.widen(state, scale)


@compiled
def open_at_once(state: Ram, aid: int, component: int, innovation: float, expected: float) -> float:
    """Open the gate for one measurement, for a sensor is in doubt; return its variance then.

    Where no sensor can be spared the doubt goes on: nothing but the aids would tell of another
    fault.
    """
    estimator, redundancy = state.estimator, state.redundancy
    if not (redundancy.gyros.redundant and redundancy.accelerometers.redundant):
        estimator.doubted_epoch = state.epoch
    used_epoch, since_s = estimator.used_epoch[aid, component], 0.0
    if used_epoch >= 0:
        since_s = max(1.0, (state.epoch - used_epoch) / estimator.second_epochs)
    return open_along(estimator, innovation, expected, since_s)


@compiled
def open_along(estimator: Estimator, innovation: float, expected: float, since_s: float) -> float:
    """Widen P until the innovation of a measurement is as expected; return its variance then.

    For a sensor's fault that explains why it is rejected: of this measurement alone, and at once.
    A half of what is missing goes along what it depends on, of velocity and position:
    ``P + c g gᵀ`` with their part g of ``P rowᵀ``, which `estimator.gain` is. The other half goes
    to what is measured alone, lest positions and velocities correct the same direction back and
    forth. Level velocities are off by a tilt in the `since_s` since they were right, if that is not
    0: so much less is the attitude known. `expected` is the variance of the innovation.
    """
    P, gain, row = estimator.P, estimator.gain, estimator.row
    along, square = 0.0, 0.0
    for i in range(VELOCITY, BIASES):
        along += gain[i] * row[i]
    first, last = _measured(estimator)
    for i in range(first, last):
        square += row[i] * row[i]
    missing = innovation * innovation - expected
    if along <= 0.0 or square <= 0.0 or missing <= 0.0:
        return expected
    alone, more = _ALONE * missing / square, (1.0 - _ALONE) * missing / along**2
    for i in range(VELOCITY, BIASES):
        for k in range(VELOCITY, BIASES):
            P[i, k] += more * gain[i] * gain[k]
    for i in range(VELOCITY, BIASES):
        gain[i] *= 1.0 + more * along
    for i in range(first, last):
        for k in range(first, last):
            P[i, k] += alone * row[i] * row[k] / square
        gain[i] += alone * row[i]
    if last <= LATITUDE and since_s > 0.0:
        level = row[VELOCITY] ** 2 + row[VELOCITY + 1] ** 2
        tilted = alone * level / square / (earth.GRAVITY_EQUATOR * since_s) ** 2
        for i in range(VELOCITY):
            P[i, i] += min(tilted, max(0.0, doubt.UNKNOWN**2 - P[i, i]))
    doubt.confine(estimator)
    estimator.reopened = True
    estimator.reopenings += 1
    return innovation * innovation


@compiled
def _measured(estimator: Estimator) -> tuple[int, int]:
    """Return the states from the first to before the last that a measurement depends on most.

    Those of the velocity, or one of the position; none where it depends on neither.
    """
    P, row, most, own = estimator.P, estimator.row, 0.0, BIASES
    for i in range(VELOCITY, BIASES):
        if row[i] * row[i] * P[i, i] > most:
            most, own = row[i] * row[i] * P[i, i], i
    if own < LATITUDE:
        return VELOCITY, LATITUDE
    return own, min(own + 1, BIASES)
