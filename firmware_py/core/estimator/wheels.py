"""The odometer as a measurement, with what a vehicle on wheels cannot do: move sideways or up.

A stretch is about a second: the odometer's distance between two of its counts, beside the way of
its wheel by the navigation, along the body's axes. Groves (2nd ed., 2013), sections 15.3, 15.4.
"""

from __future__ import annotations

import math

from rrins.dbc.compilation import compiled
from rrins.firmware_py.core.attitude import multiply_transposed
from rrins.firmware_py.core.estimator_records import (
    ATTITUDE,
    BIASES,
    COMPONENTS,
    PITCH,
    SCALE,
    TRACK_EPOCHS,
    VELOCITY,
    YAW,
    Aid,
    Estimator,
)
from rrins.firmware_py.core.memory import Ram

_ODOMETER = int(Aid.ODOMETER)

FORWARD, ACROSS, UPWARD = 0, 1, 2
"""Components of a stretch."""

_RIGHT_AXIS, _FORWARD_AXIS, _UP_AXIS = 0, 1, 2

_STANDS_BELOW = 0.3
"""m/s, of the navigation, with which a wheel that stands is one of a vehicle that stands."""

_STANDING_SLIP = 0.005
"""m/s, across the forward axis, of a vehicle whose wheels stand: it sways on its springs."""

_LONGEST_S = 2.5
"""A stretch that is longer has lost its odometer in between."""


@compiled
def begin(state: Ram) -> None:
    """Begin with the filter."""
    estimator = state.estimator
    estimator.odometer_epoch = -1
    _turn_lever(state)
    for i in range(3):
        estimator.way_b[i] = 0.0


@compiled
def _turn_lever(state: Ram) -> None:
    """Write the body's attitude, and the lever arm in n."""
    estimator, lever_b = state.estimator, state.odometer.lever_arm_b
    multiply_transposed(estimator.C_b_n, state.ins.C_s_n, state.C_s_b)
    for i in range(3):
        estimator.lever_n[i] = (
            estimator.C_b_n[i, 0] * lever_b[0]
            + estimator.C_b_n[i, 1] * lever_b[1]
            + estimator.C_b_n[i, 2] * lever_b[2]
        )


@compiled
def note(state: Ram, dt: float) -> None:
    """Add this epoch to the way of the wheel."""
    estimator, ins = state.estimator, state.ins
    if state.odometer.interval_epochs == 0:
        return
    for i in range(3):
        middle = ins.velocity_n[i] - 0.5 * ins.velocity_change_n[i]
        estimator.direction[i] = middle * dt - estimator.lever_n[i]
    _turn_lever(state)
    C_b_n = estimator.C_b_n
    for i in range(3):
        estimator.direction[i] += estimator.lever_n[i]
    for k in range(3):
        estimator.way_b[k] += (
            C_b_n[0, k] * estimator.direction[0]
            + C_b_n[1, k] * estimator.direction[1]
            + C_b_n[2, k] * estimator.direction[2]
        )


@compiled
def finish_second(state: Ram) -> None:
    """Let the stretch up to the latest count wait as a measurement; begin the next one there."""
    estimator, odometer = state.estimator, state.odometer
    if odometer.interval_epochs == 0 or not odometer.available:
        estimator.odometer_epoch = -1
        return
    before, now = estimator.odometer_epoch, int(odometer.epoch)
    if now < max(estimator.track_first, state.epoch - TRACK_EPOCHS + 1) or now == before:
        return
    seconds = (now - before) * state.parameters.period_ns * 1e-9
    is_whole = before >= 0 and seconds <= _LONGEST_S and estimator.odometer_gaps == odometer.gaps
    if is_whole:
        estimator.stretch_m = odometer.travelled - estimator.odometer_travelled
        estimator.stretch_s = seconds
        end, start = estimator.track[now % TRACK_EPOCHS], estimator.track[before % TRACK_EPOCHS]
        for i in range(3):
            estimator.stretch_b[i] = end[6 + i] - start[6 + i]
        components = 0b111 if estimator.vertical else 0b011
        estimator.waiting |= components << (COMPONENTS * _ODOMETER)
    estimator.odometer_epoch = now
    estimator.odometer_gaps = odometer.gaps
    estimator.odometer_travelled = odometer.travelled


@compiled
def _stands(estimator: Estimator) -> bool:
    """Return whether the wheel did not turn, and is not merely locked."""
    way_b, seconds = estimator.stretch_b, estimator.stretch_s
    way = math.sqrt(way_b[0] ** 2 + way_b[1] ** 2 + way_b[2] ** 2)
    return bool(estimator.stretch_m == 0.0 and way < _STANDS_BELOW * seconds)


@compiled
def _slip_sigma(estimator: Estimator) -> float:
    """Return the noise of the way across the forward axis, m: a vehicle that stands has less."""
    sigma = _STANDING_SLIP if _stands(estimator) else estimator.slip_sigma
    return float(sigma * estimator.stretch_s)


@compiled
def innovation(state: Ram, component: int) -> tuple[float, float]:
    """Write the row of a component of the stretch; return its innovation and sigma, m."""
    estimator = state.estimator
    way_b, first = estimator.stretch_b, BIASES + int(state.gyros.count)
    first += int(state.accelerometers.count)
    forward = way_b[_FORWARD_AXIS]
    if component == FORWARD:
        _fill_row(state, _FORWARD_AXIS)
        estimator.row[first + SCALE] = -estimator.stretch_m
        measured = estimator.stretch_m * (1.0 + estimator.odometer[SCALE])
        return measured - forward, _forward_sigma(state)
    if component == ACROSS:
        _fill_row(state, _RIGHT_AXIS)
        estimator.row[first + YAW] = -forward
        across = way_b[_RIGHT_AXIS] - estimator.odometer[YAW] * forward
        return -across, _slip_sigma(estimator)
    _fill_row(state, _UP_AXIS)
    estimator.row[first + PITCH] = -forward
    upward = way_b[_UP_AXIS] - estimator.odometer[PITCH] * forward
    return -upward, _slip_sigma(estimator)


@compiled
def _forward_sigma(state: Ram) -> float:
    """Return the noise of a stretch's distance, m: of each interval, and of its last pulse."""
    odometer, seconds = state.odometer, state.estimator.stretch_s
    interval = odometer.interval_epochs * state.parameters.period_ns * 1e-9
    noise = odometer.noise * math.sqrt(interval * seconds)
    return math.sqrt(noise * noise + odometer.metres_per_pulse**2 / 6.0)


@compiled
def _fill_row(state: Ram, axis: int) -> None:
    """Write what velocity and attitude do to the way along an axis of the body.

    ``C_n_b velocity`` and ``[way_b x] C_n_b attitude``: a body that is turned takes another part of
    the velocity for its own.
    """
    estimator = state.estimator
    C_b_n, way_b, row = estimator.C_b_n, estimator.stretch_b, estimator.row
    one, two = (axis + 1) % 3, (axis + 2) % 3
    for i in range(3):
        row[VELOCITY + i] = C_b_n[i, axis] * estimator.stretch_s
        row[ATTITUDE + i] = way_b[one] * C_b_n[i, two] - way_b[two] * C_b_n[i, one]
