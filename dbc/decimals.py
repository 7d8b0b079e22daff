"""A number as whole digits and a power of ten, as two signals of a message carry it.

A decimal number that a person writes comes back as the very same number: the quotient by a power
of ten is rounded correctly, as the number itself was when it was read.
"""

from __future__ import annotations

from typing import Any


def from_decimal(digits: int, exponent: int) -> float:
    """Return ``digits * 10**exponent``, correctly rounded; for exponents from -22 to 22."""
    return float(digits * 10**exponent) if exponent >= 0 else digits / 10**-exponent


def to_decimal(value: float, digits_signal: Any, exponent_signal: Any) -> tuple[int, int]:
    """Return (digits, exponent) nearest to a finite value, with as few digits as say it.

    Parameters
    ----------
    value : float
    digits_signal, exponent_signal : records of dtype `dbc.codec.SIGNAL`
        What the two signals can hold.

    Raises
    ------
    ValueError
        For a number that is too large for the signals.
    """
    largest = min(int(digits_signal["raw_maximum"]), -int(digits_signal["raw_minimum"]))
    lowest, highest = int(exponent_signal["raw_minimum"]), int(exponent_signal["raw_maximum"])
    for places in range(len(str(largest)), 0, -1):
        mantissa, _, power = f"{value:.{places - 1}e}".partition("e")
        exponent = int(power) - places + 1
        digits = int(mantissa.replace(".", ""))
        while digits and digits % 10 == 0:
            digits, exponent = digits // 10, exponent + 1
        if exponent > highest:
            digits, exponent = digits * 10 ** (exponent - highest), highest
            if abs(digits) > largest:
                break
        if exponent < lowest:
            digits, exponent = round(value * 10**-lowest), lowest
        if abs(digits) <= largest:
            return (digits, exponent) if digits else (0, 0)
    raise ValueError(f"{value:g} is too large")
