"""The filter beside the strapdown: sums in each epoch, and a second's work in small pieces.

At the end of a second the filter's errors of the second before are carried over it and fed back;
then the covariance follows, then the measurements of the second's end, and those that come until
the next. A piece is done in an epoch, so no epoch pays for all.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled, compiled_with
from rrins.firmware_py.core.estimator import (
    constants,
    doubt,
    fault_effects,
    feedback,
    history,
    lockout,
    measurements,
    propagation,
    receiver,
    standstill,
    sway,
    wheels,
)
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.modes import modes
from rrins.firmware_py.core.navigation import alignment
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    ODOMETER_STATES,
    SENSOR_CONSTANTS,
    VELOCITY,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Ram

_TRANSITION, _COVARIANCE, _NOISE, _MEASUREMENTS = 1, 2, 3, 4
"""The pieces of work, in order."""

_DOUBT = 10.0
"""By how much less is known of the attitude after a sensor failed in the fine alignment."""

_PIECES = 24
"""Of a second, at most: with fewer epochs in a second, several are done in one."""


@compiled_with(is_unit=True)
def follow(state: Ram) -> None:
    """Follow the strapdown over this epoch, which it has navigated."""
    estimator = state.estimator
    if not modes.is_inertial(state):
        estimator.running = False
        return
    history.count_alignment(state)
    if not estimator.running or state.ins.first or estimator.begins_anew:
        begin(state)
        return
    dt = state.parameters.period_ns * 1e-9
    propagation.note(estimator, state.ins, state.dtheta_s, state.dv_s, dt)
    if estimator.constants:
        constants.note(state)
    standstill.note(state)
    measurements.note(state)
    estimator.epochs += 1
    if estimator.epochs == estimator.second_epochs:
        _finish_second(state)
        return
    for _ in range(1 + _PIECES // estimator.second_epochs):
        _work(state)


@compiled
def begin(state: Ram) -> None:
    """Begin with what is known of the attitude, and with unknown biases."""
    estimator, P = state.estimator, state.estimator.P
    estimator.running = True
    larger = _DOUBT if estimator.begins_anew else 1.0
    estimator.begins_anew = False
    copy(estimator.bridged, state.bridging.lag_variance)
    doubt.begin(estimator)
    estimator.fed_back[:] = 0.0
    estimator.turned[:] = 0.0
    estimator.seconds[:] = 0.0
    estimator.force_n[:] = 0.0
    estimator.way_n[:] = 0.0
    estimator.turn_n[:] = 0.0
    estimator.attitude_s[:] = 0.0
    estimator.x[:] = 0.0
    estimator.applied[:] = 0.0
    estimator.sigma[:] = 0.0
    P[:] = 0.0
    estimator.gyro_bias[:] = 0.0
    estimator.accelerometer_bias[:] = 0.0
    estimator.odometer[:] = 0.0
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    _stand_here(state)
    estimator.epochs = 0
    estimator.stage = _MEASUREMENTS
    coarse = state.alignment
    gained = alignment.gained_velocity(coarse)
    velocity_sigma = max(estimator.velocity_sigma, coarse.velocity_sigma, gained)
    position_sigma = max(
        estimator.start_sigma, coarse.position_sigma, gained * alignment.SETS_OFF_S
    )
    for i in range(3):
        variance = estimator.attitude_sigma[i] ** 2 + coarse.noise_sigma[i] ** 2
        P[ATTITUDE + i, ATTITUDE + i] = larger * larger * variance
        P[VELOCITY + i, VELOCITY + i] = velocity_sigma**2
    P[LATITUDE, LATITUDE] = (position_sigma / estimator.north_radius) ** 2
    P[LONGITUDE, LONGITUDE] = (position_sigma / estimator.east_radius) ** 2
    if estimator.vertical:
        P[HEIGHT, HEIGHT] = position_sigma**2
    else:
        P[VELOCITY + 2, VELOCITY + 2] = 0.0
    for k in range(gyros):
        P[BIASES + k, BIASES + k] = estimator.bias_sigma[0] ** 2
    for k in range(accelerometers):
        P[BIASES + gyros + k, BIASES + gyros + k] = estimator.bias_sigma[1] ** 2
    if state.odometer.interval_epochs > 0:
        first = BIASES + gyros + accelerometers
        for i in range(ODOMETER_STATES):
            P[first + i, first + i] = estimator.odometer_sigma[i] ** 2
    if estimator.constants:
        _forget_constants(state)
    if estimator.altimeter:
        at = estimator.altimeter_state
        estimator.altimeter_bias = 0.0
        P[at, at] = estimator.altimeter_bias_sigma**2
    if estimator.sway:
        sway.begin(estimator, position_sigma)
    if estimator.receiver:
        receiver.begin(estimator)
    measurements.begin(state)
    wheels.begin(state)
    standstill.begin(state)
    lockout.begin(estimator)
    if state.integrity.enabled:
        fault_effects.begin(state)
    _note_sigma(estimator)


@compiled
def _note_sigma(estimator: Estimator) -> None:
    """Note what P says of the navigation that has the corrections up to now, and no later ones."""
    for i in range(estimator.states):
        estimator.sigma[i] = math.sqrt(max(0.0, estimator.P[i, i]))


@compiled
def _forget_constants(state: Ram) -> None:
    estimator = state.estimator
    constants.forget(estimator)
    for error in range(SENSOR_CONSTANTS):
        for k in range(state.gyros.count):
            at = constants.state_of(state, error, 0, k)
            estimator.P[at, at] = estimator.constant_sigma[error] ** 2
        for k in range(state.accelerometers.count):
            at = constants.state_of(state, error, 1, k)
            estimator.P[at, at] = estimator.constant_sigma[SENSOR_CONSTANTS + error] ** 2


@compiled
def _stand_here(state: Ram) -> None:
    """Let the filter stand at the end of this epoch."""
    estimator, ins = state.estimator, state.ins
    meridian, prime_vertical = earth.radii(ins.latitude)
    estimator.epoch = state.epoch
    estimator.latitude = ins.latitude
    estimator.longitude = ins.longitude
    estimator.height = ins.height
    estimator.north_radius = meridian + ins.height
    estimator.east_radius = (prime_vertical + ins.height) * math.cos(ins.latitude)
    copy(estimator.velocity_n, ins.velocity_n)


@compiled
def _finish_second(state: Ram) -> None:
    """Do what is left of the second before, and begin the work on this one."""
    estimator = state.estimator
    while estimator.stage <= _NOISE or estimator.waiting != 0:
        _work(state)
    lockout.follow(state)
    doubt.note_past(state)
    estimator.epochs = 0
    estimator.stage = _TRANSITION
    propagation.close(estimator)
    measurements.finish_second(state)
    _stand_here(state)
    standstill.finish_second(state)
    measurements.stand(state)
    wheels.finish_second(state)


@compiled
def _work(state: Ram) -> None:
    """Do the next piece of work."""
    estimator = state.estimator
    if estimator.stage == _TRANSITION:
        propagation.fill(state)
        propagation.propagate_state(estimator)
        doubt.bend(state)
        wheels.correct(state)
        feedback.apply(state)
        if estimator.doubts:
            doubt.tell(state)
    elif estimator.stage == _COVARIANCE:
        propagation.propagate_covariance(estimator)
        doubt.propagate(state)
        if state.integrity.enabled:
            fault_effects.propagate(state)
        if estimator.sway:
            sway.propagate(estimator, state.alignment.position_sigma)
        if estimator.receiver:
            receiver.propagate(estimator)
    elif estimator.stage == _NOISE:
        propagation.add_noise(state)
        doubt.change(state)
        doubt.confine(estimator)
        if estimator.settles != 0:
            doubt.settle(state)
        _note_sigma(estimator)
        history.note(state)
    else:
        measurements.take(state)
        return
    estimator.stage += 1
