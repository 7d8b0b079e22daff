"""Units: a key's name ends in its unit, and what it means in SI units has the name without it.

`bias_dph` is a `bias` in °/h, `lever_arm_m` a `lever_arm` in m. So a table of keys needs no
conversion of its own: `in_si` returns its values, and `fill` copies them into a record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from pydantic import BaseModel

from rrins.compiled.record import Record

STANDARD_GRAVITY = 9.80665
"""m/s²: the g of µg and of an accelerometer's range (ISO 80000-3)."""

DEG = math.radians(1)  # rad
DPH = math.radians(1) / 3600  # rad/s
UG = 1e-6 * STANDARD_GRAVITY  # m/s²
ARCSEC = math.radians(1) / 3600  # rad
PPM = 1e-6
DEG_PER_SQRT_H = math.radians(1) / 60  # rad/√s
SQRT_H = 60.0  # √s


class Unit(NamedTuple):
    """A unit: its value in SI units, and how it is written."""

    si: float
    symbol: str


UNITS: Final = {
    "arcsec": Unit(ARCSEC, "″"),
    "deg": Unit(DEG, "°"),
    "deg_per_sqrt_h": Unit(DEG_PER_SQRT_H, "°/√h"),
    "dph": Unit(DPH, "°/h"),
    "dph_per_g": Unit(DPH / STANDARD_GRAVITY, "°/h/g"),
    "dph_per_k": Unit(DPH, "°/h/K"),
    "dph_per_sqrt_h": Unit(DPH / SQRT_H, "°/h/√h"),
    "dps": Unit(DEG, "°/s"),
    "dps2": Unit(DEG, "°/s²"),
    "dps3": Unit(DEG, "°/s³"),
    "g": Unit(STANDARD_GRAVITY, "g"),
    "hz": Unit(1.0, "Hz"),
    "k": Unit(1.0, "K"),
    "m": Unit(1.0, "m"),
    "m_per_sqrt_h": Unit(1.0 / SQRT_H, "m/√h"),
    "mm": Unit(1e-3, "mm"),
    "mps": Unit(1.0, "m/s"),
    "ms": Unit(1e-3, "ms"),
    "ppm": Unit(PPM, "ppm"),
    "ppm_per_k": Unit(PPM, "ppm/K"),
    "s": Unit(1.0, "s"),
    "ug": Unit(UG, "µg"),
    "ug_per_k": Unit(UG, "µg/K"),
    "ug_per_sqrt_h": Unit(UG / SQRT_H, "µg/√h"),
    "ug_per_sqrt_hz": Unit(UG, "µg/√Hz"),
    "um": Unit(1e-6, "µm"),
    "um_per_s": Unit(1e-6, "µm/s"),
}
"""Endings of keys."""

_NO_UNIT = Unit(1.0, "")


@dataclass(frozen=True)
class Called:
    """Annotation of a key whose value in SI units has another name than the key."""

    name: str


def split(key: str) -> tuple[str, Unit]:
    """Return a key's name without its unit, and the unit."""
    parts = key.split("_")
    for k in range(1, len(parts)):
        unit = UNITS.get("_".join(parts[k:]))
        if unit is not None:
            return "_".join(parts[:k]), unit
    return key, _NO_UNIT


def by_name(table: BaseModel) -> dict[str, tuple[Any, float]]:
    """Return each value of a table as it is and the SI value of its unit, by name without unit."""
    return {name: (getattr(table, key), si) for key, name, si in _names_of(type(table))}


@cache
def _names_of(kind: type[BaseModel]) -> list[tuple[str, str, float]]:
    """Return the key, the name without unit and the unit's SI value of each value of a table."""
    found = []
    for key, field in kind.model_fields.items():
        name, unit = split(key)
        name = next((item.name for item in field.metadata if isinstance(item, Called)), name)
        found.append((key, name, unit.si))
    return found


def in_si(table: BaseModel) -> dict[str, Any]:
    """Return the numbers of a table in SI units, by name without unit: floats, or arrays of them.

    Values that are None or no numbers stay as they are.
    """
    found = {}
    for name, (value, unit) in by_name(table).items():
        is_list = isinstance(value, tuple) and all(isinstance(v, int | float) for v in value)
        if is_list or isinstance(value, int | float):
            found[name] = (np.array(value) if is_list else value) * unit
        else:
            found[name] = value
    return found


def fill(record: Record, values: Mapping[str, Any], dt: float = 0.0, count: int = 0) -> None:
    """Copy values in SI units into the fields of a record that have their names.

    A field with `_increment` after the name takes the value × `dt`. Fields of arrays take `count`
    times the same value, or as many as are given. Values without a field are passed over.
    """
    fields: Mapping[str, Any] = record.dtype.fields or {}
    for name, value in values.items():
        for field, factor in ((name, 1.0), (f"{name}_increment", dt)):
            if field not in fields:
                continue
            if fields[field][0].shape:
                size = np.size(value) if np.ndim(value) else count
                record[field][:size] = np.multiply(value, factor)
            else:
                record[field] = value * factor
