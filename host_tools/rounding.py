"""Numbers as people read them: in terminals, pictures and reports alike.

A number has three digits, zeros included, and its thousands separated: ``14.0`` next to ``8.94``,
``2,850`` next to ``709``. A value and its uncertainty end at the same digit: ``-13.8 ± 1.0``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, TypeGuard

NOTHING: Final = "–"
"""Text of a value that does not exist."""

_UNITS: Final = {"deg": "°", "deg/s": "°/s", "deg/h": "°/h", "arcsec": "″", "us": "µs", "ug": "µg"}
_PLAIN = range(-3, 7)  # powers of ten that are written without an exponent


def rounded(value: float | None, digits: int = 3) -> str:
    """Return a number with this many significant digits; `NOTHING` for None and NaN.

    Beyond 0.001 to 10 million it has an exponent: ``2.85e+07``.
    """
    power = _power(value, digits) if _is_finite(value) else 0
    return "0" if value == 0 else _text(value, digits - 1 - power, power)


def coarse(value: float | None) -> str:
    """Return a figure from random draws: two digits, three from 10 on; `NOTHING` beyond numbers."""
    if not _is_finite(value):
        return NOTHING
    return rounded(value, 2 if value < 10 else 3)


def kept(value: float | None, digits: int = 4) -> float | None:
    """Return a number for a file, with this many significant digits; None where JSON has none."""
    return float(f"{value:.{digits}g}") if _is_finite(value) else None


def with_unit(value: float | None, unit: str) -> str:
    """Return a number of m or m/s in the unit that fits: ``3.10 mm``, ``12.4 m/s``, ``2.21 km``."""
    if not _is_finite(value):
        return rounded(value)
    if unit == "m" and abs(value) >= 1000:
        return f"{rounded(value / 1000)} km"
    if abs(value) < 0.1 and value != 0:
        return f"{rounded(value * 1000)} m{unit}"
    return f"{rounded(value)} {unit}"


def unit_words(unit: str | None) -> str:
    """Return a unit of the DBC, which has no letters but ASCII, as people write it."""
    return _UNITS.get(unit or "", unit or "")


def labelled(quantity: str, unit: str, before: str = " ") -> str:
    """Return the label of numbers, such as ``velocity / (m/s)``; without a unit the quantity."""
    return f"{quantity}{before}/ {f'({unit})' if '/' in unit else unit}" if unit else quantity


def in_unit(number: str, unit: str | None) -> str:
    """Return a number with a unit of the DBC as people write them: ``1.50°``, ``8.0 µs``."""
    words = unit_words(unit)
    return f"{number}{'' if words in '°″' else ' '}{words}"


def as_stated(value: float | None, unit: str) -> str:
    """Return a number that others have stated, as `with_unit`, without zeros they did not state."""
    number, _, rest = with_unit(value, unit).partition(" ")
    return f"{number.rstrip('0').rstrip('.') if '.' in number else number} {rest}".rstrip()


def alike(values: Iterable[float | None], digits: int = 3) -> list[str]:
    """Return numbers with as many decimals as the largest has with this many digits.

    For what is compared: the sensors of a row, the cases of a column.
    """
    numbers = list(values)
    power = _power(max((abs(one) for one in numbers if _is_finite(one)), default=0.0), digits)
    return [_text(one, digits - 1 - power, power) for one in numbers]


def with_sigma(value: float | None, sigma: float | None) -> tuple[str, str]:
    """Return a value and its σ: σ with two digits, the value with as many decimals.

    Without a σ, or with σ = 0, the value has three digits.
    """
    if not (_is_finite(value) and _is_finite(sigma) and sigma):
        return rounded(value), rounded(sigma, 2)
    sigma_power = _power(sigma, 2)
    power = max(sigma_power, _power(value, 3)) if value else sigma_power
    return _text(value, 1 - sigma_power, power), _text(sigma, 1 - sigma_power, power)


def plus_minus(value: float | None, sigma: float | None) -> str:
    """Return ``value ± σ``, both ending at the same digit; the value alone without a σ."""
    texts = with_sigma(value, sigma)
    return " ± ".join(texts) if sigma is not None and math.isfinite(sigma) else texts[0]


def with_limits(value: float | None, low: float | None, high: float | None) -> str:
    """Return ``value (low to high)``, with the same decimals; the value alone without limits."""
    middle, *ends = limits(value, low, high)
    return f"{middle} ({' to '.join(ends)})" if all(ends) else middle


def limits(value: float | None, low: float | None, high: float | None) -> tuple[str, str, str]:
    """Return a value and its limits, all with the same decimals.

    There are as many as tell the value from the nearer limit by two digits, but no more than three
    digits need, if these tell them apart. Limits that do not exist are empty.
    """
    if not (_is_finite(value) and _is_finite(low) and _is_finite(high) and low < high):
        return rounded(value), "", ""
    nearer = min(distance for distance in (value - low, high - value, high - low) if distance > 0)
    power = _power(max(abs(low), abs(high)), 3)
    apart = -_power(nearer, 2)
    decimals = max(apart, min(apart + 1, 2 - power))
    return _text(value, decimals, power), _text(low, decimals, power), _text(high, decimals, power)


def _power(value: float, digits: int) -> int:
    """Return the power of ten of a number's first digit, once it is rounded."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _is_finite(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)


def _text(value: float | None, decimals: int, power: int) -> str:
    """Return a number with so many decimals, negative ones for tens and hundreds.

    `power` is that of the largest number it is shown with: all have an exponent or none has.
    """
    if not _is_finite(value):
        return NOTHING if value is None or math.isnan(value) else "∞" if value > 0 else "-∞"
    if power in _PLAIN:  # numpy's own rounding would take 0.405 for 0.40
        return f"{round(float(value), decimals):z,.{max(0, decimals)}f}"
    return f"{value / 10.0**power:z.{max(0, decimals + power)}f}e{power:+03d}"
