"""Conversion of diagnostic values to and from text."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rrins.firmware_py.diagnostics.codecs import Field, Layout, Value, ValueRangeError, Values
from rrins.host_tools.files import JsonObject

_REPEATED = 3  # from this many equal values at the end, show only one
_DIGITS = {"f32": 7, "f64": 10}
_JSON_DIGITS = 15  # of an f64: a typed number comes back as it was typed


class AssignmentError(ValueError):
    """Text that is not a valid value of a field."""


def value_text(field: Field, value: Value) -> str:
    """Return a value as text: with names for numbers, without its unit."""
    if isinstance(value, tuple):
        return _row_text([value_text(field, one) for one in value])
    named = field.named(value)
    if isinstance(named, float):
        return f"{named:.{_DIGITS[field.format]}g}"
    return str(named)


def _row_text(texts: Sequence[str]) -> str:
    """Return the values of an array as text; equal values at its end are shown once."""
    last = len(texts)
    while last > 0 and texts[last - 1] == texts[-1]:
        last -= 1
    equal = len(texts) - last
    if equal < _REPEATED:
        return ", ".join(texts)
    return ", ".join([*texts[:last], f"{texts[-1]} (×{equal})"])


def limits_of(field: Field) -> str:
    """Return the allowed values, such as ``0 … 10 s``."""
    if field.choices is not None:
        return ", ".join(choice.name for choice in field.choices)
    if field.minimum is None or field.maximum is None:
        return ""
    return f"{field.minimum:.10g} … {field.maximum:.10g} {field.unit}".rstrip()


def to_json(layout: Layout, values: Mapping[str, Value]) -> JsonObject:
    """Return values for JSON: names for numbers that have one, lists for arrays."""
    named = layout.named(dict(values))
    return {field.name: _json_value(field, named[field.name]) for field in layout.fields}


def _json_value(field: Field, value: Value) -> str | float | list[float | str]:
    if isinstance(value, tuple):
        return [_short(field, one) for one in value]
    return _short(field, value)


def _short(field: Field, value: float | str) -> float | str:
    """Return 0.11 for the f32 next to it, and an f64 without what conversions of units add."""
    if isinstance(value, str) or not field.is_float:
        return value
    if field.format == "f32":
        return float(str(np.float32(value)))
    return float(f"{value:.{_JSON_DIGITS}g}")


def parse_values(
    fields: Iterable[Field], texts: Sequence[str], current: Mapping[str, Value] | None = None
) -> Values:
    """Return the values that ``FIELD=VALUE`` texts give.

    Parameters
    ----------
    fields : iterable of Field
        A single field needs no name: ``VALUE`` suffices.
    texts : sequence of str
        Values of an array are separated by commas; trailing ones may be omitted.
    current : dict, optional
        Values of the omitted fields; without it, all fields are required.

    Raises
    ------
    AssignmentError
        If a text is invalid; the message, one line, names it and what is allowed.
    """
    by_name = {field.name: field for field in fields}
    if texts and not by_name:
        raise AssignmentError(f"unexpected {texts[0]!r}: there are no fields")
    values: Values = dict(current or {})
    given: set[str] = set()
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals and len(by_name) == 1:
            name, value = next(iter(by_name)), text
        elif not equals:
            raise AssignmentError(f"{text!r} is not FIELD=VALUE; fields: {', '.join(by_name)}")
        if name not in by_name:
            raise AssignmentError(f"there is no field {name!r}; fields: {', '.join(by_name)}")
        if name in given:
            raise AssignmentError(f"{name} is given twice")
        given.add(name)
        values[name] = _checked(by_name[name], value, values.get(name))
    missing = [name for name in by_name if name not in values]
    if missing:
        named = ", ".join(f"{name}=" for name in missing)
        raise AssignmentError(f"missing: {named}")
    return values


def _checked(field: Field, text: str, current: Value | None) -> Value:
    try:
        value = _parsed(field, text, current)
        field.pack(value)
    except ValueRangeError as error:
        raise AssignmentError(str(error)) from error
    return value


def _parsed(field: Field, text: str, current: Value | None) -> Value:
    if field.format == "ascii":
        return text
    numbers = [_number(field, part.strip()) for part in text.split(",")]
    if field.count == 1 and len(numbers) == 1:
        return numbers[0]
    if len(numbers) > field.count:
        raise ValueRangeError(f"{field.name}: {len(numbers)} values, at most {field.count} allowed")
    if len(numbers) < field.count and not isinstance(current, tuple):
        raise ValueRangeError(f"{field.name}: {len(numbers)} values, needs {field.count}")
    rest = current[len(numbers) :] if isinstance(current, tuple) else ()
    return (*numbers, *rest)


def _number(field: Field, text: str) -> int | float:
    """Return a valid number.

    Raises
    ------
    ValueRangeError
        If it is invalid; the message, one line, says what is allowed.
    """
    allowed = limits_of(field)
    if field.choices is not None:
        for choice in field.choices:
            if choice.name == text.upper().replace("-", "_"):
                return int(choice)
    try:
        number = float(text) if field.is_float else int(text, 0)
    except ValueError:
        hint = f"; allowed: {allowed}" if allowed else ""
        what = "a number" if field.is_float else "a whole number"
        raise ValueRangeError(f"{field.name}: {text!r} is not {what}{hint}") from None
    try:
        dataclasses.replace(field, count=1).check(number)
    except ValueRangeError as error:
        if not allowed:
            raise
        raise ValueRangeError(f"{field.name}: {text} is not within {allowed}") from error
    return number
