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
