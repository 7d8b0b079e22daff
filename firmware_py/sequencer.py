"""The rotation scheme: commands the turntable's axes and watches that they follow.

One axis turns at a time; a position is one turn and the standing after it (paper, section 3 and
table 1). The scheme starts from both axes at zero.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from numba import njit

from firmware_py.memory import INNER, OUTER


class AxisCommand(IntEnum):
    """What an axis is told; the DBC's value table of `command`."""

    OFF = 0
    HOLD = 1
    POSITION = 2


class AxisState(IntEnum):
    """What an axis says of itself; the DBC's value table of `state`."""

    OFF = 0
    HOLDING = 1
    MOVING = 2
    BRAKING = 3
    FAULT = 4


_OFF, _HOLD, _POSITION = int(AxisCommand.OFF), int(AxisCommand.HOLD), int(AxisCommand.POSITION)
_AXIS_FAULT = int(AxisState.FAULT)


@njit(cache=True)
def start(sequencer: Any, parameters: Any) -> None:
    """Begin the scheme at its first position."""
    sequencer.running = True
    sequencer.position = 0
    sequencer.cycle = 0
    for axis in range(2):
        sequencer.target_angle_deg[axis] = 0.0
        sequencer.not_following[axis] = False
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
    if sequencer.epochs < parameters.position_epochs[sequencer.position]:
        return
    sequencer.position += 1
    if sequencer.position == parameters.position_count:
        sequencer.position = 0
        sequencer.cycle += 1
    _enter(sequencer, parameters)


@njit(cache=True)
def expected_angle_deg(sequencer: Any, parameters: Any, axis: int) -> float:
    """Return where an axis without inertia would be by now."""
    turn = sequencer.target_angle_deg[axis] - sequencer.start_angle_deg[axis]
    turned = parameters.turn_rate_dps * sequencer.epochs * parameters.period_ns * 1e-9
    if turned >= abs(turn):
        return sequencer.target_angle_deg[axis]
    return sequencer.start_angle_deg[axis] + (turned if turn > 0.0 else -turned)


@njit(cache=True)
def watch(sequencer: Any, parameters: Any, assembly: Any) -> bool:
    """Check that both axes follow; return whether one has newly been found not to.

    An axis does not follow when its encoder is further than the tolerance from where the axis
    ought to be, when it reports a fault, or when it has been silent for too long.
    """
    found = False
    for axis in (INNER, OUTER):
        silent = assembly.axis_silent_epochs[axis] > parameters.axis_silence_epochs
        lag = assembly.encoder_angle_deg[axis] - expected_angle_deg(sequencer, parameters, axis)
        fault = assembly.axis_state[axis] == _AXIS_FAULT
        if silent or fault or abs(lag) > parameters.follow_tolerance_deg:
            found = found or not sequencer.not_following[axis]
            sequencer.not_following[axis] = True
    return found
