"""Takes a sensor that is left out back into use: by order of the operator, after a test.

For as long as the operator says, the sensor is compared with the others by the tests that find a
faulty one, as if it were in use; the navigation does not use it meanwhile. With all sensors, the
fused vector is that of the others plus the sensor's column of the gain times its residual, so the
test needs no fusion of its own.

The sensor is compared with what was learned of it before it was left out, or its constants are
learned anew. At the end they are taken off it, so that it gives what the others give.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ABSOLUTE,
    ACCELEROMETERS,
    TEST_LEAST_S,
    TEST_LONGEST_S,
    Parity,
    Readmission,
    ReadmissionOrder,
    ReadmissionState,
    Refusal,
)
from rrins.firmware_py.core.redundancy import learning, windows
from rrins.firmware_py.core.redundancy import parity as parities
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM

_STOP = int(ReadmissionOrder.STOP)
_RETURNING = -1  # until the sensors are compared, later in the same epoch
_TESTING, _READMITTED = int(ReadmissionState.TESTING), int(ReadmissionState.READMITTED)
_REFUSED, _STOPPED = int(ReadmissionState.REFUSED), int(ReadmissionState.STOPPED)
_NOT_LEFT_OUT, _NOT_COMPARABLE = int(Refusal.NOT_LEFT_OUT), int(Refusal.NOT_COMPARABLE)
_PARITY, _LIMITS = int(Refusal.PARITY), int(Refusal.LIMITS)
_MISSING, _STUCK = int(Refusal.MISSING), int(Refusal.STUCK)
_SET_CHANGED = int(Refusal.SET_CHANGED)

_PATIENCE = 2
"""The test may take so many times its length, for missing frames and pending tests."""

_LIMITS_TIMES = 3.0
"""A bias is within so many times the data sheet's limit."""

_NOISY_COUNTS2 = 24.0
"""With four counts of noise and more a sound sensor does not repeat itself: its variance in an
epoch is so many times that of counting."""


@compiled
def _refuse(readmission: Readmission, reason: int) -> None:
    readmission.state = _REFUSED
    readmission.refusal = reason


@compiled
def _trial(state: Ram, parity: Parity) -> Parity:
    """Return the comparison that a sensor of this kind is tested by."""
    readmission = state.redundancy.readmission
    return readmission.accelerometers if parity.kind == ACCELEROMETERS else readmission.gyros


@compiled
def tests(state: Ram, parity: Parity) -> bool:
    """Return whether a sensor of this kind is being tested."""
    readmission = state.redundancy.readmission
    return readmission.state == _TESTING and readmission.kind == parity.kind


@compiled
def follow(state: Ram) -> None:
    """Obey the operator's order; one to test is void while a test runs."""
    redundancy = state.redundancy
    readmission = redundancy.readmission
    order = readmission.order
    readmission.order = 0
    if order == _STOP:
        if readmission.state == _TESTING:
            readmission.state = _STOPPED
        return
    if readmission.state == _TESTING:
        return
    readmission.kind = readmission.order_kind
    readmission.sensor = readmission.order_sensor
    readmission.anew = readmission.order_anew
    readmission.wanted_s = min(max(TEST_LEAST_S, readmission.order_s), TEST_LONGEST_S)
    readmission.passed_s = 0
    readmission.waited_s = 0
    readmission.ratio = 0.0
    readmission.refusal = 0
    readmission.state = _TESTING
    excluded = redundancy.gyros.excluded
    if readmission.kind == ACCELEROMETERS:
        excluded = redundancy.accelerometers.excluded
    for compared in (readmission.gyros, readmission.accelerometers):
        compared.sensors = 0  # it begins when they are compared
        compared.used_epochs = 0
    if readmission.sensor < 1 or excluded >> (readmission.sensor - 1) & 1 == 0:
        _refuse(readmission, _NOT_LEFT_OUT)


@compiled
def compare(state: Ram, parity: Parity, fusion: Fusion, used: int) -> None:
    """Compare the sensors in use and the one that is tested; begin the test, or refuse it.

    Refused if those in use are no longer those with which the test began.
    """
    readmission, compared = state.redundancy.readmission, _trial(state, parity)
    sensor = readmission.sensor - 1
    wanted = used | 1 << sensor
    if compared.sensors == wanted:
        return
    if compared.sensors != 0:
        _refuse(readmission, _SET_CHANGED)
        return
    second_epochs = state.redundancy.second_epochs
    parities.compare(compared, fusion, wanted, second_epochs, state.ins.work)
    if compared.projector[sensor, sensor] <= CHECKED_FROM:
        _refuse(readmission, _NOT_COMPARABLE)
    elif not readmission.anew:
        seconds = (state.epoch - parity.isolated_epoch) / second_epochs
        learning.resume(compared.parity, parity.kept, seconds)


@compiled
def is_there(state: Ram, parity: Parity) -> bool:
    """Return whether a sensor of this kind is tested and usable in this epoch."""
    if not tests(state, parity):
        return False
    usable = state.assembly.gyro_usable
    if parity.kind == ACCELEROMETERS:
        usable = state.assembly.accelerometer_usable
    bit = 1 << (state.redundancy.readmission.sensor - 1)
    return usable & bit != 0 and _trial(state, parity).sensors == parity.sensors | bit


@compiled
def take(
    state: Ram, parity: Parity, fusion: Fusion, measured: Floats, vector_s: Floats, other_s: Floats
) -> None:
    """Take an epoch as if the tested sensor were in use; `vector_s` is fused without it."""
    redundancy, compared = state.redundancy, _trial(state, parity)
    readmission = redundancy.readmission
    sensor, vector = readmission.sensor - 1, readmission.vector
    residual = measured[sensor]
    for i in range(3):
        residual -= fusion.H[sensor, i] * vector_s[i]
    residual *= compared.projector[sensor, sensor]
    for i in range(3):
        vector[i] = vector_s[i] - compared.leave_out[sensor, i] * residual
    dt = state.parameters.period_ns * 1e-9
    regressors = parities.regress(compared, fusion, vector, other_s, redundancy.outer_turn, dt)
    ratio = parities.take(compared, fusion, measured, vector, regressors, True)
    readmission.ratio = max(readmission.ratio, ratio)


@compiled
def close_second(state: Ram, parity: Parity, fusion: Fusion) -> None:
    """Close a second of the test: go on, refuse the sensor, or readmit it."""
    readmission = state.redundancy.readmission
    compared, sensor = _trial(state, parity), readmission.sensor - 1
    count = int(fusion.count)
    readmission.waited_s += 1
    if 2 * compared.used_epochs > state.redundancy.second_epochs:
        ratio = windows.close_second(compared, count, ABSOLUTE + count, False)
        windows.keep(compared, count)
        readmission.passed_s += 1
        readmission.ratio = max(readmission.ratio, ratio)
    is_late = readmission.waited_s >= _PATIENCE * readmission.wanted_s
    is_over = readmission.passed_s >= readmission.wanted_s
    if _repeats(state, parity, sensor):
        _refuse(readmission, _STUCK)
    elif readmission.ratio > 1.0:
        _refuse(readmission, _PARITY)
    elif is_over and compared.frozen == 0:
        if _within_limits(compared, sensor):
            _readmit(state, parity, fusion, compared, sensor)
        else:
            _refuse(readmission, _LIMITS)
    elif is_late:
        _refuse(readmission, _PARITY if is_over else _MISSING)
    parities.begin_second(compared)


@compiled
def _repeats(state: Ram, parity: Parity, sensor: int) -> bool:
    """Return whether a sensor repeats its increment, as none does that has noise."""
    monitor = state.diagnostics
    repetition = monitor.gyro_repetition
    if parity.kind == ACCELEROMETERS:
        repetition = monitor.accelerometer_repetition
    if repetition.stuck >> sensor & 1:
        return True
    counts = parity.quantisation_variance * state.redundancy.second_epochs
    noisy = parity.white_variance[sensor] > _NOISY_COUNTS2 * counts
    return noisy and repetition.unchanged[sensor] >= monitor.stuck_epochs


@compiled
def _within_limits(trial: Parity, sensor: int) -> bool:
    """Return whether the bias of a sensor is as its data sheet says; the rest is in the parity."""
    bias = abs(trial.parity.coefficients[sensor, 0]) / trial.projector[sensor, sensor]
    return bias <= _LIMITS_TIMES * math.sqrt(trial.parity.prior[0])


@compiled
def _readmit(state: Ram, parity: Parity, fusion: Fusion, compared: Parity, sensor: int) -> None:
    """Use a sensor again from the next epoch on, less what was learned of it."""
    own = compared.projector[sensor, sensor]
    coefficients = compared.parity.coefficients
    for j in range(ABSOLUTE + fusion.count):
        constant = coefficients[sensor, j] / own
        parity.correction[sensor, j] += constant
        for i in range(fusion.count):
            coefficients[i, j] -= compared.projector[i, sensor] * constant
    parity.corrected = True
    parity.excluded &= ~(1 << sensor)
    parity.alarm = False
    parity.clear_seconds = 0
    parity.frozen = 0
    parity.readmitted = sensor
    parity.readmitted_epoch = state.epoch
    compared.expected.unit = parity.expected.unit
    learning.copy(compared.expected, parity.expected)
    state.redundancy.readmission.state = _RETURNING


@compiled
def hand_over(state: Ram, parity: Parity) -> None:
    """Know of the sensors in use what was learned in the test, once they are compared."""
    readmission = state.redundancy.readmission
    if readmission.state != _RETURNING or readmission.kind != parity.kind:
        return
    readmission.state = _READMITTED
    compared = _trial(state, parity)
    if compared.sensors == parity.sensors:
        learning.copy(parity.parity, compared.parity)
        learning.copy(parity.expected, compared.expected)
        parity.learning = compared.learning
