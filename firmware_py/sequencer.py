"""The rotation scheme: commands the turntable's axes and watches that they follow.

One axis turns at a time; a position is one turn and the standing after it (paper, section 3 and
table 1).
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from dbc.codec import unwrapped
from dbc.values import AxisCommand, AxisState
from firmware_py.memory import INNER, OUTER

_OFF, _HOLD, _POSITION = int(AxisCommand.OFF), int(AxisCommand.HOLD), int(AxisCommand.POSITION)
_AT_ZERO_DEG = 0.01
_SETTLE_S = 10.0
_AXIS_FAULT = int(AxisState.FAULT)


@njit(cache=True)
def start(sequencer: Any, parameters: Any, assembly: Any) -> None:
    """Begin the scheme at its first position, from both axes at zero.

    Where an axis stands elsewhere, both are turned to zero first.
    """
    sequencer.running = True
    sequencer.homing = False
    sequencer.position = 0
    sequencer.cycle = 0
    for axis in (INNER, OUTER):
        sequencer.not_following[axis] = False
        sequencer.start_angle_deg[axis] = assembly.encoder_angle_deg[axis]
        sequencer.target_angle_deg[axis] = 0.0
        sequencer.command[axis] = _POSITION
        if abs(assembly.encoder_angle_deg[axis]) > _AT_ZERO_DEG:
            sequencer.homing = True
    if sequencer.homing:
        sequencer.epochs = 0
    else:
        _enter(sequencer, parameters)


@njit(cache=True)
def stop(sequencer: Any) -> None:
    """End the scheme; the axes hold where they are."""
    sequencer.running = False
    for axis in range(2):
        sequencer.command[axis] = _HOLD


@njit(cache=True)
def switch_off(sequencer: Any) -> None:
    """End the scheme and take the axes' drives off."""
    sequencer.running = False
    for axis in range(2):
        sequencer.command[axis] = _OFF


@njit(cache=True)
def _enter(sequencer: Any, parameters: Any) -> None:
    """Command the turn of the present position."""
    sequencer.epochs = 0
    for axis in range(2):
        sequencer.start_angle_deg[axis] = sequencer.target_angle_deg[axis]
        sequencer.command[axis] = _POSITION
    turning = parameters.position_axis[sequencer.position]
    turn_deg = parameters.position_turn_deg[sequencer.position]
    sequencer.target_angle_deg[turning] += turn_deg


@njit(cache=True)
def advance(sequencer: Any, parameters: Any) -> None:
    """Go on by one epoch, and to the next position when this one's time is over."""
    sequencer.epochs += 1
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


@njit(cache=True)
def _homing_epochs(sequencer: Any, parameters: Any) -> float:
    """Return how long turning both axes to zero takes, with the time to settle."""
    turn = max(abs(sequencer.start_angle_deg[INNER]), abs(sequencer.start_angle_deg[OUTER]))
    return (turn / parameters.turn_rate_dps + _SETTLE_S) * 1e9 / parameters.period_ns


@njit(cache=True)
def expected_angle_deg(sequencer: Any, parameters: Any, axis: int) -> float:
    """Return where an axis ought to be by now: ramp up, turn at the full rate, ramp down.

    An acceleration that takes its time to rise makes the turn later by half of that.
    """
    start, target = sequencer.start_angle_deg[axis], sequencer.target_angle_deg[axis]
    turn = abs(target - start)
    acceleration = parameters.axis_acceleration_dps2
    rate = min(parameters.turn_rate_dps, math.sqrt(turn * acceleration))
    if rate == 0.0:
        return target
    ramp_s = rate / acceleration
    total_s = turn / rate + ramp_s
    t = sequencer.epochs * parameters.period_ns * 1e-9 - 0.5 * parameters.axis_rise_s
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


@njit(cache=True)
def watch(sequencer: Any, parameters: Any, assembly: Any) -> bool:
    """Check that both axes follow; return whether one has newly been found not to.

    An axis does not follow when its encoder is further than the tolerance from where the axis
    ought to be, when it reports a fault, or when it has been silent for too long.
    """
    found = False
    for axis in (INNER, OUTER):
        silent = assembly.axis_silent_epochs[axis] > parameters.axis_silence_epochs
        expected = expected_angle_deg(sequencer, parameters, axis)
        encoder = assembly.encoder_angle_deg[axis]
        lag = unwrapped(encoder, expected, parameters.angle_span_deg) - expected
        fault = assembly.axis_state[axis] == _AXIS_FAULT
        if silent or fault or abs(lag) > parameters.follow_tolerance_deg:
            found = found or not sequencer.not_following[axis]
            sequencer.not_following[axis] = True
    return found
