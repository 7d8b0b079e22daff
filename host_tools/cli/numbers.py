"""Numbers on the command line."""

from __future__ import annotations

import math
from typing import Any

import click

BIT_RATE = click.IntRange(1, 1_000_000_000)
"""A bit rate, bit/s."""


class NumberRange(click.FloatRange):
    """A finite number within limits; `nan` is beyond any limit."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number
