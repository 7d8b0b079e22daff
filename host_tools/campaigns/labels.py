"""Words for the keys of a scenario and the columns of a row, as pictures and reports show them."""

from __future__ import annotations

from typing import Final

from rrins.host_tools.hardware.units import split
from rrins.host_tools.rounding import labelled

_TABLES: Final = {
    "gyros": "gyro",
    "accelerometers": "accelerometer",
    "gnss": "GNSS",
    "rimu": "RIMU",
    "faults": "fault",
    "firmware": "",
}
_BEGINNINGS: Final = {
    "position_": "position error, ",
    "velocity_": "velocity error, ",
    "max_abs_": "largest position error, ",
    "max_": "largest ",
}
"""Of columns, which are of the end unless they say otherwise."""


_NAMES: Final = {
    "installation_u": "installation error δu",
    "installation_v": "installation error δv",
    "scale_error": "scale factor error",
    "asymmetric_scale_error": "asymmetric scale factor error",
}
"""Of keys without their units."""


def label_of(name: str) -> str:
    """Return a key or a column in words: ``gyros.bias_dph.2`` is ``gyro 2 bias / (°/h)``.

    What has spaces is words already; a remark in brackets stays.
    """
    words, unit = _split(name)
    return labelled(words, unit)


def words_of(name: str) -> str:
    """Return the label of a key or a column without its unit."""
    return _split(name)[0]


def _split(name: str) -> tuple[str, str]:
    name, bracket, remark = name.partition(" (")
    if " " in name:
        return name + bracket + remark, ""
    table, _, rest = name.partition(".") if "." in name else ("", "", name)
    parts = rest.split(".")
    numbers = [part for part in parts if part.isdecimal()]
    what, unit = split("_".join(part for part in parts if not part.isdecimal()))
    what = _NAMES.get(what, what)
    for begin, words in _BEGINNINGS.items() if not table else ():
        if what.startswith(begin):
            what = words + what.removeprefix(begin)
            break
    head = (_TABLES.get(table, table), *numbers, what)
    words = " ".join(part for part in head if part).replace("_", " ")
    return words + bracket + remark, unit.symbol
