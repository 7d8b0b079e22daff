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
from rrins.firmware_py.core.estimator import propagation, transition, wheels
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
    ALTIMETER_DRIFT,
    ALTIMETER_FAULT,
    CHANNELS,
    FAULT_CAPACITY,
    GNSS_DRIFT,
    GYROS_SHIFT,
    ODOMETER_FAULT,
    OTHER_FAULTS,
    RUNGS,
    SINCE_BEGIN,
    SUSPECT,
    Effect,
    Fault,
)
from rrins.firmware_py.core.records.memory import Ram

FIRST_AID = FAULT_CAPACITY - OTHER_FAULTS
FIRST_ALIKE, FIRST_SHIFT = FIRST_AID + ALL_GYROS, FIRST_AID + GYROS_SHIFT

KEPT_FROM = 12.0
"""Square of the statistic of a fault from which on it is kept."""

AGREES_BELOW = 2.5
"""Mean square of the normalised innovations; of 64 independent ones 6 sigma are 2.1."""

_REFUSED_MOST = 25.0
"""Square of a normalised innovation that counts for the agreement, at most: the gate's."""

_RECENT = 64
"""Innovations over which their agreement with the filter is judged."""

_GNSS_POSITION, _GNSS_VELOCITY = int(Aid.GNSS_POSITION), int(Aid.GNSS_VELOCITY)
_ODOMETER, _ALTIMETER = int(Aid.ODOMETER), int(Aid.ALTIMETER)


@compiled
def begin(state: Ram) -> None:
    """Begin with the filter."""
    integrity = state.integrity
    integrity.seconds = 0
    integrity.agreement = 1.0
    integrity.refused[:] = 0.0
    integrity.owed[:] = 0
    integrity.verdicts[:] = 0
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
    effect.refused_information[:] = 0.0
    effect.refused_correlation[:] = 0.0
    effect.left = 1.0
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
def channel_of(aid: int, component: int) -> int:
    """Return the channel of a measurement; -1: it comes from no device that may fail."""
    if aid == _GNSS_POSITION:
        return component
    if aid == _GNSS_VELOCITY:  # latitude is north, the second component of a velocity
        return 1 - component if component < 2 else component
    if aid == _ODOMETER:
        return COMPONENTS
    return COMPONENTS + 1 if aid == _ALTIMETER else -1


@compiled
def channel_at_fault(k: int) -> int:
    """Return the channel that a fault is of; -1: it is of the sensors."""
    if not FIRST_AID <= k < FIRST_ALIKE:
        return -1
    fault = k - FIRST_AID
    if fault < ODOMETER_FAULT:
        return fault % COMPONENTS
    return COMPONENTS if fault == ODOMETER_FAULT else COMPONENTS + 1


@compiled
def device_of(channel: int) -> int:
    """Return the device of a channel; -1: there is none."""
    return channel if channel < 0 else max(0, channel - COMPONENTS + 1)


@compiled
def evidence(effect: Effect) -> tuple[float, float]:
    """Return information and correlation of all innovations, the refused ones among them."""
    information, correlation = float(effect.information), float(effect.correlation)
    for channel in range(CHANNELS):
        information += effect.refused_information[channel]
        correlation += effect.refused_correlation[channel]
    return information, correlation


@compiled
def shown(effect: Effect) -> float:
    """Return the square of the statistic of a fault."""
    information, correlation = evidence(effect)
    return correlation * correlation / information if information > 0.0 else 0.0


@compiled
def explains(effect: Effect) -> bool:
    """Return whether an aid's fault leaves no more of the innovations than noise."""
    return bool(effect.left <= AGREES_BELOW)


@compiled
def _keep_suspect(state: Ram, fault: Fault) -> None:
    """Keep the time since which a fault shows most, for as long as no other shows more.

    One that explains the innovations comes first: a wheel that locks within a second is another
    fault in it.
    """
    kept = fault.effects[SUSPECT]
    best, most, fits = -1, max(KEPT_FROM, shown(kept)), explains(kept)
    for age in range(SINCE_BEGIN):
        effect, least = fault.effects[age], most
        if explains(effect) and not fits:
            least = KEPT_FROM
        if shown(effect) > least and (explains(effect) or not fits):
            best, most, fits = age, shown(effect), explains(effect)
    if best >= 0:
        keep(kept, fault.effects[best])


@compiled
def keep(kept: Effect, effect: Effect) -> None:
    """Let one effect be as another is."""
    kept.begun_s = effect.begun_s
    kept.information = effect.information
    kept.correlation = effect.correlation
    copy(kept.refused_information, effect.refused_information)
    copy(kept.refused_correlation, effect.refused_correlation)
    kept.left = effect.left
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
def _offset(state: Ram, effect: Effect, k: int, aid: int, component: int) -> float:
    """Return by how much a fault of size 1 of an aid moves this measurement.

    Of the odometer, beyond what the scale does to its count: a wheel that is locked has none.
    """
    integrity, is_fix = state.integrity, aid in (_GNSS_POSITION, _GNSS_VELOCITY)
    lasts_s = float(integrity.seconds - effect.begun_s)
    if k == FIRST_AID + ODOMETER_FAULT and wheels.is_forward(aid, component):
        scale = BIASES + int(state.gyros.count + state.accelerometers.count) + SCALE
        return float(wheels.skidded_m(state.estimator) * effect.state[scale])
    if k == FIRST_AID + ALTIMETER_DRIFT and aid == _ALTIMETER:
        return lasts_s
    if not is_fix or channel_of(aid, component) != channel_at_fault(k):
        return 0.0
    if k < FIRST_AID + GNSS_DRIFT:
        return 1.0 if aid == _GNSS_POSITION else 0.0
    return lasts_s if aid == _GNSS_POSITION else 1.0


@compiled
def take(
    state: Ram, aid: int, component: int, innovation: float, expected: float, is_used: bool
) -> None:
    """Follow a measurement: its row and gain are those in the estimator's scratch.

    What refused ones say is kept apart, as it may turn out to be void.
    """
    integrity, estimator = state.integrity, state.estimator
    row, gain, n = estimator.row, estimator.gain, int(estimator.states)
    square = min(innovation * innovation / expected, _REFUSED_MOST)
    integrity.agreement += (square - integrity.agreement) / _RECENT
    if aid == _GNSS_POSITION:
        integrity.refused[component] = 0.0 if is_used else abs(innovation)
    channel = channel_of(aid, component)
    apart = channel >= 0 and not is_used
    for k in range(FAULT_CAPACITY):
        fault = integrity.faults[k]
        if not fault.present:
            continue
        has_to_explain = _is_to_explain(channel_at_fault(k), channel)
        for age in range(AGES):
            effect = fault.effects[age]
            shift = _offset(state, effect, k, aid, component)
            for i in range(n):
                if row[i] != 0.0:
                    shift += row[i] * effect.state[i]
            if has_to_explain:
                _explain(effect, shift, innovation, expected)
            if apart:
                effect.refused_information[channel] += shift * shift / expected
                effect.refused_correlation[channel] += shift * innovation / expected
                continue
            effect.information += shift * shift / expected
            effect.correlation += shift * innovation / expected
            if is_used:
                share = shift / expected
                for i in range(n):
                    effect.state[i] -= gain[i] * share


@compiled
def _is_to_explain(at_fault: int, channel: int) -> bool:
    """Return whether a device's fault ought to: not what its other channels measure."""
    another = channel != at_fault and device_of(channel) == device_of(at_fault)
    return at_fault >= 0 and not another


@compiled
def _explain(effect: Effect, shift: float, innovation: float, expected: float) -> None:
    """Follow how much of the innovations the fault leaves, with the size it had before this one."""
    information, correlation = evidence(effect)
    rest = innovation
    if information > 0.0:
        rest -= shift * correlation / information
    square = min(rest * rest / expected, _REFUSED_MOST)
    effect.left += (square - effect.left) / _RECENT
