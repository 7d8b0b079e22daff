"""Names in files of other tools, which allow letters, digits and underscores alone."""

from __future__ import annotations

_SIGNS = {"°": "deg", "µ": "u", "″": "arcsec", "%": "percent", "/": "_per_", "²": "2", "√": "sqrt_"}


def unit_name(text: str) -> str:
    """Return a unit as a name; empty for none."""
    for sign, name in _SIGNS.items():
        text = text.replace(sign, name)
    return "".join(letter if letter.isalnum() else "_" for letter in text)
