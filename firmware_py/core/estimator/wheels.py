"""The odometer as a measurement, with what a vehicle on wheels cannot do: move sideways or up.

A stretch is about a second: the odometer's distance between two of its counts, beside the way of
its wheel by the navigation, along the body's axes. Groves (2nd ed., 2013), sections 15.3, 15.4.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.aiding.wheel import FORWARD_AXIS, RIGHT_AXIS, UP_AXIS
from rrins.firmware_py.core.estimator import doubt
from rrins.firmware_py.core.maths import attitude
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    COMPONENTS,
    CORRECTIONS,
    DONE,
    NO_TRUST,
    PITCH,
    PIVOT,
    SCALE,
    VELOCITY,
    YAW,
    Aid,
    Estimator,
)
from rrins.firmware_py.core.records.memory import WHEEL_EPOCHS, Ram

_ODOMETER = int(Aid.ODOMETER)

_EVERY = (1 << COMPONENTS) - 1

FORWARD, ACROSS, UPWARD = 0, 1, 2
"""Components of a stretch."""


@compiled
def is_forward(aid: int, component: int) -> bool:
    """Return whether a measurement is the way forward, which the wheel counts."""
    return bool(aid == _ODOMETER and component == FORWARD)


@compiled
def begin(state: Ram) -> None:
    """Begin with the filter."""
    state.estimator.odometer_epoch = -1
    state.estimator.wheel_locked = False
    state.estimator.ways_refused = 0


@compiled
def finish_second(state: Ram) -> None:
    """Let the stretch up to the latest count wait as a measurement; begin the next one there."""
    estimator, odometer = state.estimator, state.odometer
    if odometer.interval_epochs == 0 or not odometer.available:
        estimator.odometer_epoch = -1
        return
    before, now = estimator.odometer_epoch, int(odometer.epoch)
    if not wheel.is_known(state.wheel, now) or now == before:
        return
    seconds = (now - before) * state.parameters.period_ns * 1e-9
    is_whole = before >= 0 and seconds <= wheel.LONGEST_S
    is_whole = is_whole and estimator.odometer_gaps == odometer.gaps
    if is_whole:
        estimator.wheel_locked &= estimator.stretch_m == 0.0  # it may have been, of a part of it
        estimator.stretch_m = odometer.travelled - estimator.odometer_travelled
        estimator.stretch_s = seconds
        track = state.wheel.track
        end, start = track[now % WHEEL_EPOCHS], track[before % WHEEL_EPOCHS]
        for i in range(3):
            estimator.stretch_b[i] = end[wheel.WAY + i] - start[wheel.WAY + i]
            estimator.lever_way_b[i] = end[wheel.LEVER_WAY + i] - start[wheel.LEVER_WAY + i]
            for k in range(3):
                at = wheel.ATTITUDE_B + 3 * i + k
                estimator.stretch_attitude[i, k] = (end[at] - start[at]) / seconds
        _correct_begin(state, before, now)
        dt = state.parameters.period_ns * 1e-9
        estimator.stretch_lag_s = (state.epoch - 0.5 * (before + now)) * dt
        estimator.stretch_turned = end[wheel.TURNED_B] - start[wheel.TURNED_B]
        components = 0b111 if estimator.vertical else 0b011
        estimator.waiting |= components << (COMPONENTS * _ODOMETER)
    estimator.odometer_epoch = now
    estimator.odometer_gaps = odometer.gaps
    estimator.odometer_travelled = odometer.travelled


@compiled
def _correct_begin(state: Ram, before: int, now: int) -> None:
    """Take the way as corrected within it: what was fed back was wrong before, too."""
    estimator, track = state.estimator, state.wheel.track
    start = track[before % WHEEL_EPOCHS]
    for k in range(CORRECTIONS):
        epoch = int(estimator.correction_epoch[k])
        if before < epoch <= now:
            then = track[epoch % WHEEL_EPOCHS]
            for i in range(3):
                for j in range(3):
                    at = wheel.ATTITUDE_B + 3 * j + i
                    change = (then[at] - start[at]) * estimator.correction[k, 3 + j]
                    estimator.stretch_b[i] += change


@compiled
def correct(state: Ram) -> None:
    """Take the way that waits as corrected by what is fed back now: it comes after it."""
    estimator, row, x = state.estimator, state.estimator.row, state.estimator.x
    if estimator.waiting >> (COMPONENTS * _ODOMETER) & _EVERY == 0:
        return
    for i in range(3):
        estimator.velocity_way[i] = estimator.stretch_b[i] - estimator.lever_way_b[i]
    for axis in range(3):
        row[: estimator.states] = 0.0
        _fill_row(state, estimator.stretch_attitude, axis)
        change = 0.0
        for i in range(estimator.states):
            change += row[i] * x[i]
        estimator.direction[axis] = change
    for axis in range(3):
        estimator.stretch_b[axis] += estimator.direction[axis]


@compiled
def _slip_sigma(estimator: Estimator, pivot: float) -> float:
    """Return the noise of the way across the forward axis, m: a vehicle that stands has less.

    `pivot` is the distance along the vehicle in which it turns about another point.
    """
    stands = wheel.stands(estimator.stretch_m, estimator.stretch_b, estimator.stretch_s)
    if stands and not estimator.wheel_locked:
        return float(wheel.STANDING_SLIP * estimator.stretch_s)
    slip = estimator.slip_sigma * estimator.stretch_s
    return math.hypot(slip, pivot * estimator.stretch_turned)


@compiled
def follow_slip(state: Ram, innovation: float) -> None:
    """Know less of the scale once the forward way is rejected for some seconds: the wheel slips.

    By as much as it seems to slip, so the inertial velocity finds the scale anew; not where the
    wheel counts less than half of the way.
    """
    estimator = state.estimator
    way = abs(estimator.stretch_m)
    at = BIASES + int(state.gyros.count) + int(state.accelerometers.count) + SCALE
    told = NO_TRUST + COMPONENTS  # so that the ways across, which are used, leave it rejected
    if estimator.sources[_ODOMETER].distrust < told or abs(innovation) >= way:
        return
    estimator.P[at, at] += (innovation / way) ** 2


@compiled
def refuse(estimator: Estimator) -> bool:
    """Note that the forward way is beyond the gate; return whether the one before was the first.

    In that one the fault began, so it was not there in all of it.
    """
    estimator.ways_refused += 1
    estimator.wheel_locked |= estimator.stretch_m == 0.0
    return bool(estimator.ways_refused == 2)


@compiled
def is_silent(estimator: Estimator, beyond: bool) -> bool:
    """Return whether the forward way of a locked wheel says nothing of a velocity or a fault.

    It is 0 whatever the vehicle does; so it does not count within the gate. Nor does the first one
    in which the wheel turns again, for it has not turned in all of it.
    """
    return bool(estimator.wheel_locked and not (beyond and estimator.stretch_m == 0.0))


@compiled
def skidded_m(estimator: Estimator) -> float:
    """Return by how much the stretch of the present innovation is longer than the way forward."""
    return float(estimator.stretch_m - estimator.vehicle_way[FORWARD_AXIS])


@compiled
def innovation(state: Ram, component: int) -> tuple[float, float]:
    """Write the row of a component of the stretch; return its innovation and sigma, m."""
    estimator, row = state.estimator, state.estimator.row
    first = BIASES + int(state.gyros.count) + int(state.accelerometers.count)
    _turn_to_vehicle(estimator)
    way, jolt = estimator.vehicle_way, _jolt_sigma(state)
    right, forward, up = way[RIGHT_AXIS], way[FORWARD_AXIS], way[UP_AXIS]
    sp, cp = estimator.C_b_v[FORWARD_AXIS, 2], estimator.C_b_v[UP_AXIS, 2]
    if component == FORWARD:
        _fill_row(state, estimator.vehicle_attitude, FORWARD_AXIS)
        row[first + SCALE] = -estimator.stretch_m
        row[first + YAW], row[first + PITCH] = cp * right, up
        measured = estimator.stretch_m * (1.0 + estimator.odometer[SCALE])
        return measured - forward, math.hypot(_forward_sigma(state), jolt)
    if component == ACROSS:
        _fill_row(state, estimator.vehicle_attitude, RIGHT_AXIS)
        row[first + YAW], row[first + PIVOT] = sp * up - cp * forward, estimator.stretch_turned
        right += estimator.odometer[PIVOT] * estimator.stretch_turned
        return -right, math.hypot(_slip_sigma(estimator, wheel.PIVOT_WANDERS), jolt)
    _fill_row(state, estimator.vehicle_attitude, UP_AXIS)
    row[first + YAW], row[first + PITCH] = -sp * right, -forward
    return -up, math.hypot(_slip_sigma(estimator, wheel.PIVOT_SIGMA), jolt)


@compiled
def _turn_to_vehicle(estimator: Estimator) -> None:
    """Write the way and the attitude along the vehicle's axes, as they are estimated.

    In a turn the wheel's point moves sideways, and a part of that is along a forward axis which is
    not the body's.
    """
    C_b_v, yaw, pitch = estimator.C_b_v, estimator.odometer[YAW], estimator.odometer[PITCH]
    sy, cy, sp, cp = math.sin(yaw), math.cos(yaw), math.sin(pitch), math.cos(pitch)
    C_b_v[RIGHT_AXIS, 0], C_b_v[RIGHT_AXIS, 1], C_b_v[RIGHT_AXIS, 2] = cy, -sy, 0.0
    C_b_v[FORWARD_AXIS, 0], C_b_v[FORWARD_AXIS, 1] = sy * cp, cy * cp
    C_b_v[FORWARD_AXIS, 2] = sp
    C_b_v[UP_AXIS, 0], C_b_v[UP_AXIS, 1], C_b_v[UP_AXIS, 2] = -sy * sp, -cy * sp, cp
    attitude.rotate(estimator.vehicle_way, C_b_v, estimator.stretch_b)
    attitude.rotate(estimator.velocity_way, C_b_v, estimator.lever_way_b)
    for i in range(3):
        estimator.velocity_way[i] = estimator.vehicle_way[i] - estimator.velocity_way[i]
    attitude.multiply_transposed(estimator.vehicle_attitude, estimator.stretch_attitude, C_b_v)


@compiled
def _forward_sigma(state: Ram) -> float:
    dt = state.parameters.period_ns * 1e-9
    return float(wheel.distance_sigma(state.odometer, dt, state.estimator.stretch_s))


@compiled
def _jolt_sigma(state: Ram) -> float:
    """Return by how much a way differs from its end's velocity times the time, m.

    A sensor's fault that began or ended within the stretch has not acted on all of it.
    """
    seconds = state.estimator.stretch_s
    return float(0.5 * doubt.jolt(state.estimator, state.epoch) * seconds * seconds)


@compiled
def _fill_row(state: Ram, C_b_n: Floats, axis: int) -> None:
    estimator = state.estimator
    row, matrix, seconds = estimator.row, estimator.transition, estimator.stretch_s
    wheel.fill_row(row, ATTITUDE, VELOCITY, C_b_n, estimator.velocity_way, seconds, axis)
    since = estimator.stretch_lag_s * seconds / estimator.seconds[DONE]
    first = BIASES + int(state.gyros.count)
    for i in range(3):  # tilt and biases have changed the velocity since the middle of the stretch
        along = since * C_b_n[i, axis]
        for k in range(3):
            row[ATTITUDE + k] -= along * matrix[VELOCITY + i, ATTITUDE + k]
        for k in range(state.accelerometers.count):
            row[first + k] -= along * matrix[VELOCITY + i, first + k]
