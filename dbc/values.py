"""Value tables of the DBC that both sides speak in; a test holds the two together."""

from __future__ import annotations

from enum import IntEnum


class AxisCommand(IntEnum):
    """What an axis is told: `command` of the axis commands."""

    OFF = 0
    HOLD = 1
    POSITION = 2


class AxisState(IntEnum):
    """What an axis says of itself: `state` of the axis statuses."""

    OFF = 0
    HOLDING = 1
    MOVING = 2
    BRAKING = 3
    FAULT = 4


class FaultAction(IntEnum):
    """What a fault command asks for: `action` of FAULT_COMMAND and HARDWARE_FAULT_COMMAND."""

    NONE = 0
    INJECT = 1
    REMOVE = 2
    CLEAR = 3
    REPORT = 4
    SHARE = 5


class FaultRefusal(IntEnum):
    """Why a fault command was not obeyed: `refusal` of the fault statuses.

    UNKNOWN: no such action or kind. NO_ROOM: as many faults as there can be. NO_SUCH_TARGET: no
    such axis, sensor, node or identifier. OUT_OF_RANGE: the value is none that the kind can have.
    NOT_ACTIVE: there is nothing to take out.
    """

    NONE = 0
    UNKNOWN = 1
    NO_ROOM = 2
    NO_SUCH_TARGET = 3
    OUT_OF_RANGE = 4
    NOT_ACTIVE = 5


UNASKED = 15
"""`answers` of a fault status that answers no command: a counter that none has."""
