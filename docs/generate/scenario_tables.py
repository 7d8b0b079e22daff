"""Writes the tables of keys in `docs/scenarios.md`: ``python -m generate.scenario_tables``.

Keys, defaults and limits come from the classes of the tables, meanings from their docstrings, units
from the names.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from rrins.host_tools.hardware.tables import (
    Accelerometers,
    Altimeter,
    Axis,
    Gyros,
    Odometer,
    Thermal,
    Turntable,
)
from rrins.host_tools.hardware.units import split
from rrins.host_tools.scenario.schema import meaning
from rrins.host_tools.scenario.tables import Gnss, Integrity, Master, Xcp

PAGE = Path(__file__).resolve().parents[2] / "docs" / "scenarios.md"

_OF_LISTS = {
    "outages": "at most 256",
    "tunnels": "at most 256",
    "tunnel_map": "a GeoJSON file, relative to the scenario's folder",
}
"""Limits of keys that are not numbers."""


def _meaning(table: type[BaseModel], key: str) -> str:
    text = meaning(table, key)
    return text[:1].lower() + text[1:].removesuffix(".")


def _number(value: float) -> str:
    return f"{value:g}" if abs(value) < 10_000 else f"{value:,.0f}".replace(",", " ")


def _bounds(item: Any) -> dict[str, float]:
    """Return the limits in an annotation, also of the parts of a union or a tuple."""
    found = {}
    for part in (item, *getattr(item, "metadata", ())):
        for name in ("ge", "gt", "le", "lt"):
            if getattr(part, name, None) is not None:
                found[name] = float(getattr(part, name))
    if not found:
        for part in get_args(getattr(item, "annotation", item)):
            found = found or _bounds(part)
    return found


def _limits(field: Any, key: str) -> str:
    if key in _OF_LISTS:
        return _OF_LISTS[key]
    bounds = {name: _number(value) for name, value in _bounds(field).items()}
    if "ge" in bounds and ("le" in bounds or "lt" in bounds):
        return f"{bounds['ge']} to {bounds.get('le', bounds.get('lt'))}"
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    return ", ".join(f"{signs[name]} {value}" for name, value in bounds.items())


def _default(value: Any) -> str:
    if value is None or value == ():
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(_number(part) for part in value)}]`"
    return _number(value)


def _is_per_sensor(field: Any) -> bool:
    return any(str(part).startswith("tuple[") for part in get_args(field.annotation))


def _row(table: type[BaseModel], key: str, kinds: str) -> tuple[str, ...]:
    field = table.model_fields[key]
    row = (
        f"`{key}`",
        *([kinds] if kinds else []),
        split(key)[1].symbol,
        _default(field.default),
        _limits(field, key),
    )
    return (*row, _meaning(table, key))


def _markdown(rows: Iterable[tuple[str, ...]]) -> str:
    return "".join(f"| {' | '.join(row)} |\n".replace("|  |", "| |") for row in rows)


def keys_of(table: type[BaseModel]) -> str:
    """Return the keys of a table as Markdown; tables in it are left out."""
    head = ("key", "unit", "default", "limits", "meaning")
    keys = [key for key, field in table.model_fields.items() if field.annotation is not Axis]
    return _markdown([head, ("---",) * 5, *(_row(table, key, "") for key in keys)])


def sensor_keys(per_sensor: bool) -> str:
    """Return the keys of gyros and accelerometers as Markdown: a list, or one number for all."""
    rows = [("key", "table", "unit", "default", "limits", "meaning"), ("---",) * 6]
    fields = {**Gyros.model_fields, **Accelerometers.model_fields}
    for key, field in fields.items():
        if _is_per_sensor(field) == per_sensor:
            tables = [t for t in (Gyros, Accelerometers) if key in t.model_fields]
            kinds = "both" if len(tables) == 2 else tables[0].__name__.lower()
            rows.append(_row(tables[0], key, kinds))
    return _markdown(rows)


def tables() -> dict[str, str]:
    """Return each table of the page, by the name of its place."""
    return {
        "sensors, per sensor": sensor_keys(per_sensor=True),
        "sensors, for all": sensor_keys(per_sensor=False),
        "thermal": keys_of(Thermal),
        "altimeter": keys_of(Altimeter),
        "gnss": keys_of(Gnss),
        "master": keys_of(Master),
        "odometer": keys_of(Odometer),
        "axis": keys_of(Axis),
        "turntable": keys_of(Turntable),
        "integrity": keys_of(Integrity),
        "xcp": keys_of(Xcp),
    }


def page(text: str) -> str:
    """Return the page `text` with the tables of today."""
    for name, table in tables().items():
        begin, end = f"<!-- keys: {name}; by `make docs` -->", f"<!-- end of {name} -->"
        before, rest = text.split(begin)
        _, after = rest.split(end)
        text = f"{before}{begin}\n\n{table}\n{end}{after}"
    return text


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
