"""A filter of the bank: the navigation's error without a sensor, block after block.

Fourteen states: those of `transition` and two of the odometer. An error is what has to be added to
the navigation; in attitude it may be many degrees.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.estimator import covariance, transition
from rrins.firmware_py.core.estimator.transition import (
    ATTITUDE,
    CHANGE,
    FILTER_SIZE,
    TURN,
    VELOCITY,
)
from rrins.firmware_py.core.maths import attitude
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    BANK_STATES,
    GYROS,
    Bank,
    Hypothesis,
    Parity,
)
from rrins.firmware_py.core.redundancy import alike, blocks, pairs
from rrins.firmware_py.core.sensors.data_sheet import SCALE_TURN

_SCALE, _YAW = FILTER_SIZE, FILTER_SIZE + 1
"""States of the odometer."""

_OUTLIER = 16.0
"""Square of a normalised innovation beyond which a stretch does not agree with a filter: it counts
that much against it, and no more."""

_FORCE, _TURN, _CHANGE = 0, 1, 2
"""Inputs in n of a block that is propagated: m/s, rad and m/s."""

_GRAVITY_SHARE = 0.25
"""Share of a sensor's variance by gravity in a fused component of four: a third of the square of
gravity is along the sensor, and three quarters of a sensor's variance are in the component."""

_LEVEL, _HEADING, _VELOCITY = 1e-3, 1e-2, 30.0
"""Uncertainty of the navigation at the beginning, at least: rad, rad, m/s."""


@compiled
def begin(one: Hypothesis, gyros: Parity, accelerometers: Parity, block: Floats) -> None:
    """Begin before a block, of which this is what is not by sensor."""
    one.x[:] = 0.0
    one.P[:] = 0.0
    unsure_turn, unsure_change = block[blocks.UNSURE_BIAS], block[blocks.UNSURE_BIAS + 1]
    for i in range(3):
        level = _LEVEL if i < 2 else _HEADING
        one.P[ATTITUDE + i, ATTITUDE + i] = max(level**2, block[blocks.UNSURE + i])
        one.P[VELOCITY + i, VELOCITY + i] = _VELOCITY**2
        one.P[TURN + i, TURN + i] = max(gyros.bias_variance, unsure_turn)
        one.P[CHANGE + i, CHANGE + i] = max(accelerometers.bias_variance, unsure_change)
    distrust_wheel(one)


@compiled
def distrust_wheel(one: Hypothesis) -> None:
    """Know of scale and mounting of the odometer less by what is not known at first."""
    one.P[_SCALE, _SCALE] += wheel.SCALE_SIGMA**2
    one.P[_YAW, _YAW] += wheel.MOUNTING_SIGMA**2


@compiled
def _share(block: Floats, others: int, after: int, variance: int) -> float:
    """Return the share of a block up to the time of a reference in it; 1 where there is none."""
    if block[others + variance] == 0.0:
        return 1.0
    return float(min(1.0, block[others + after] / block[others + blocks.TIME]))


@compiled
def approach(state: Ram, one: Hypothesis, block: Floats) -> None:
    """Take a block up to its stretch, or all of it if there is none, and compare that."""
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    pairs.widen(state, one)
    fed_back = block[others + blocks.FED_BACK : others + blocks.FED_BACK + FILTER_SIZE]
    attitude.turn_back(one.x[ATTITUDE : ATTITUDE + 3], fed_back[:3], bank.error_q)
    for i in range(3, FILTER_SIZE):  # in the order of the states
        one.x[i] -= fed_back[i]
    fix_at = _share(block, others, blocks.MEASURED_AFTER, blocks.VARIANCE)
    stretch_at = _share(block, others, blocks.STRETCH_AFTER, blocks.DISTANCE_VARIANCE)
    one.reached = 0.0
    if fix_at <= stretch_at and block[others + blocks.VARIANCE] > 0.0:
        _reach(state, one, block, fix_at)
        _measure_velocity(state, one, block)
    _reach(state, one, block, stretch_at)
    if block[others + blocks.DISTANCE_VARIANCE] > 0.0 and bank.at >= bank.slips_until:
        bank.fits |= _measure_stretch(state, one, block, False)


@compiled
def leave(state: Ram, one: Hypothesis, block: Floats) -> None:
    """Measure the stretch of a block if it is used, and take the rest of the block."""
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    if bank.fits:
        _measure_stretch(state, one, block, True)
    fix_at = _share(block, others, blocks.MEASURED_AFTER, blocks.VARIANCE)
    if fix_at > one.reached and block[others + blocks.VARIANCE] > 0.0:
        _reach(state, one, block, fix_at)
        _measure_velocity(state, one, block)
    _reach(state, one, block, 1.0)


@compiled
def _reach(state: Ram, one: Hypothesis, block: Floats, share: float) -> None:
    """Propagate a filter to a share of the block."""
    if share > one.reached:
        _propagate(state, one, block, share - one.reached)
        one.reached = share


@compiled
def _is_free(state: Ram) -> bool:
    """Return whether errors of the vertical velocity last."""
    return bool(state.parameters.height_channel == strapdown.HEIGHT_FREE)


@compiled
def components(state: Ram) -> int:
    """Return how many components of a velocity tell something."""
    return 3 if _is_free(state) else 2


@compiled
def _measure_velocity(state: Ram, one: Hypothesis, block: Floats) -> None:
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    for i in range(components(state)):
        innovation, expected = covariance.measure(
            one.x,
            one.P,
            VELOCITY + i,
            block[others + blocks.MEASURED + i],
            block[others + blocks.VARIANCE],
            bank.gain,
            bank.work,
        )
        square = innovation * innovation / expected
        one.squares += square
        one.score += square + math.log(expected)


@compiled
def _measure_stretch(state: Ram, one: Hypothesis, block: Floats, uses: bool) -> bool:
    """Compare the way along and across the vehicle's forward axis with the odometer's.

    Returns whether both agree. With `uses` the filter takes them as measurements.
    """
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    seconds, row, fits = block[others + blocks.STRETCH_S], bank.row, True
    for i in range(3):
        bank.way_b[i] = block[others + blocks.STRETCH_WAY + i]
        bank.velocity_way_b[i] = bank.way_b[i] - block[others + blocks.STRETCH_LEVER_WAY + i]
        for k in range(3):
            integral = block[others + blocks.STRETCH_ATTITUDE + 3 * i + k]
            bank.attitude_b[i, k] = integral / seconds
    for axis in (wheel.FORWARD_AXIS, wheel.RIGHT_AXIS):
        row[:] = 0.0
        wheel.fill_row(row, ATTITUDE, VELOCITY, bank.attitude_b, bank.velocity_way_b, seconds, axis)
        innovation = -bank.way_b[axis]
        variance = block[others + blocks.SLIP_VARIANCE]
        if axis == wheel.FORWARD_AXIS:
            row[_SCALE] = -block[others + blocks.TRAVELLED]
            row[_YAW] = bank.way_b[wheel.RIGHT_AXIS]
            innovation += block[others + blocks.TRAVELLED]
            variance = block[others + blocks.DISTANCE_VARIANCE]
        else:
            row[_YAW] = -bank.way_b[wheel.FORWARD_AXIS]
        for i in range(BANK_STATES):
            innovation -= row[i] * one.x[i]
        expected = covariance.expect(one.P, BANK_STATES, row, variance, bank.gain)
        square = innovation * innovation / expected
        fits = fits and square < _OUTLIER
        if uses:
            covariance.update(one.x, one.P, BANK_STATES, bank.gain, innovation, expected)
            one.squares += min(_OUTLIER, square)
            one.score += min(_OUTLIER, square) + math.log(expected)
    return fits


@compiled
def _propagate(state: Ram, one: Hypothesis, block: Floats, share: float) -> None:
    """Propagate a filter over a share of a block.

    A heading may be off by many degrees: what the block has along the navigation's axes is turned
    by the filter's own error of the attitude.
    """
    bank, ins = state.redundancy.bank, state.ins
    others = state.redundancy.repair.stride - blocks.OTHERS
    force, turn, change = bank.inputs[_FORCE], bank.inputs[_TURN], bank.inputs[_CHANGE]
    way, noise = bank.inputs[3], bank.inputs[4]
    dt = block[others + blocks.TIME] * share
    for i in range(3):
        force[i] = block[others + blocks.FORCE + i] * share
        way[i] = block[others + blocks.WAY + i] * share
        turn[i] = _changed(bank, one, GYROS, block, i) * share
        change[i] = (
            _changed(bank, one, ACCELEROMETERS, block, 3 * int(state.gyros.count) + i) * share
        )
        for k in range(3):
            bank.attitude_s[i, k] = block[others + blocks.ATTITUDE + 3 * i + k] * share
    _turn_by_error(bank, one)
    transition.fill(bank.response, force, way, dt, ins.latitude, ins.height, _is_free(state))
    transition.of_biases(bank.transition, bank.response, bank.attitude_s)
    for i in range(FILTER_SIZE):
        total = 0.0
        for k in range(FILTER_SIZE):
            total += bank.transition[i, k] * one.x[k]
        if i < TURN:
            for k in range(3):
                total += bank.response[i, TURN + k] * turn[k]
                total += bank.response[i, CHANGE + k] * change[k]
        bank.gain[i] = total
    copy(one.x[:FILTER_SIZE], bank.gain)
    covariance.propagate(one.P, BANK_STATES, FILTER_SIZE, bank.transition, bank.work)
    _add_noise(state, one, block[others + blocks.TURNED], share)
    one.P[_SCALE, _SCALE] += wheel.SCALE_WALK**2 * dt
    parity, into = state.redundancy.gyros, ATTITUDE
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, into = state.redundancy.accelerometers, VELOCITY
        shown = int(one.sensor[kind])
        if kind == ACCELEROMETERS and one.noisy >= 0:
            shown = int(one.noisy)
        if shown == -1:
            continue
        direction_s = bank.direction_s
        sensor = alike.direct(parity, shown, bank.alike[kind], direction_s)
        for i in range(3):  # of the residual that takes the sensor's place
            noise[i] = 0.0
            for k in range(3):
                noise[i] += bank.attitude_s[i, k] * direction_s[k] / dt
        uncertain = block[others + blocks.UNCERTAIN + kind]
        learned = parity.learning_variance[sensor] * uncertain
        covariance.add_along(one.P, into, noise, (parity.second_variance[sensor] + learned) * share)


@compiled
def _turn_by_error(bank: Bank, one: Hypothesis) -> None:
    """Turn what a block has in n by the error ψ of the attitude; turns by half of it.

    For turns add up as rotation vectors: ``exp(φ) exp(ψ)`` is that of ψ + φ + φ × ψ / 2. What ψ
    makes of the force beyond the linear term is a change of the velocity.
    """
    psi, scratch, turned = one.x[ATTITUDE : ATTITUDE + 3], bank.inputs[4], bank.row
    for i in range(3):
        scratch[i] = 0.5 * psi[i]
    attitude.quaternion_of_vector(bank.error_q[0], scratch)
    attitude.matrix_of_quaternion(bank.error_C, bank.error_q[0])
    _turn_in_place(bank, bank.inputs[_TURN])
    for k in range(3):
        for i in range(3):
            scratch[i] = bank.attitude_s[i, k]
        _turn_in_place(bank, scratch)
        for i in range(3):
            bank.attitude_s[i, k] = scratch[i]
    attitude.quaternion_of_vector(bank.error_q[0], psi)
    attitude.matrix_of_quaternion(bank.error_C, bank.error_q[0])
    copy(scratch, bank.inputs[_FORCE])
    _turn_in_place(bank, bank.inputs[_FORCE])
    _turn_in_place(bank, bank.inputs[_CHANGE])
    attitude.cross(turned, psi, bank.inputs[_FORCE])
    for i in range(3):
        bank.inputs[_CHANGE, i] += bank.inputs[_FORCE, i] - scratch[i] - turned[i]


@compiled
def _turn_in_place(bank: Bank, vector: Floats) -> None:
    """Turn a vector by `error_C`."""
    attitude.rotate(bank.row, bank.error_C, vector)
    copy(vector, bank.row[:3])


@compiled
def _changed(bank: Bank, one: Hypothesis, kind: int, block: Floats, first: int) -> float:
    """Return a component of the change of the vector that a hypothesis makes in a block."""
    total = 0.0
    for k in range(SENSOR_GROUPS):
        if bank.sensors[kind] >> k & 1:
            weight = alike.weight_of(int(one.sensor[kind]), bank.alike[kind], k)
            total += weight * block[first + 3 * k]
    return total


@compiled
def _add_noise(state: Ram, one: Hypothesis, turned: float, share: float) -> None:
    """Add the noise of the fused vectors, and that the biases change."""
    gyros, accelerometers = state.redundancy.gyros, state.redundancy.accelerometers
    turned_variance = (gyros.vector_variance + gyros.slope_variance * SCALE_TURN * turned) * share
    velocity = accelerometers.vector_variance * share
    for i in range(3):
        one.P[ATTITUDE + i, ATTITUDE + i] += turned_variance
        one.P[VELOCITY + i, VELOCITY + i] += velocity
        one.P[TURN + i, TURN + i] += _walk(gyros, turned) * share
        one.P[CHANGE + i, CHANGE + i] += _walk(accelerometers, turned) * share


@compiled
def _walk(parity: Parity, turned: float) -> float:
    """Return by how much the variance of a fused component's bias grows."""
    return float(parity.parity.walk[0] + _GRAVITY_SHARE * parity.turn_variance * turned)
