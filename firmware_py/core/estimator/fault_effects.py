"""Effects of faults on the error that the filter leaves, and their trace in the innovations.

A fault of a sensor is a jump of its bias, and with it of the error that the filter leaves; one of a
fix is an offset of what is measured. A scale that all sensors of a kind have alike makes an error
of all that they sense, second by second. From there on an error goes the way of all errors of the
filter: ``Φ e`` in a second, ``(I - K h) e - K c`` with a measurement that is off by c. A fault of
size b moves an innovation by ``b (h e + c)``. The sum of the squares of ``h e + c`` over the
innovation's variance is the information about b, that of its products with the innovations tells b.
Willsky and Jones, *IEEE Transactions on Automatic Control* 21 (1976) 108; Joerger and Pervan, *IEEE
Transactions on Aerospace and Electronic Systems* 50 (2014), on solution separation.

A fault may have begun at any time: it is followed from several, which a ladder keeps. Rung k is
taken anew every ``2^k`` seconds that the next one does not take. The time since which a fault shows
most is kept for longer.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.estimator import propagation, transition
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.records.estimator_records import (
    BIASES,
    COMPONENTS,
    DONE,
    SCALE,
    Aid,
)
from rrins.firmware_py.core.records.integrity_records import (
    AGES,
    ALL_GYROS,
    ALTIMETER_FAULT,
    FAULT_CAPACITY,
    GNSS_DRIFT,
    GNSS_STEP,
    GYROS_SHIFT,
    ODOMETER_FAULT,
    OTHER_FAULTS,
    RUNGS,
    SINCE_BEGIN,
    SUSPECT,
    Effect,
    Fault,
    Integrity,
)
from rrins.firmware_py.core.records.memory import Ram

FIRST_AID = FAULT_CAPACITY - OTHER_FAULTS
FIRST_ALIKE, FIRST_SHIFT = FIRST_AID + ALL_GYROS, FIRST_AID + GYROS_SHIFT

_KEPT_FROM = 12.0
"""Square of the statistic of a fault from which on it is kept."""

_REFUSED_MOST = 25.0
"""Square of a normalised innovation that counts for the agreement, at most: the gate's."""

_RECENT = 64
"""Innovations over which their agreement with the filter is judged."""

_GNSS_POSITION, _GNSS_VELOCITY = int(Aid.GNSS_POSITION), int(Aid.GNSS_VELOCITY)
_ALTIMETER = int(Aid.ALTIMETER)


@compiled
def begin(state: Ram) -> None:
    """Begin with the filter."""
    integrity = state.integrity
    integrity.seconds = 0
    integrity.agreement = 1.0
    integrity.refused[:] = 0.0
    for k in range(FAULT_CAPACITY):
        for age in range(AGES):
            _restart(state, integrity.faults[k], k, age)


@compiled
def _restart(state: Ram, fault: Fault, k: int, age: int) -> None:
    """Let a fault begin now."""
    effect, estimator = fault.effects[age], state.estimator
    effect.begun_s = state.integrity.seconds
    effect.information = fault.known
    effect.correlation = 0.0
    effect.refused_information = 0.0
    effect.refused_correlation = 0.0
    effect.state[:] = 0.0
    gyros, sensors = int(state.gyros.count), int(state.gyros.count + state.accelerometers.count)
    aid = k - FIRST_AID
    if fault.sensor >= 0:
        first = BIASES + (0 if k < SENSOR_GROUPS else gyros)
        effect.state[first + fault.sensor] = 1.0
    elif k == FIRST_SHIFT:
        effect.state[BIASES : BIASES + gyros] = 1.0
    elif k == FIRST_SHIFT + 1:
        effect.state[BIASES + gyros : BIASES + sensors] = 1.0
    elif aid == ODOMETER_FAULT and fault.present:
        effect.state[BIASES + sensors + SCALE] = 1.0
    elif aid == ALTIMETER_FAULT and fault.present:
        effect.state[estimator.altimeter_state] = 1.0


@compiled
def propagate(state: Ram) -> None:
    """Carry all effects over a second by the filter's transition, and let faults begin."""
    integrity = state.integrity
    integrity.seconds += 1
    _drive(state)
    begins = 0
    while begins < RUNGS - 1 and integrity.seconds >> begins & 1 == 0:
        begins += 1
    for k in range(FAULT_CAPACITY):
        fault = integrity.faults[k]
        if not fault.present:
            continue
        kind = k - FIRST_ALIKE
        for age in range(AGES):
            _carry(state, fault.effects[age])
            if kind == 0 or kind == 1:
                for i in range(BIASES):
                    fault.effects[age].state[i] += integrity.driven[kind, i]
        _keep_suspect(state, fault)
        _restart(state, fault, k, begins)


@compiled
def _drive(state: Ram) -> None:
    """Write the error that a scale of 1 of all sensors of a kind makes in this second."""
    integrity, estimator = state.integrity, state.estimator
    sensed, column = estimator.turn_n, transition.TURN
    for kind in range(2):
        if kind == 1:
            sensed, column = estimator.force_n, transition.CHANGE
        copy(estimator.direction, sensed[DONE])
        for i in range(BIASES):
            integrity.driven[kind, i] = -propagation.input_of(estimator, i, column)


@compiled
def _shown(effect: Effect) -> float:
    """Return the square of the statistic of a fault."""
    information = effect.information + effect.refused_information
    if information <= 0.0:
        return 0.0
    return float((effect.correlation + effect.refused_correlation) ** 2 / information)


@compiled
def _keep_suspect(state: Ram, fault: Fault) -> None:
    """Keep the time since which a fault shows most, for as long as no other shows more."""
    best, most = -1, max(_KEPT_FROM, _shown(fault.effects[SUSPECT]))
    for age in range(SINCE_BEGIN):
        if _shown(fault.effects[age]) > most:
            best, most = age, _shown(fault.effects[age])
    if best < 0:
        return
    _keep(fault.effects[SUSPECT], fault.effects[best])


@compiled
def _keep(kept: Effect, effect: Effect) -> None:
    kept.begun_s = effect.begun_s
    kept.information = effect.information
    kept.correlation = effect.correlation
    kept.refused_information = effect.refused_information
    kept.refused_correlation = effect.refused_correlation
    copy(kept.state, effect.state)


@compiled
def _carry(state: Ram, effect: Effect) -> None:
    estimator, matrix = state.estimator, state.estimator.transition
    error, moved = effect.state, estimator.gain
    moved[:BIASES] = 0.0
    for j in range(estimator.states):
        value = error[j]
        if value != 0.0:
            for i in range(BIASES):
                moved[i] += matrix[i, j] * value
    copy(error[:BIASES], moved)
    for i in range(COMPONENTS if estimator.receiver else 0):
        error[estimator.receiver_state + i] *= estimator.receiver_share


@compiled
def _offset(integrity: Integrity, effect: Effect, k: int, aid: int, component: int) -> float:
    """Return by how much a fault of size 1 of an aid moves this measurement."""
    fault = k - FIRST_AID
    if fault == GNSS_STEP + component and aid == _GNSS_POSITION:
        return 1.0
    if GNSS_DRIFT <= fault < GNSS_DRIFT + COMPONENTS:
        axis = fault - GNSS_DRIFT
        if aid == _GNSS_POSITION and axis == component:
            return float(integrity.seconds - effect.begun_s)
        # Latitude is north, the second component of a velocity.
        along = 1 - axis if axis < 2 else axis
        if aid == _GNSS_VELOCITY and along == component:
            return 1.0
    return 0.0


@compiled
def take(
    state: Ram, aid: int, component: int, innovation: float, expected: float, is_used: bool
) -> None:
    """Follow a measurement: its row and gain are those in the estimator's scratch.

    What refused heights of the altimeter say is kept apart, as it may turn out to be void.
    """
    integrity, estimator = state.integrity, state.estimator
    row, gain, n = estimator.row, estimator.gain, int(estimator.states)
    square = min(innovation * innovation / expected, _REFUSED_MOST)
    integrity.agreement += (square - integrity.agreement) / _RECENT
    if aid == _GNSS_POSITION:
        integrity.refused[component] = 0.0 if is_used else abs(innovation)
    apart = aid == _ALTIMETER and not is_used
    for k in range(FAULT_CAPACITY):
        fault = integrity.faults[k]
        if not fault.present:
            continue
        for age in range(AGES):
            effect = fault.effects[age]
            shift = _offset(integrity, effect, k, aid, component)
            for i in range(n):
                if row[i] != 0.0:
                    shift += row[i] * effect.state[i]
            if apart:
                effect.refused_information += shift * shift / expected
                effect.refused_correlation += shift * innovation / expected
                continue
            effect.information += shift * shift / expected
            effect.correlation += shift * innovation / expected
            if is_used:
                share = shift / expected
                for i in range(n):
                    effect.state[i] -= gain[i] * share


@compiled
def forget_refused(integrity: Integrity) -> None:
    """Forget what refused heights of the altimeter have said: it was the altimeter that erred."""
    for k in range(FAULT_CAPACITY):
        for age in range(AGES):
            effect = integrity.faults[k].effects[age]
            effect.refused_information = 0.0
            effect.refused_correlation = 0.0
        suspect = integrity.faults[k].effects[SUSPECT]
        if _shown(suspect) < _KEPT_FROM:  # it was kept for what is void now
            _keep(suspect, integrity.faults[k].effects[SINCE_BEGIN])
