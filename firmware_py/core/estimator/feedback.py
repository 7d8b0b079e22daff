"""The filter's estimates go to the navigation and to the compensation of the sensors."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.estimator import constants, receiver, sway
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    CORRECTIONS,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    ODOMETER_STATES,
    SENSOR_CONSTANTS,
    VELOCITY,
)
from rrins.firmware_py.core.records.memory import Fusion, Ram


@compiled
def compensate(state: Ram) -> None:
    """Remove the estimated errors of the sensors from the fused vectors of this epoch.

    Not from the sensors: what the redundancy has learned of them stays as it is.
    """
    estimator, dt = state.estimator, state.parameters.period_ns * 1e-9
    _remove(state.gyros, estimator.gyro_bias, state.dtheta_s, dt)
    _remove(state.accelerometers, estimator.accelerometer_bias, state.dv_s, dt)
    if estimator.constants:
        fusion, fused = state.gyros, state.dtheta_s
        for kind in range(2):
            if kind == 1:
                fusion, fused = state.accelerometers, state.dv_s
            constants.remove(estimator, fusion, kind, fused)


@compiled
def _remove(fusion: Fusion, bias: Floats, fused: Floats, dt: float) -> None:
    for i in range(3):
        total = 0.0
        for k in range(fusion.count):
            total += fusion.gain[i, k] * bias[k]
        fused[i] -= total * dt


@compiled
def _note(state: Ram) -> None:
    """Note what is about to change, for filters of the redundancy that look at the past.

    Changes of scale factors and installation errors are left out: they are small once a source
    aids the navigation, and the filters' thresholds have room for them.
    """
    estimator, x = state.estimator, state.estimator.x
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    for i in range(3):
        estimator.fed_back[i] += x[ATTITUDE + i]
        estimator.fed_back[3 + i] += x[VELOCITY + i]
        for k in range(gyros):
            estimator.fed_back[6 + i] -= state.gyros.gain[i, k] * x[BIASES + k]
        for k in range(accelerometers):
            gain = state.accelerometers.gain[i, k]
            estimator.fed_back[9 + i] -= gain * x[BIASES + gyros + k]


@compiled
def apply(state: Ram) -> None:
    """Add the filter's errors to the navigation, to its past and to the biases; clear them."""
    estimator, ins, x = state.estimator, state.ins, state.estimator.x
    _note(state)
    strapdown.turn(ins, x[:3])
    if state.odometer.interval_epochs > 0:
        wheel.turn_lever(state)
    number = estimator.corrections % CORRECTIONS
    estimator.corrections += 1
    estimator.correction_epoch[number] = state.epoch
    for i in range(3):
        ins.velocity_n[i] += x[VELOCITY + i]
        estimator.velocity_n[i] += x[VELOCITY + i]
        estimator.correction[number, 3 + i] = x[VELOCITY + i]
        estimator.correction[number, i] = x[LATITUDE + i]
    ins.latitude += x[LATITUDE]
    ins.longitude = earth.wrapped(ins.longitude + x[LONGITUDE])
    ins.height += x[HEIGHT]
    estimator.latitude += x[LATITUDE]
    estimator.longitude = earth.wrapped(estimator.longitude + x[LONGITUDE])
    estimator.height += x[HEIGHT]
    estimator.height_sum -= estimator.heights * x[HEIGHT]
    estimator.height_difference -= x[HEIGHT] + estimator.height_after_s * x[VELOCITY + 2]
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    for k in range(gyros):
        estimator.gyro_bias[k] += x[BIASES + k]
    for k in range(accelerometers):
        estimator.accelerometer_bias[k] += x[BIASES + gyros + k]
    if state.odometer.interval_epochs > 0:
        for i in range(ODOMETER_STATES):
            estimator.odometer[i] += x[BIASES + gyros + accelerometers + i]
    if estimator.constants:
        for error in range(SENSOR_CONSTANTS):
            for k in range(gyros):
                estimator.constant[error, k] += x[constants.state_of(state, error, 0, k)]
            for k in range(accelerometers):
                at = constants.state_of(state, error, 1, k)
                estimator.constant[SENSOR_CONSTANTS + error, k] += x[at]
    if estimator.altimeter:
        estimator.altimeter_bias += x[estimator.altimeter_state]
    if estimator.sway:
        sway.carry(estimator)
    if estimator.receiver:
        receiver.carry(estimator)
    for i in range(BIASES):
        estimator.applied[i] = x[i]
    x[:] = 0.0
