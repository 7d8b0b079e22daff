"""The encoders against the gyros and the commands: finds one that is wrong, and does without it.

The gyros feel the table and the vehicle turn, the encoders see the table alone, and the command
says how it ought to turn. Two tests, for each axis:

- A *jump*: the encoder's increment changes by more than the drive can accelerate, and the gyros do
  not feel it. Found in the epoch itself, in any motion, if it is larger than the vehicle can turn
  meanwhile. The angle goes on without it: reading less offset.
- A *contradiction*: over the last 20 s, encoder and gyros have come apart, while gyros and command
  have agreed all the time. Two of three are right, so neither a vehicle that turns nor a gyro that
  fails is taken for a wrong encoder. Found while the vehicle stands or drives straight. The angle
  goes on with the gyros' increments, or the command's while the gyros feel the vehicle turn.

What neither finds, in a vehicle that turns, shows as an angle that strays from the commanded one;
it is in the bound of the heading (`doubtful_deg`).

An encoder whose offset has not moved for 10 s and 10° of turning is used again, less that
offset; without one when the offset is gone.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.dbc.codec import unwrapped
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.angles import turn_to
from rrins.firmware_py.core.navigation.strapdown import parallel
from rrins.firmware_py.core.records.encoder_records import AngleSource, Encoders
from rrins.firmware_py.core.records.memory import INNER, OUTER, Assembly, Ins, Parameters, Ram
from rrins.firmware_py.core.turntable import sequencer

_ENCODER, _CORRECTED = int(AngleSource.ENCODER), int(AngleSource.CORRECTED)
_GYROS, _COMMAND = int(AngleSource.GYROS), int(AngleSource.COMMAND)

_VEHICLE_DPS2 = 200.0
"""No vehicle changes its rate faster for long."""

_ACCELERATIONS = 8.0  # of an axis, above the limit of the slower: a change that no drive makes
_STEPS = 3.0  # of an encoder: what rounding makes of a steady rate
_LATE_EPOCHS = 3.0  # by which an axis lags its command, and a share of which a gyro may lag it
_APART_DEG, _CLOSE = 0.05, 0.25
_MEMORY_S = 20.0
_OBEDIENT_S = 2.0
_PATIENCE_EPOCHS = 20  # of jumps in a row, or without a frame
_AGREED_S, _AGREED_DEG = 10.0, 10.0
_MOVED_DEG = 0.02
_HEALED_DEG = 0.05
_FELT = 0.25  # share of what an angle strays that gyros may not feel, for noise and a slight turn
_ROUNDED = 2.0  # steps of an encoder by which an angle may stray
_COASTED = 1.25  # an axis turns on a little while a scheme is stopped because it lags
_UNCERTAIN = 0.2  # of the smallest jump found, error of each


@compiled
def _heal_or_correct(encoders: Encoders, axis: int) -> None:
    """Use the encoder again, less its offset, if there is one left."""
    encoders.source[axis] = _CORRECTED
    if abs(encoders.offset_deg[axis]) <= encoders.uncertain_deg[axis]:
        encoders.source[axis] = _ENCODER
        encoders.offset_deg[axis] = 0.0
        encoders.uncertain_deg[axis] = 0.0


@compiled
def _find(encoders: Encoders, axis: int, source: int, epoch: int) -> None:
    """Note that the encoder is wrong; what is used instead is `source`."""
    if encoders.source[axis] == _ENCODER:
        encoders.found_epoch[axis] = epoch + 1
    encoders.source[axis] = source


@compiled
def _replace(encoders: Encoders, axis: int, epoch: int) -> None:
    """Go on without the encoder, and without what it has said wrongly."""
    _find(encoders, axis, _GYROS, epoch)
    missed_deg = encoders.missed_deg[axis]
    if abs(missed_deg) > 2.0 * abs(encoders.contradiction_deg[axis]):
        missed_deg = encoders.contradiction_deg[axis]  # the gyros drift: not since long ago
    encoders.angle_deg[axis] -= missed_deg
    encoders.contradiction_deg[axis] = 0.0
    encoders.jumping_epochs[axis] = 0
    encoders.agreed_epochs[axis] = 0
    encoders.agreed_deg[axis] = 0.0


@compiled
def _jump_deg(encoders: Encoders, parameters: Parameters, axis: int, turned_deg: float) -> float:
    """Return by how much the encoder has jumped since its last reading; 0: not at all.

    The vehicle is taken to turn as fast as before.
    """
    seconds = parameters.period_ns * 1e-9
    epochs = float(encoders.since_epochs[axis])
    rounding_deg = _STEPS * encoders.step_deg * epochs
    before_deg = encoders.increment_deg[axis]
    vehicle_deg = epochs * (before_deg - encoders.gyro_deg[axis])
    jump_deg = turned_deg - encoders.since_deg[axis] - vehicle_deg
    limit_deg = smallest_jump_deg(parameters) * epochs * epochs + rounding_deg
    if not encoders.since_known[axis] or abs(jump_deg) <= limit_deg:
        return 0.0
    if epochs == 1.0:
        change_deg = abs(turned_deg - before_deg)
        drive_deg = _ACCELERATIONS * parameters.axis_acceleration_dps2 * seconds * seconds
        if change_deg <= drive_deg + rounding_deg or abs(jump_deg) <= 0.5 * change_deg:
            return 0.0
    return jump_deg


@compiled
def smallest_jump_deg(parameters: Parameters) -> float:
    """Return the smallest jump that is found in any motion of the vehicle, plus rounding."""
    seconds = parameters.period_ns * 1e-9
    return (_VEHICLE_DPS2 * seconds + 2.0 * parameters.turn_rate_dps) * seconds


@compiled
def _take_reading(
    encoders: Encoders, parameters: Parameters, axis: int, turned_deg: float, epoch: int
) -> None:
    """Turn on by what the encoder has turned since its last reading, less a jump."""
    jump_deg = _jump_deg(encoders, parameters, axis, turned_deg)
    if jump_deg != 0.0:
        _find(encoders, axis, _CORRECTED, epoch)
        encoders.offset_deg[axis] += jump_deg
        encoders.uncertain_deg[axis] += _UNCERTAIN * smallest_jump_deg(parameters)
        encoders.jumping_epochs[axis] += 1
        _heal_or_correct(encoders, axis)
    else:
        encoders.jumping_epochs[axis] = 0
    encoders.angle_deg[axis] = encoders.reading_deg[axis] - encoders.offset_deg[axis]
    if encoders.since_known[axis]:
        apart_deg = turned_deg - jump_deg - encoders.since_deg[axis]
        encoders.contradiction_deg[axis] += apart_deg
        encoders.missed_deg[axis] += apart_deg
    vehicle_deg = encoders.increment_deg[axis] - encoders.gyro_deg[axis]
    if encoders.since_epochs[axis] == 1 and jump_deg == 0.0:
        vehicle_deg = turned_deg - encoders.since_deg[axis]
    encoders.gyro_deg[axis] = encoders.since_deg[axis] / encoders.since_epochs[axis]
    encoders.increment_deg[axis] = encoders.gyro_deg[axis] + vehicle_deg


@compiled
def _do_without(
    encoders: Encoders,
    parameters: Parameters,
    axis: int,
    increment_deg: float,
    turned_deg: float,
) -> None:
    """Turn on by another increment, and see whether the encoder is well again."""
    encoders.angle_deg[axis] += increment_deg
    encoders.increment_deg[axis] = increment_deg
    offset_deg = encoders.reading_deg[axis] - encoders.angle_deg[axis]
    encoders.offset_deg[axis] = unwrapped(offset_deg, 0.0, parameters.angle_span_deg)
    moved_deg = encoders.offset_deg[axis] - encoders.anchor_deg[axis]
    if abs(moved_deg) > _MOVED_DEG + 2.0 * encoders.step_deg:
        encoders.anchor_deg[axis] = encoders.offset_deg[axis]
        encoders.agreed_epochs[axis] = 0
        encoders.agreed_deg[axis] = 0.0
    encoders.agreed_epochs[axis] += 1
    encoders.agreed_deg[axis] += abs(turned_deg)
    agreed_s = encoders.agreed_epochs[axis] * parameters.period_ns * 1e-9
    if agreed_s >= _AGREED_S and encoders.agreed_deg[axis] >= _AGREED_DEG:
        encoders.uncertain_deg[axis] = _HEALED_DEG + 2.0 * encoders.step_deg
        _heal_or_correct(encoders, axis)


@compiled
def _limit_deg(parameters: Parameters) -> float:
    """Return by how much gyros, angle and command may differ: drift, and what an axis lags."""
    seconds = parameters.period_ns * 1e-9
    return float(_APART_DEG + _LATE_EPOCHS * parameters.turn_rate_dps * seconds)


@compiled
def _vote(
    encoders: Encoders, parameters: Parameters, axis: int, disobedience_deg: float, epoch: int
) -> None:
    """Let gyros and command outvote the encoder; `disobedience_deg` is of this epoch."""
    seconds = parameters.period_ns * 1e-9
    kept = 1.0 - seconds / _MEMORY_S
    limit_deg = _limit_deg(parameters)
    encoders.contradiction_deg[axis] *= kept
    encoders.disobedience_deg[axis] *= kept
    if abs(disobedience_deg) > 1.0:  # the command itself has jumped
        encoders.disobedience_deg[axis] = 0.0
        encoders.obedient_epochs[axis] = 0
    else:
        encoders.disobedience_deg[axis] += disobedience_deg
    encoders.obedient_epochs[axis] += 1
    if abs(encoders.disobedience_deg[axis]) > limit_deg:
        encoders.obedient_epochs[axis] = 0
    if encoders.source[axis] >= _GYROS:
        encoders.source[axis] = _GYROS if encoders.obedient_epochs[axis] > 0 else _COMMAND
        return
    apart_deg = abs(encoders.contradiction_deg[axis])
    encoders.apart_epochs[axis] += 1
    if apart_deg < _CLOSE * limit_deg + encoders.step_deg:
        encoders.missed_deg[axis] = encoders.contradiction_deg[axis]
        encoders.apart_epochs[axis] = 0
    obedient_s = (encoders.obedient_epochs[axis] - encoders.apart_epochs[axis]) * seconds
    if apart_deg > 2.0 * limit_deg + 2.0 * encoders.step_deg and obedient_s >= _OBEDIENT_S:
        _replace(encoders, axis, epoch)


@compiled
def _follow_axis(
    encoders: Encoders,
    assembly: Assembly,
    parameters: Parameters,
    axis: int,
    gyro_deg: float,
    commanded_deg: float,
    epoch: int,
    known: bool,
    votes: bool,
) -> None:
    received = assembly.axis_received[axis]
    if not encoders.seen[axis]:
        encoders.seen[axis] = received
        encoders.reading_deg[axis] = assembly.encoder_angle_deg[axis]
        encoders.angle_deg[axis] = assembly.encoder_angle_deg[axis]
        return
    encoders.since_epochs[axis] += 1
    encoders.since_deg[axis] += gyro_deg
    encoders.since_known[axis] = encoders.since_known[axis] and known
    turned_deg = 0.0
    if received:
        reading_deg = unwrapped(
            assembly.encoder_angle_deg[axis],
            encoders.reading_deg[axis],
            parameters.angle_span_deg,
        )
        turned_deg = reading_deg - encoders.reading_deg[axis]
        encoders.reading_deg[axis] = assembly.encoder_angle_deg[axis]
    increment_deg = commanded_deg if encoders.source[axis] == _COMMAND else gyro_deg
    if encoders.source[axis] >= _GYROS:
        _do_without(encoders, parameters, axis, increment_deg, turned_deg)
        encoders.gyro_deg[axis] = gyro_deg
    elif received:
        _take_reading(encoders, parameters, axis, turned_deg, epoch)
    elif encoders.since_epochs[axis] > _PATIENCE_EPOCHS and known:
        encoders.angle_deg[axis] += increment_deg
    else:  # extrapolated by its rate
        encoders.angle_deg[axis] = assembly.encoder_angle_deg[axis]
    if not votes:
        encoders.contradiction_deg[axis] = 0.0
        encoders.disobedience_deg[axis] = 0.0
        encoders.obedient_epochs[axis] = 0
    elif known:
        _vote(encoders, parameters, axis, gyro_deg - commanded_deg, epoch)
    if encoders.jumping_epochs[axis] > _PATIENCE_EPOCHS:
        _replace(encoders, axis, epoch)
    if received:
        encoders.since_epochs[axis] = 0
        encoders.since_deg[axis] = 0.0
        encoders.since_known[axis] = True
    if encoders.source[axis] != _ENCODER or not received:
        assembly.encoder_angle_deg[axis] = encoders.angle_deg[axis]


@compiled
def _note_lag(state: Ram, axis: int, gyro_deg: float, commanded_deg: float) -> None:
    """Note by how much the angle strays from the commanded one; not where the command jumps."""
    encoders, parameters = state.encoders, state.parameters
    expected_deg = encoders.expected_deg[axis]
    lag_deg = unwrapped(encoders.angle_deg[axis], expected_deg, parameters.angle_span_deg)
    lag_deg -= expected_deg
    more_deg = lag_deg - encoders.lag_deg[axis]
    encoders.lag_deg[axis] = lag_deg
    limit_deg = _limit_deg(parameters)
    if not state.sequencer.running or abs(commanded_deg) > limit_deg:
        return
    if axis == INNER and parameters.isolate_heading:  # in corners it cannot follow
        return
    encoders.strayed_deg[axis] += more_deg
    encoders.unfelt_deg[axis] += gyro_deg - commanded_deg - more_deg
    strayed_deg = abs(encoders.strayed_deg[axis])
    if strayed_deg <= _ROUNDED * encoders.step_deg:
        encoders.unfelt_deg[axis] = 0.0
        encoders.doubted[axis] = False
    elif strayed_deg > limit_deg:
        is_unfelt = abs(encoders.unfelt_deg[axis]) > _FELT * strayed_deg
        is_unfelt |= encoders.source[axis] >= _GYROS  # which cannot confirm themselves
        encoders.doubted[axis] |= is_unfelt


@compiled
def doubtful_deg(encoders: Encoders, parameters: Parameters) -> float:
    """Return by how much the angles of the table may be wrong: both axes, 0 if nothing shows it.

    An angle that strays from the commanded one is wrong, or the axis disobeys: that only gyros
    tell, which then feel the table turn as the angle says, and no vehicle.
    """
    total_deg = 0.0
    for axis in (INNER, OUTER):
        strayed_deg = abs(encoders.strayed_deg[axis])
        is_felt = strayed_deg > _limit_deg(parameters) and not encoders.doubted[axis]
        if strayed_deg > _ROUNDED * encoders.step_deg and not is_felt:
            total_deg += _COASTED * strayed_deg
    return total_deg


@compiled
def _feel(encoders: Encoders, dtheta_s: Floats, ins: Ins, dt: float) -> None:
    """Find what the gyros feel of table and vehicle: with ``dt`` = 0 the Earth's turn as well."""
    earth.turn(encoders.turn_s, ins.C_s_n, parallel(ins), dt)
    for i in range(3):
        encoders.turn_s[i] = dtheta_s[i] - encoders.turn_s[i]


@compiled
def follow(state: Ram, navigating: bool) -> None:
    """Compare the encoders with this epoch's gyros; correct the angles in the assembly.

    Called between fusion and all that uses the angles. `navigating` tells whether the attitude is
    known, and with it the Earth's rate: without it, only jumps are found.
    """
    encoders, parameters = state.encoders, state.parameters
    known = state.faults.consecutive_bridged == 0 and state.clock.synchronised
    dt = parameters.period_ns * 1e-9 if navigating else 0.0
    _feel(encoders, state.dtheta_s, state.ins, dt)
    middle_deg = encoders.angle_deg[INNER] + 0.5 * encoders.increment_deg[INNER]
    turn_to(encoders.middle, math.radians(middle_deg))
    turn_s = encoders.turn_s
    for axis in (INNER, OUTER):
        along = turn_s[2]
        if axis == OUTER:
            along = turn_s[0] * encoders.middle.cosine - turn_s[1] * encoders.middle.sine
        expected_deg = encoders.expected_deg[axis]
        if state.sequencer.running:
            expected_deg = sequencer.expected_angle_deg(state.sequencer, parameters, axis)
        commanded_deg = expected_deg - encoders.expected_deg[axis]
        encoders.expected_deg[axis] = expected_deg
        _follow_axis(
            encoders,
            state.assembly,
            parameters,
            axis,
            math.degrees(along),
            commanded_deg,
            state.epoch,
            known,
            navigating,
        )
        if state.integrity.enabled:
            _note_lag(state, axis, math.degrees(along), commanded_deg)
