"""Rotation schemes that are built in. Paper, table 1 and section 3.3."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from rrins.firmware_py.core.settings import Turn


def _turns(*turns: tuple[str, float]) -> tuple[Turn, ...]:
    return tuple(Turn.model_validate({"axis": axis, "angle_deg": angle}) for axis, angle in turns)


# Rows 1 to 4 of table 1. Each axis turns once either way as seen from the body: the second turn of
# the inner axis goes the same way, but the outer one has turned it over. Paper, 3.3, (50)-(52).
_4_POSITION = _turns(("inner", 180), ("outer", -180), ("inner", 180), ("outer", 180))
# "The reverse process" of the first four: the same turns in reverse order.
_8_POSITION = _4_POSITION + _4_POSITION[::-1]
# The way back: reverse order, opposite sense.
_16_POSITION = _8_POSITION + tuple(
    Turn(axis=turn.axis, angle_deg=-turn.angle_deg) for turn in reversed(_8_POSITION)
)
# The paper's section 2 for one axis: a full turn in two positions, and back.
_SINGLE_AXIS = _turns(("inner", 180), ("inner", 180), ("inner", -180), ("inner", -180))
# Brings every input axis to both ends of gravity, and turns about it either way, which table 1 does
# not: for calibration on the table. Turns of 0° are rests, where they help the gyros' bias most.
_CALIBRATION = _turns(
    ("outer", 360),
    ("inner", 90),
    ("outer", -360),
    ("inner", 90),
    ("inner", 0),
    ("inner", 0),
    ("inner", 0),
    ("outer", 360),
    ("inner", 90),
    ("outer", -360),
    ("inner", 0),
    ("inner", 0),
    ("inner", 0),
    ("inner", -270),
    ("outer", 90),
    ("inner", 360),
    ("outer", -180),
    ("inner", -360),
    ("outer", 90),
)

SCHEMES: Final = MappingProxyType(
    {
        "16-position": _16_POSITION,
        "8-position": _8_POSITION,
        "4-position": _4_POSITION,
        "single-axis-4-position": _SINGLE_AXIS,
        "calibration": _CALIBRATION,
    }
)
"""Built-in schemes, name to turns of the turntable's axes."""
