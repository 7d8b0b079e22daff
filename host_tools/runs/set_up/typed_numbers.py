"""Numbers as they were typed, after a conversion to SI units and back."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

_DIGITS: Final = 12
"""Significant digits; what two conversions add is a few parts in 1e16."""


def typed_number(value: float) -> float:
    """Return a number without what conversions added: 0.11 for 0.10999999999999999."""
    return float(f"{value:.{_DIGITS}g}")


def typed_numbers(values: Iterable[float]) -> list[float]:
    """Return numbers without what conversions added, as `typed_number` does."""
    return [typed_number(float(value)) for value in values]
