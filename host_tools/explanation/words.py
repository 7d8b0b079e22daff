"""How an explanation is shown: components, units and figures of one table alike."""

from __future__ import annotations

from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.explanation.explain import OF, Explanation
from rrins.host_tools.rounding import alike, rounded

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
_SHARE_DIGITS: Final = 4


def scaled(values: Floats, unit: str) -> tuple[float, str]:
    """Return the factor and the unit that make values easy to read."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if unit in _SMALL and 0 < largest < 0.1:
        return 1e3, _SMALL[unit]
    return 1.0, unit


def headline(found: Explanation, name: str, of: str) -> str:
    """Return what is explained, in a line."""
    error = found.error[-1, OF[of]]
    when = f"{found.time_s:g} s after navigation began"
    if of == "attitude":
        return f"Why the heading is off by {rounded(abs(error[2]))}″, {when}: {name}"
    size, unit = float(np.hypot(*error[:2])), UNITS[of]
    factor, unit = scaled(np.array([size]), unit)
    return f"Why the {of} is off by {rounded(size * factor)} {unit}, {when}: {name}"


def table_rows(found: Explanation, of: str) -> tuple[str, list[tuple[str, ...]]]:
    """Return the unit and the rows of the table: name, three components, share."""
    rows = found.rows(of)
    total = found.error[-1, OF[of]]
    figures = np.array([*(value for _, _, value, _ in rows), total])
    factor, unit = scaled(figures, UNITS[of])
    texts = np.reshape(alike((figures * factor).ravel().tolist()), figures.shape)
    shares = alike([*(100 * share for *_, share in rows), 100.0], _SHARE_DIGITS)
    several = {name for name, part, _, _ in rows if part == ""}
    names = [
        f"  {part}" if part and name in several else f"{name}, {part}" if part else name
        for name, part, _, _ in rows
    ]
    cells = zip([*names, "the error"], texts.tolist(), shares, strict=True)
    return unit, [(name, *figures_of, f"{share} %") for name, figures_of, share in cells]
