"""Formatting of numbers for the screen."""

from __future__ import annotations

from rrins.host_tools.monitor.state import SignalState
from rrins.host_tools.rounding import in_unit

NOTHING = "-"
"""Placeholder for unknown values."""


def age_words(seconds: float) -> str:
    """Return a time span: `5 ms`, `2.3 s`, `812 s`, `3.1 h`."""
    if seconds < 0.9995:
        return f"{seconds * 1e3:.0f} ms"
    if seconds < 99.95:
        return f"{seconds:.1f} s"
    if seconds < 9999.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 3600:.1f} h"


def rate_words(rate_hz: float | None) -> str:
    """Return a rate with at most four figures: `200.0`, `9.998`, `0`."""
    if rate_hz is None:
        return NOTHING
    if rate_hz == 0:
        return "0"
    if rate_hz >= 999.95:
        return f"{rate_hz:.0f}"
    if rate_hz >= 99.995:
        return f"{rate_hz:.1f}"
    return f"{rate_hz:.2f}" if rate_hz >= 9.9995 else f"{rate_hz:.3f}"


def percent_words(share: float | None) -> str:
    """Return a fraction in percent."""
    return NOTHING if share is None else f"{100 * share:.1f} %"


def number_words(value: float | None, decimals: int) -> str:
    """Return a number with `decimals` decimal places."""
    return NOTHING if value is None else f"{value:.{decimals}f}"


def value_words(signal: SignalState) -> str:
    """Return a signal's value, by name if it has one."""
    return signal.text or number_words(signal.value, signal.decimals)


def value_with_unit(signal: SignalState) -> str:
    """Return a signal's value with its unit, or by name if it has one."""
    words = value_words(signal)
    return words if signal.text is not None else in_unit(words, signal.unit)


def clipped(text: str, width: int) -> str:
    """Return text cut to `width`, with an ellipsis if shortened."""
    return text if len(text) <= width else text[: max(0, width - 1)] + "…"[: max(0, width)]


def hexadecimal_words(data: bytes) -> str:
    """Return the bytes of a payload in hexadecimal."""
    return data.hex(" ").upper()
