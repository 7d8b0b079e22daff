"""A number as integer digits and a power of ten, carried in two signals of a message.

A decimal number that a person writes survives the round trip exactly: the quotient by a power of
ten is correctly rounded, as the number itself was when it was parsed.
"""

from __future__ import annotations

from rrins.dbc.codec import SignalLayout


def from_decimal(digits: int, exponent: int) -> float:
    """Return ``digits * 10**exponent``, correctly rounded; for exponents from -22 to 22."""
    return float(digits * 10**exponent) if exponent >= 0 else digits / 10**-exponent


def to_decimal(
    value: float, digits_signal: SignalLayout, exponent_signal: SignalLayout
) -> tuple[int, int]:
    """Return the (digits, exponent) nearest to a finite value, with as few digits as possible.

    Parameters
    ----------
    value : float
    digits_signal, exponent_signal : SignalLayout
        Ranges of the two signals.

    Raises
    ------
    ValueError
        When the number is too large for the signals.
    """
    largest = min(int(digits_signal.raw_maximum), -int(digits_signal.raw_minimum))
    lowest, highest = int(exponent_signal.raw_minimum), int(exponent_signal.raw_maximum)
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
