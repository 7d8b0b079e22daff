"""The rotation scheme: commands the turntable's axes and watches that they follow.

One axis turns at a time; a position is one turn and the dwell after it (paper, section 3 and
table 1). With an isolated heading the inner axis turns besides, see `isolation`. An axis that does
not follow interrupts the scheme. Once both stand, it is tried again after 1, 2, 4, … s: the turn is
completed at the cost of the dwell after it, so that the scheme stays on time.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import unwrapped
from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.records.memory import INNER, OUTER, Assembly, Parameters, Sequencer

_OFF, _HOLD, _POSITION = int(AxisCommand.OFF), int(AxisCommand.HOLD), int(AxisCommand.POSITION)
_FOLLOW = int(AxisCommand.FOLLOW)
_AT_ZERO_DEG = 0.01
_SETTLE_S = 10.0
_AXIS_FAULT, _STANDS = int(AxisState.FAULT), int(AxisState.HOLDING)

TRIES = 8
"""After an interruption; then the scheme is abandoned."""

_FIRST_WAIT_S = 1.0
_FOLLOWED_S = 0.5  # after a turn that made up for an interruption, the scheme is sound again


@compiled
def start(sequencer: Sequencer, parameters: Parameters, assembly: Assembly) -> None:
    """Begin the scheme at its first position, from both axes at zero.

    If an axis is elsewhere, both are turned to zero first.
    """
    sequencer.running = True
    sequencer.homing = False
    sequencer.interrupted = False
    sequencer.tries = 0
    sequencer.position = 0
    sequencer.cycle = 0
    for axis in (INNER, OUTER):
        sequencer.not_following[axis] = False
        sequencer.abandoned[axis] = False
        sequencer.start_angle_deg[axis] = assembly.encoder_angle_deg[axis]
        sequencer.target_angle_deg[axis] = 0.0
        sequencer.command[axis] = _POSITION
        if abs(assembly.encoder_angle_deg[axis]) > _AT_ZERO_DEG:
            sequencer.homing = True
    if sequencer.homing:
        sequencer.epochs = 0
        sequencer.turn_begun = 0
    else:
        _enter(sequencer, parameters)


@compiled
def stop(sequencer: Sequencer) -> None:
    """End the scheme; the axes hold their angles."""
    sequencer.running = False
    sequencer.interrupted = False
    for axis in range(2):
        sequencer.command[axis] = _HOLD


@compiled
def switch_off(sequencer: Sequencer) -> None:
    """End the scheme and switch off the axes' drives."""
    sequencer.running = False
    sequencer.interrupted = False
    for axis in range(2):
        sequencer.command[axis] = _OFF


@compiled
def is_isolating(sequencer: Sequencer) -> bool:
    """Return whether the inner axis takes the vehicle's turn out."""
    return bool(sequencer.command[INNER] == _FOLLOW)


@compiled
def _isolate(sequencer: Sequencer, angle_deg: float) -> None:
    """Command the inner axis, which stands at an angle, to follow from now on."""
    isolation = sequencer.isolation
    isolation.begun = False
    isolation.angle_deg = angle_deg
    isolation.rate_dps = 0.0
    sequencer.command[INNER] = _FOLLOW


@compiled
def _enter(sequencer: Sequencer, parameters: Parameters) -> None:
    """Command the turn of the current position."""
    sequencer.epochs = 0
    sequencer.turn_begun = 0
    for axis in range(2):
        sequencer.start_angle_deg[axis] = sequencer.target_angle_deg[axis]
        if axis == OUTER or not parameters.isolate_heading:
            sequencer.command[axis] = _POSITION
    if parameters.isolate_heading and not is_isolating(sequencer):
        sequencer.isolation.known = False
        sequencer.isolation.turned = 0.0
        _isolate(sequencer, sequencer.target_angle_deg[INNER])
    turning = parameters.position_axis[sequencer.position]
    turn_deg = parameters.position_turn_deg[sequencer.position]
    sequencer.target_angle_deg[turning] += turn_deg


@compiled
def advance(sequencer: Sequencer, parameters: Parameters) -> None:
    """Advance by one epoch, and to the next position when this one is over."""
    sequencer.epochs += 1
    if sequencer.tries > 0 and not _made_up(sequencer, parameters):
        return
    if sequencer.homing:
        if sequencer.epochs >= _homing_epochs(sequencer, parameters):
            sequencer.homing = False
            _enter(sequencer, parameters)
        return
    if sequencer.epochs < parameters.position_epochs[sequencer.position]:
        return
    sequencer.position += 1
    if sequencer.position == parameters.position_count:
        sequencer.position = 0
        sequencer.cycle += 1
    _enter(sequencer, parameters)


@compiled
def _homing_epochs(sequencer: Sequencer, parameters: Parameters) -> float:
    """Return the time to turn both axes to zero, including settling."""
    turn = max(abs(sequencer.start_angle_deg[INNER]), abs(sequencer.start_angle_deg[OUTER]))
    return (turn / parameters.turn_rate_dps + _SETTLE_S) * 1e9 / parameters.period_ns


@compiled
def _made_up(sequencer: Sequencer, parameters: Parameters) -> bool:
    """Return whether the turn after an interruption is over; then all is well again."""
    turn = 0.0
    for axis in range(2):
        turn = max(turn, abs(sequencer.target_angle_deg[axis] - sequencer.start_angle_deg[axis]))
    acceleration = parameters.axis_acceleration_dps2
    seconds = turn / parameters.turn_rate_dps + parameters.turn_rate_dps / acceleration
    seconds += parameters.axis_rise_s + _FOLLOWED_S
    if (sequencer.epochs - sequencer.turn_begun) * parameters.period_ns * 1e-9 < seconds:
        return False
    sequencer.tries = 0
    for axis in range(2):
        sequencer.not_following[axis] = False
    return True


@compiled
def interrupt(sequencer: Sequencer, parameters: Parameters) -> None:
    """Let a scheme that has been stopped wait for its next try, or abandon it after the last."""
    if sequencer.tries == 0:
        for axis in range(2):
            sequencer.interruptions[axis] += sequencer.not_following[axis]
    if sequencer.tries >= TRIES:
        for axis in range(2):
            sequencer.abandoned[axis] = sequencer.not_following[axis]
        return
    sequencer.interrupted = True
    wait_s = _FIRST_WAIT_S * 2.0**sequencer.tries
    sequencer.wait_epochs = int(wait_s * 1e9 / parameters.period_ns)


@compiled
def wait(sequencer: Sequencer, parameters: Parameters, assembly: Assembly) -> bool:
    """Wait for an epoch; return whether the scheme is to be resumed.

    It is after the waiting time, when both axes stand and nobody else commands them. The time of
    the position goes on.
    """
    ready = True
    for axis in (INNER, OUTER):
        stands = assembly.axis_state[axis] == _STANDS and assembly.axis_silent_epochs[axis] == 0
        ready = ready and stands and sequencer.command[axis] == _HOLD
    if sequencer.wait_epochs > 0:
        sequencer.wait_epochs -= 1
        ready = False
    if not sequencer.homing:
        last = parameters.position_epochs[sequencer.position]
        sequencer.epochs = min(sequencer.epochs + 1, last)
    return ready


@compiled
def resume(sequencer: Sequencer, parameters: Parameters, assembly: Assembly) -> None:
    """Try again: turn both axes to where the position wants them."""
    sequencer.running = True
    sequencer.interrupted = False
    sequencer.tries += 1
    if sequencer.homing:
        sequencer.epochs = 0
    sequencer.turn_begun = sequencer.epochs
    for axis in (INNER, OUTER):
        target = sequencer.target_angle_deg[axis]
        encoder = assembly.encoder_angle_deg[axis]
        sequencer.start_angle_deg[axis] = unwrapped(encoder, target, parameters.angle_span_deg)
        sequencer.command[axis] = _POSITION
    if parameters.isolate_heading and not sequencer.homing:
        now_deg = unwrapped(
            assembly.encoder_angle_deg[INNER],
            sequencer.isolation.angle_deg,
            parameters.angle_span_deg,
        )
        sequencer.start_angle_deg[INNER] = sequencer.target_angle_deg[INNER]
        _isolate(sequencer, now_deg)


@compiled
def commanded_angle_deg(sequencer: Sequencer, axis: int) -> float:
    """Return the angle that an axis is told."""
    if axis == INNER and is_isolating(sequencer):
        return sequencer.isolation.angle_deg
    return sequencer.target_angle_deg[axis]


@compiled
def expected_angle_deg(sequencer: Sequencer, parameters: Parameters, axis: int) -> float:
    """Return the expected angle of an axis."""
    if axis == INNER and is_isolating(sequencer):
        return sequencer.isolation.angle_deg
    return scheme_angle_deg(sequencer, parameters, axis)


@compiled
def scheme_angle_deg(sequencer: Sequencer, parameters: Parameters, axis: int) -> float:
    """Return the angle that the scheme wants: ramp up, turn at the full rate, ramp down.

    A finite rise time of the acceleration delays the turn by half that time.
    """
    start, target = sequencer.start_angle_deg[axis], sequencer.target_angle_deg[axis]
    turn = abs(target - start)
    acceleration = parameters.axis_acceleration_dps2
    rate = min(parameters.turn_rate_dps, math.sqrt(turn * acceleration))
    if rate == 0.0:
        return target
    ramp_s = rate / acceleration
    total_s = turn / rate + ramp_s
    epochs = sequencer.epochs - sequencer.turn_begun
    t = epochs * parameters.period_ns * 1e-9 - 0.5 * parameters.axis_rise_s
    if t <= 0.0:
        return start
    if t >= total_s:
        return target
    if t > total_s - ramp_s:
        done = turn - 0.5 * acceleration * (total_s - t) ** 2
    elif t > ramp_s:
        done = rate * (t - 0.5 * ramp_s)
    else:
        done = 0.5 * acceleration * t * t
    return start + math.copysign(done, target - start)


@compiled
def watch(sequencer: Sequencer, parameters: Parameters, assembly: Assembly) -> bool:
    """Check that both axes follow; return whether one does not.

    An axis does not follow when its encoder deviates from the expected angle by more than the
    tolerance, when it reports a fault, or when it has been silent for too long.
    """
    found = False
    for axis in (INNER, OUTER):
        silent = assembly.axis_silent_epochs[axis] > parameters.axis_silence_epochs
        expected = expected_angle_deg(sequencer, parameters, axis)
        encoder = assembly.encoder_angle_deg[axis]
        lag = unwrapped(encoder, expected, parameters.angle_span_deg) - expected
        fault = assembly.axis_state[axis] == _AXIS_FAULT
        if silent or fault or abs(lag) > parameters.follow_tolerance_deg:
            found = True
            sequencer.not_following[axis] = True
    return found
