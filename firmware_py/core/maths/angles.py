"""Angles whose cosine and sine are wanted again and again: found once for each value."""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import F8, Record


class Angle(Record):
    """An angle with its cosine and sine; blank before the first `turn_to`."""

    value: F8  #: rad
    cosine: F8
    sine: F8


@compiled
def turn_to(angle: Angle, value: float) -> None:
    """Have cosine and sine of a value at hand, rad; an angle that rests keeps those it has."""
    if value != angle.value or angle.cosine == 0.0:  # which no cosine of a number is
        angle.value = value
        angle.cosine, angle.sine = math.cos(value), math.sin(value)
