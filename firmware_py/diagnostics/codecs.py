"""Encoding of values in diagnostic data: big-endian, consecutive (ISO 14229-1)."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Literal

Format = Literal["u8", "u16", "u24", "u32", "u64", "i8", "i16", "i32", "i64", "f32", "f64", "ascii"]

_STRUCT = {
    "u8": "B",
    "u16": "H",
    "u32": "I",
    "u64": "Q",
    "i8": "b",
    "i16": "h",
    "i32": "i",
    "i64": "q",
    "f32": "f",
    "f64": "d",
}

Value = int | float | str | tuple[int, ...] | tuple[float, ...]
"""A field's value; a tuple where the field has a count."""

Values = dict[str, Value]
"""The values of a layout, by field."""


class ValueRangeError(ValueError):
    """A value that its field does not allow."""


class LengthError(ValueError):
    """Data whose length differs from its layout's."""


@dataclass(frozen=True)
class Field:
    """One value, or `count` values of the same kind.

    Attributes
    ----------
    minimum, maximum : float or None
        Limits of the value, inclusive, written and read.
    """

    name: str  #: with its unit as suffix where that is in doubt
    #: ``u8`` … ``i64``, ``f32``, ``f64`` (IEEE 754) or ``ascii`` (`count` characters, filled up
    #: with spaces)
    format: Format
    unit: str = ""
    count: int = 1  #: number of consecutive values
    minimum: float | None = None
    maximum: float | None = None
    choices: type[IntEnum] | None = None  #: names of the numbers; no other number may be written
    #: where the firmware reads it: a path in the RAM image; empty when it is stored elsewhere
    source: str = ""
    factor: float = 1.0  #: multiplies the value in the RAM image, such as 180/π
    offset: int = 0  #: added to an integer in the RAM image, such as 1 where it counts from 0
    text: str = ""

    @property
    def size(self) -> int:
        """Size in bytes."""
        if self.format == "ascii":
            return self.count
        return 3 * self.count if self.format == "u24" else self._packer.size

    @cached_property
    def _packer(self) -> struct.Struct:
        return struct.Struct(f">{self.count}{_STRUCT[self.format]}")

    @property
    def is_float(self) -> bool:
        """Whether the values are floating point numbers."""
        return self.format in ("f32", "f64")

    def check(self, value: Value) -> None:
        """Raise `ValueRangeError` unless the value may be written."""
        if isinstance(value, str) or self.format == "ascii":
            if self.format != "ascii" or not isinstance(value, str):
                raise ValueRangeError(f"{self.name}: {value!r}: not {self.format}")
            return
        values = value if isinstance(value, tuple) else (value,)
        if len(values) != self.count:
            raise ValueRangeError(f"{self.name}: {len(values)} values, not {self.count}")
        for one in values:
            self._check_one(one)

    def _check_one(self, value: float) -> None:
        if not math.isfinite(value):
            raise ValueRangeError(f"{self.name}: {value} is not a number")
        if self.choices is not None and value not in list(self.choices):
            named = ", ".join(f"{choice.value} {choice.name}" for choice in self.choices)
            raise ValueRangeError(f"{self.name}: {value} is not one of {named}")
        low, high = self.minimum, self.maximum
        if (low is not None and value < low) or (high is not None and value > high):
            raise ValueRangeError(f"{self.name}: {value:g} is not between {low:g} and {high:g}")

    def pack(self, value: Value) -> bytes:
        """Return the bytes of a value.

        Raises
        ------
        ValueRangeError
            When the value does not fit the format.
        """
        if isinstance(value, str):
            text = value.encode("ascii", "replace")[: self.count]
            return text.ljust(self.count)
        values = value if isinstance(value, tuple) else (value,)
        try:
            if self.format == "u24":
                return b"".join(int(one).to_bytes(3, "big") for one in values)
            if not self.is_float:
                values = tuple(int(one) for one in values)
            return self._packer.pack(*values)
        except (struct.error, OverflowError, ValueError, TypeError) as error:
            raise ValueRangeError(f"{self.name}: {value!r}: not {self.format}: {error}") from error

    def unpack(self, data: bytes) -> Value:
        """Return the value in `size` bytes."""
        if self.format == "ascii":
            return data.decode("ascii", "replace").rstrip(" \0")
        if self.format == "u24":
            values = tuple(
                int.from_bytes(data[k : k + 3], "big") for k in range(0, 3 * self.count, 3)
            )
        else:
            values = self._packer.unpack(data)
        return values if self.count > 1 else values[0]

    def named(self, value: Value) -> Value:
        """Return the name of a number that has one, else the value."""
        if self.choices is not None and isinstance(value, int):
            for choice in self.choices:
                if choice == value:
                    return choice.name
        return value


@dataclass(frozen=True)
class Layout:
    """Consecutive fields."""

    fields: tuple[Field, ...] = ()

    @cached_property
    def size(self) -> int:
        """Total size in bytes."""
        return sum(field.size for field in self.fields)

    def encode(self, values: Mapping[str, Value]) -> bytes:
        """Return the values by field as bytes.

        Raises
        ------
        ValueRangeError
            When a value is missing, unknown, or does not fit its format. Limits are not checked.
        """
        names = {field.name for field in self.fields}
        if values.keys() != names:
            odd = ", ".join(sorted(values.keys() ^ names))
            raise ValueRangeError(f"missing or unknown: {odd}")
        return b"".join(field.pack(values[field.name]) for field in self.fields)

    def decode(self, data: bytes) -> Values:
        """Return the values in bytes, by field.

        Raises
        ------
        LengthError
            When the number of bytes differs from the layout's.
        """
        if len(data) != self.size:
            raise LengthError(f"{len(data)} bytes, not {self.size}")
        values: Values = {}
        start = 0
        for field in self.fields:
            values[field.name] = field.unpack(data[start : start + field.size])
            start += field.size
        return values

    def check(self, values: Mapping[str, Value]) -> None:
        """Raise `ValueRangeError` unless all values may be written."""
        for field in self.fields:
            field.check(values[field.name])

    def named(self, values: Mapping[str, Value]) -> Values:
        """Return the values, with numbers replaced by their names where they have one."""
        return {field.name: field.named(values[field.name]) for field in self.fields}
