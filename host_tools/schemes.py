"""Rotation schemes that are built in. Paper, table 1."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from firmware_py.settings import Turn


def _turns(*turns: tuple[str, float]) -> tuple[Turn, ...]:
    return tuple(Turn.model_validate({"axis": axis, "angle_deg": angle}) for axis, angle in turns)


_FIRST_HALF = _turns(
    ("inner", 180),
    ("outer", -180),
    ("inner", 180),
    ("outer", 180),
    ("outer", 180),
    ("inner", 180),
    ("outer", -180),
    ("inner", 180),
)
_SECOND_HALF = _turns(
    ("inner", -180),
    ("outer", 180),
    ("inner", -180),
    ("outer", -180),
    ("outer", -180),
    ("inner", -180),
    ("outer", 180),
    ("inner", -180),
)

SCHEMES: Final = MappingProxyType(
    {
        "16-position": _FIRST_HALF + _SECOND_HALF,
        "8-position": _FIRST_HALF,
    }
)
"""Built-in schemes, name to turns of the turntable's axes."""
