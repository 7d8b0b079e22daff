"""How an explanation is shown: components, units and figures of one table alike."""

from __future__ import annotations

from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.explanation.explain import OF, Explanation

COMPONENTS: Final = {
    "position": ("east", "north", "up"),
    "velocity": ("east", "north", "up"),
    "attitude": ("roll", "pitch", "heading"),
}
UNITS: Final = {"position": "m", "velocity": "m/s", "attitude": "″"}
SHARE_OF: Final = {
    "position": "horizontal position",
    "velocity": "horizontal velocity",
    "attitude": "heading",
}

_SMALL: Final = {"m": "mm", "m/s": "mm/s"}
_DIGITS: Final = 3


def scaled(values: Floats, unit: str) -> tuple[float, str]:
    """Return the factor and the unit that make values easy to read."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if unit in _SMALL and 0 < largest < 0.1:
        return 1e3, _SMALL[unit]
    return 1.0, unit


def decimals(values: Floats) -> int:
    """Return how many decimals show the largest value with three digits."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    return 0 if largest <= 0 else int(np.clip(_DIGITS - 1 - np.floor(np.log10(largest)), 0, 6))


def figure(value: float, places: int) -> str:
    """Return a signed figure; a dash where it is not known."""
    if not np.isfinite(value):
        return "–"
    text = f"{value:+.{places}f}"
    return text[1:] if float(text) == 0 else text.replace("-", "−")


def headline(found: Explanation, name: str, of: str) -> str:
    """Return what is explained, in a line."""
    error = found.error[-1, OF[of]]
    when = f"{found.time_s:g} s after navigation began"
    if of == "attitude":
        return f"Why the heading is off by {abs(error[2]):.3g}″, {when}: {name}"
    size, unit = float(np.hypot(*error[:2])), UNITS[of]
    factor, unit = scaled(np.array([size]), unit)
    return f"Why the {of} is off by {size * factor:.3g} {unit}, {when}: {name}"


def table_rows(found: Explanation, of: str) -> tuple[str, list[tuple[str, ...]]]:
    """Return the unit and the rows of the table: name, three components, share."""
    rows = found.rows(of)
    figures = np.array([value for _, _, value, _ in rows])
    factor, unit = scaled(figures, UNITS[of])
    places = decimals(figures * factor)
    cells: list[tuple[str, ...]] = []
    several = {name for name, part, _, _ in rows if part == ""}
    for name, part, value, share in rows:
        indented = f"  {part}" if part and name in several else f"{name}, {part}" if part else name
        shown = (figure(v * factor, places) for v in value)
        cells.append((indented, *shown, figure(100 * share, 1) + " %"))
    total = found.error[-1, OF[of]] * factor
    cells.append(("the error", *(figure(v, places) for v in total), "100.0 %"))
    return unit, cells
