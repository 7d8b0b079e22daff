"""The calibration as a TOML file, and as the firmware's own file.

The tables ``[gyros]`` and ``[accelerometers]`` are those of a calibration file that the firmware is
given at start, and of a scenario: one number for all sensors, or a list with one for each; what is
not named in a table is zero. ``[settings.NAME]`` has a parameter of the table by its name::

    [gyros]
    bias_dph = [0.1, 0.11, 0.12, 0.13]
    scale_error_ppm = 0

    [settings.bridge]
    bridge_s = 0.1

A file that ends with ``.rrca`` holds the bytes that the computer keeps (`firmware_py.diagnostics
.image`).
"""

from __future__ import annotations

import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_py.diagnostics import image
from firmware_py.diagnostics.codecs import Field, Value, ValueRangeError, Values
from firmware_py.diagnostics.data import DataIdentifier
from firmware_py.diagnostics.image import ImageError, Parameters
from firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    GYRO_CALIBRATIONS,
    SETTINGS,
)
from host_tools.diag.values import limits_of
from host_tools.errors import CalibrationFileError

TOML, RAW = ".toml", ".rrca"
"""Endings of the two kinds of files."""

_SENSORS = {"gyros": GYRO_CALIBRATIONS, "accelerometers": ACCELEROMETER_CALIBRATIONS}
_BY_NAME = {did.name: did for did in SETTINGS}


class _Wrong(Exception):  # noqa: N818 - becomes a CalibrationFileError with the file's name
    """What is wrong with a file."""


def _present(dids: Sequence[DataIdentifier], parameters: Mapping[int, Values]) -> list[int]:
    return [did.number for did in dids if did.number in parameters]


# ---- to TOML


def to_toml(parameters: Mapping[int, Values], with_settings: bool) -> str:
    """Return parameters as TOML: the sensors' calibration, and the settings if they are wanted."""
    return "\n".join(_tables(parameters, with_settings))


def _tables(parameters: Mapping[int, Values], with_settings: bool) -> Iterator[str]:
    for name, dids in _SENSORS.items():
        numbers = _present(dids, parameters)
        yield f"[{name}]"
        for field in dids[0].fields:
            values = ", ".join(_float(parameters[number][field.name]) for number in numbers)
            yield f"{field.name} = [{values}]"
        yield ""
    for did in SETTINGS if with_settings else ():
        if did.number in parameters:
            yield f"[settings.{did.name}]"
            for field in did.fields:
                yield f"{field.name} = {_literal(field, parameters[did.number][field.name])}"
            yield ""


def _float(value: Value) -> str:
    assert isinstance(value, int | float)
    return repr(float(value))


def _literal(field: Field, value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_float(one) for one in value) + "]"
    named = field.named(value)
    if isinstance(named, str):
        return f'"{named}"'
    return _float(value) if field.is_float else str(value)


# ---- from TOML


def from_toml(text: str, current: Mapping[int, Values]) -> Parameters:
    """Return the parameters of a computer with what a TOML file says in place of its own.

    Parameters
    ----------
    text : str
    current : dict
        All parameters that the computer has.

    Raises
    ------
    CalibrationFileError
        One line: where it is wrong, and what may be there.
    """
    try:
        return _changed(tomllib.loads(text), current)
    except tomllib.TOMLDecodeError as error:
        raise CalibrationFileError(f"not TOML: {error}") from error
    except _Wrong as wrong:
        raise CalibrationFileError(str(wrong)) from wrong


def _changed(tables: dict[str, Any], current: Mapping[int, Values]) -> Parameters:
    known = (*_SENSORS, "settings")
    _require_keys(tables, known, "the file")
    if not tables:
        raise _Wrong(f"nothing in it; it may have: {', '.join(known)}")
    parameters = {number: dict(values) for number, values in current.items()}
    for name, dids in _SENSORS.items():
        if name in tables:
            _change_sensors(parameters, _table(tables[name], name), name, dids)
    settings = _table(tables.get("settings", {}), "settings")
    _require_keys(settings, _BY_NAME, "settings")
    for name, values in settings.items():
        _change_setting(parameters, _BY_NAME[name], _table(values, f"settings.{name}"))
    return parameters


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise _Wrong(f"{where} is no table")
    return value


def _require_keys(table: Mapping[str, Any], known: Any, where: str) -> None:
    odd = [key for key in table if key not in known]
    if odd:
        raise _Wrong(f"{where}: unknown: {odd[0]}; there is: {', '.join(known)}")


def _change_sensors(
    parameters: Parameters, given: dict[str, Any], name: str, dids: Sequence[DataIdentifier]
) -> None:
    numbers = _present(dids, parameters)
    fields = {field.name: field for field in dids[0].fields}
    _require_keys(given, fields, name)
    for number in numbers:
        parameters[number] = dict.fromkeys(fields, 0.0)
    for key, value in given.items():
        where = f"{name}.{key}"
        values = value if isinstance(value, list) else [value] * len(numbers)
        if len(values) != len(numbers):
            raise _Wrong(f"{where}: {len(values)} values for {len(numbers)} sensors")
        for number, one in zip(numbers, values, strict=True):
            parameters[number][key] = _checked(fields[key], one, where)


def _change_setting(parameters: Parameters, did: DataIdentifier, given: dict[str, Any]) -> None:
    fields = {field.name: field for field in did.fields}
    where = f"settings.{did.name}"
    _require_keys(given, fields, where)
    if did.number not in parameters:
        raise _Wrong(f"{where}: this computer does not have it")
    for key, value in given.items():
        parameters[did.number][key] = _setting(fields[key], value, f"{where}.{key}")


def _setting(field: Field, value: Any, where: str) -> Value:
    if field.count == 1:
        return _checked(field, value, where)
    if not isinstance(value, list) or len(value) != field.count:
        raise _Wrong(f"{where}: {field.count} values are needed")
    row = tuple(float(_number(field, one, where)) for one in value)
    _check(field, row, where)
    return row


def _checked(field: Field, value: Any, where: str) -> int | float:
    """Return a value that may be written; raise `_Wrong` with the limits otherwise."""
    number = _number(field, value, where)
    _check(field, number, where)
    return number


def _number(field: Field, value: Any, where: str) -> int | float:
    if field.choices is not None and isinstance(value, str):
        value = field.choices.__members__.get(value, value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not (field.is_float or isinstance(value, int)):
        raise _Wrong(f"{where}: {value!r} is not one of its values; allowed: {limits_of(field)}")
    return float(value) if field.is_float else int(value)


def _check(field: Field, value: Value, where: str) -> None:
    try:
        field.check(value)
    except ValueRangeError as error:
        raise _Wrong(f"{where}: {error}; allowed: {limits_of(field)}") from error


# ---- files


def read(path: Path, current: Mapping[int, Values]) -> Parameters:
    """Return the parameters of a computer with what a file says in place of its own.

    Raises
    ------
    CalibrationFileError
        When it cannot be read, is damaged, or says what cannot be.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CalibrationFileError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        if path.suffix == RAW:
            return _whole(data, current)
        return from_toml(data.decode("utf-8"), current)
    except UnicodeDecodeError as error:
        raise CalibrationFileError(f"{path}: not TOML: not a text in UTF-8") from error
    except (CalibrationFileError, ImageError, _Wrong) as error:
        raise CalibrationFileError(f"{path}: {error}") from error


def _whole(data: bytes, current: Mapping[int, Values]) -> Parameters:
    parameters = image.decode(data)
    for number in parameters:
        if number not in current:
            raise _Wrong(f"it has 0x{number:04X}, which this computer does not have")
    return parameters


def write(path: Path, data: bytes, may_replace: bool) -> None:
    """Write a file, whole or not at all.

    Raises
    ------
    CalibrationFileError
        When it cannot be written, or is there already and may not be replaced.
    """
    if path.exists() and not may_replace:
        raise CalibrationFileError(f"{path}: is there already; --force replaces it")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            Path(name).chmod(0o644)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink()
            raise
    except OSError as error:
        raise CalibrationFileError(f"{path}: cannot be written: {error.strerror}") from error
