"""Value tables of the DBC that both sides use; a test checks them against the DBC."""

from __future__ import annotations

from enum import IntEnum


class AxisCommand(IntEnum):
    """Command to an axis: `command` of the axis commands."""

    OFF = 0
    HOLD = 1
    POSITION = 2
    FOLLOW = 3


class AxisState(IntEnum):
    """State that an axis reports: `state` of the axis statuses."""

    OFF = 0
    HOLDING = 1
    MOVING = 2
    BRAKING = 3
    FAULT = 4


class FaultAction(IntEnum):
    """Action of a fault command: `action` of FAULT_COMMAND and HARDWARE_FAULT_COMMAND."""

    NONE = 0
    INJECT = 1
    REMOVE = 2
    CLEAR = 3
    REPORT = 4
    SHARE = 5
    CYCLE = 6


class FaultRefusal(IntEnum):
    """Why a fault command was refused: `refusal` of the fault statuses.

    UNKNOWN: no such action or kind. NO_ROOM: too many faults. NO_SUCH_TARGET: no such axis,
    sensor, node or identifier. OUT_OF_RANGE: value outside the range of the kind. NOT_ACTIVE: no
    such fault to remove.
    """

    NONE = 0
    UNKNOWN = 1
    NO_ROOM = 2
    NO_SUCH_TARGET = 3
    OUT_OF_RANGE = 4
    NOT_ACTIVE = 5


UNASKED = 15
"""`answers` of a fault status without a command: a counter that no command has."""
