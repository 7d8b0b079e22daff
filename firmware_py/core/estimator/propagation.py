"""The filter over a second: transition and noise from what the strapdown summed, state and P."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.estimator import constants, covariance, transition
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    DONE,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    PRESENT,
    SENSOR_CONSTANTS,
    VELOCITY,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Fusion, Ins, Ram
from rrins.firmware_py.core.sensors.data_sheet import SCALE_TURN

LEAST_WALK, HOUR_S = 1e-4, 3600.0
"""Of a constant's sigma, in an hour: P must not become singular."""

_GRAVITY_GRADIENT = 2.0 * earth.GRAVITY_EQUATOR / earth.SEMI_MAJOR_AXIS
"""1/s²: gravity falls with the height. Groves (2nd ed., 2013), (14.64)."""


@compiled
def note(estimator: Estimator, ins: Ins, dtheta_s: Floats, dv_s: Floats, dt: float) -> None:
    """Add an epoch to the sums of the present second."""
    C_s_n = ins.C_s_n
    square = 0.0
    for i in range(3):
        estimator.force_n[PRESENT, i] += (
            C_s_n[i, 0] * dv_s[0] + C_s_n[i, 1] * dv_s[1] + C_s_n[i, 2] * dv_s[2]
        )
        estimator.turn_n[PRESENT, i] += (
            C_s_n[i, 0] * dtheta_s[0] + C_s_n[i, 1] * dtheta_s[1] + C_s_n[i, 2] * dtheta_s[2]
        )
        estimator.way_n[PRESENT, i] += ins.velocity_n[i] * dt
        square += dtheta_s[i] * dtheta_s[i]
        for k in range(3):
            estimator.attitude_s[PRESENT, i, k] += C_s_n[i, k] * dt
    estimator.turned[PRESENT] += square**0.5
    estimator.seconds[PRESENT] += dt


@compiled
def close(estimator: Estimator) -> None:
    """Put the sums of the present second aside, and begin the next."""
    estimator.turned[DONE], estimator.turned[PRESENT] = estimator.turned[PRESENT], 0.0
    estimator.seconds[DONE], estimator.seconds[PRESENT] = estimator.seconds[PRESENT], 0.0
    if estimator.constants:
        constants.close(estimator)
    for sums in (estimator.force_n, estimator.way_n, estimator.turn_n):
        copy(sums[DONE], sums[PRESENT])
        sums[PRESENT] = 0.0
    copy(estimator.attitude_s[DONE], estimator.attitude_s[PRESENT])
    estimator.attitude_s[PRESENT] = 0.0


@compiled
def fill(state: Ram) -> None:
    """Write the transition over the second that was put aside."""
    estimator, ins = state.estimator, state.ins
    response, matrix = estimator.response, estimator.transition
    dt, vertical = estimator.seconds[DONE], estimator.vertical
    transition.fill(
        response,
        estimator.force_n[DONE],
        estimator.way_n[DONE],
        dt,
        ins.latitude,
        ins.height,
        vertical,
    )
    for i in range(BIASES):
        for k in range(estimator.states):
            matrix[i, k] = 1.0 if i == k else 0.0
    for i in range(ATTITUDE + 6):
        for k in range(ATTITUDE + 6):
            matrix[i, k] = response[i, k]
        matrix[i, LATITUDE] = response[i, transition.LATITUDE]
    for k in range(ATTITUDE + 6):
        matrix[LATITUDE, k] = response[transition.LATITUDE, k]
        matrix[LONGITUDE, k] = response[transition.LONGITUDE, k]
    if vertical:
        up = VELOCITY + 2
        for k in range(ATTITUDE + 6):
            matrix[HEIGHT, k] = 0.5 * (response[up, k] + (1.0 if k == up else 0.0)) * dt
        matrix[up, HEIGHT] = _GRAVITY_GRADIENT * dt
        matrix[HEIGHT, HEIGHT] += 0.5 * _GRAVITY_GRADIENT * dt * dt
    gyros = int(state.gyros.count)
    for kind in range(2):
        fusion, first, column = state.gyros, BIASES, transition.TURN
        if kind == 1:
            fusion, first, column = state.accelerometers, BIASES + gyros, transition.CHANGE
        for k in range(fusion.count):
            _along(estimator, fusion, k)
            for i in range(BIASES):
                matrix[i, first + k] = -input_of(estimator, i, column)
            if estimator.constants:
                for error in range(SENSOR_CONSTANTS):
                    constants.write_direction(estimator, fusion, kind, error, k)
                    at = constants.state_of(state, error, kind, k)
                    for i in range(BIASES):
                        matrix[i, at] = -input_of(estimator, i, column)


@compiled
def _along(estimator: Estimator, fusion: Fusion, k: int) -> None:
    """Write the integral of what a unit of the sensor k adds in n, s, to `direction`."""
    for i in range(3):
        total = 0.0
        for j in range(3):
            total += estimator.attitude_s[DONE, i, j] * fusion.gain[j, k]
        estimator.direction[i] = total


@compiled
def input_of(estimator: Estimator, state: int, column: int) -> float:
    """Return what an input along `direction` does to a state of the filter."""
    row, share = state, 1.0
    if state == LATITUDE:
        row = transition.LATITUDE
    elif state == LONGITUDE:
        row = transition.LONGITUDE
    elif state == HEIGHT:
        row, share = VELOCITY + 2, 0.5 * estimator.seconds[DONE]
    total = 0.0
    for j in range(3):
        total += estimator.response[row, column + j] * estimator.direction[j]
    return share * total


@compiled
def propagate_state(estimator: Estimator) -> None:
    """Carry the errors over the second."""
    n, x = estimator.states, estimator.x
    for i in range(BIASES):
        total = 0.0
        for k in range(n):
            total += estimator.transition[i, k] * x[k]
        estimator.gain[i] = total
    for i in range(BIASES):
        x[i] = estimator.gain[i]


@compiled
def propagate_covariance(estimator: Estimator) -> None:
    """Carry P over the second, without noise."""
    n, matrix = estimator.states, estimator.transition
    covariance.propagate(estimator.P, n, BIASES, matrix, estimator.work)


@compiled
def add_noise(state: Ram) -> None:
    """Add the noise of a second: the sensors' white noise, and that their biases walk."""
    estimator, P = state.estimator, state.estimator.P
    dt = estimator.seconds[DONE]
    gyros = int(state.gyros.count)
    for kind in range(2):
        fusion, first, into = state.gyros, BIASES, ATTITUDE
        if kind == 1:
            fusion, first, into = state.accelerometers, BIASES + gyros, VELOCITY
        for k in range(fusion.count):
            _along(estimator, fusion, k)
            for i in range(3):
                estimator.direction[i] /= dt
            variance = estimator.white_variance[kind, k] * dt
            covariance.add_along(P, into, estimator.direction, variance)
            P[first + k, first + k] += estimator.walk_variance[kind, k] * dt
            P[first + k, first + k] += estimator.turn_variance[kind] * estimator.turned[DONE]
            if estimator.constants:
                for error in range(SENSOR_CONSTANTS):
                    at = constants.state_of(state, error, kind, k)
                    sigma = LEAST_WALK * estimator.constant_sigma[SENSOR_CONSTANTS * kind + error]
                    P[at, at] += sigma * sigma * dt / HOUR_S
    if estimator.altimeter:
        at = estimator.altimeter_state
        P[at, at] += estimator.altimeter_walk_variance * dt
    angle = estimator.slope_variance[0] * SCALE_TURN * estimator.turned[DONE]
    bridged = state.bridging.lag_variance
    angle += max(0.0, bridged[0] - estimator.bridged[0])
    speed = max(0.0, bridged[1] - estimator.bridged[1])
    copy(estimator.bridged, bridged)
    for i in range(3):
        P[ATTITUDE + i, ATTITUDE + i] += angle
        P[VELOCITY + i, VELOCITY + i] += speed
    if not estimator.vertical:
        for k in range(estimator.states):
            P[VELOCITY + 2, k] = 0.0
            P[k, VELOCITY + 2] = 0.0
