"""Reads fields of the table from the RAM image or a freeze frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrins.firmware_py.diagnostics.codecs import Field, Value, Values

_LIMITS = {f"u{bits}": (0, (1 << bits) - 1) for bits in (8, 16, 24, 32, 64)} | {
    f"i{bits}": (-(1 << bits - 1), (1 << bits - 1) - 1) for bits in (8, 16, 32, 64)
}
_FLOATS = {"f32": np.float32, "f64": np.float64}


def view_of(array: NDArray[np.void], path: str) -> NDArray[np.generic]:
    """Return the view of an array of one record at a path, such as ``axis_angle.0``."""
    for part in path.split("."):
        array = array[:, int(part)] if part.isdigit() else array[part]
    return array


def fitted(field: Field, value: Any) -> Value:
    """Return numbers of the RAM image in the field's form, clipped to the range of its format.

    `value` is what numpy reads of a view: an array if the field has a count, or a number.
    """
    if field.count == 1:
        return _fitted_one(field, value.item())
    if field.is_float:  # at once: a parity before its alarm has 60 numbers
        with np.errstate(over="ignore"):
            values = (value * field.factor).astype(_FLOATS[field.format])
        return tuple(values.tolist())
    return tuple(_fitted_one(field, one) for one in value.tolist())


def _fitted_one(field: Field, value: float) -> float:
    if field.is_float:
        value = float(value) * field.factor
        return float(np.float32(value)) if field.format == "f32" else value
    low, high = _LIMITS[field.format]
    return min(high, max(low, int(value) + field.offset))


class FieldReader:
    """Reads the fields of a layout from an array of one record, repeatedly.

    Parameters
    ----------
    array : array of one record
        Views are created once: reading one costs less than finding its field each time.
    special : dict
        Getters of the fields that have no source in the record.
    """

    def __init__(
        self,
        array: NDArray[np.void],
        fields: Iterable[Field],
        special: dict[str, Callable[[], Value]] | None = None,
    ) -> None:
        self._parts: list[tuple[Field, NDArray[np.generic] | None, Callable[[], Value] | None]] = [
            (
                field,
                view_of(array, field.source) if field.source else None,
                None if field.source else (special or {})[field.name],
            )
            for field in fields
        ]

    def read(self) -> Values:
        """Return the values by field."""
        values: Values = {}
        for field, view, call in self._parts:
            if view is not None:
                values[field.name] = fitted(field, view[0])
            elif call is not None:
                values[field.name] = call()
        return values
