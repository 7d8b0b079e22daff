"""Values of the table as text, and text as values."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from firmware_py.diagnostics.codecs import Field, Layout, Value, ValueRangeError, Values

_LIKE = 3  # so many equal values at the end are shown as one
_DIGITS = {"f32": 7, "f64": 10}


class AssignmentError(ValueError):
    """Text that is no value of a field."""


def shown(field: Field, value: Value) -> str:
    """Return a value as it is shown: with names for numbers, without its unit."""
    if isinstance(value, tuple):
        return _row([shown(field, one) for one in value])
    named = field.named(value)
    if isinstance(named, float):
        return f"{named:.{_DIGITS[field.format]}g}"
    return str(named)


def _row(texts: Sequence[str]) -> str:
    """Return values in a row; what is equal at its end is shown once."""
    last = len(texts)
    while last > 0 and texts[last - 1] == texts[-1]:
        last -= 1
    equal = len(texts) - last
    if equal < _LIKE:
        return ", ".join(texts)
    return ", ".join([*texts[:last], f"{texts[-1]} (×{equal})"])


def limits_of(field: Field) -> str:
    """Return what may be written, such as ``0 … 10 s``."""
    if field.choices is not None:
        return ", ".join(choice.name for choice in field.choices)
    if field.minimum is None or field.maximum is None:
        return ""
    return f"{field.minimum:.10g} … {field.maximum:.10g} {field.unit}".rstrip()


def plain(layout: Layout, values: Mapping[str, Value]) -> dict[str, Any]:
    """Return values for JSON: names for numbers that have one, lists for rows."""
    named = layout.named(dict(values))
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in named.items()
    }


def assigned(
    fields: Iterable[Field], texts: Sequence[str], current: Mapping[str, Value] | None = None
) -> Values:
    """Return the values that ``FIELD=VALUE`` texts give.

    Parameters
    ----------
    fields : iterable of Field
        A single field needs no name: ``VALUE`` alone is its.
    texts : sequence of str
        A row is written with commas; the first of more values may be given alone.
    current : dict, optional
        What fields have that are not named; without it, each has to be.

    Raises
    ------
    AssignmentError
        One line: which text is wrong, and what may be written.
    """
    by_name = {field.name: field for field in fields}
    if texts and not by_name:
        raise AssignmentError(f"{texts[0]!r} is too much: nothing is to be given")
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
        raise ValueRangeError(f"{field.name}: {len(numbers)} values, there are {field.count}")
    if len(numbers) < field.count and not isinstance(current, tuple):
        raise ValueRangeError(f"{field.name}: {len(numbers)} values, {field.count} are needed")
    rest = current[len(numbers) :] if isinstance(current, tuple) else ()
    return (*numbers, *rest)


def _number(field: Field, text: str) -> int | float:
    """Return a number that may be written.

    Raises
    ------
    ValueRangeError
        One line, with what is allowed.
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
