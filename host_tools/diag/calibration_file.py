"""The calibration as a TOML file, and as the firmware's own file.

The tables ``[gyros]`` and ``[accelerometers]`` have the same form as in a scenario and in the
calibration file given to the firmware at startup: one number for all sensors, or a list with one
per sensor; omitted keys are zero. ``[settings.NAME]`` holds a parameter of the diagnostic table::

    [gyros]
    bias_dph = [0.1, 0.11, 0.12, 0.13]
    scale_error_ppm = 0

    [gyros.sigma]                           # standard deviations; omitted: not known
    scale_error_ppm = 1.9

    [calibrated]                            # omitted: not known
    date_utc = 2026-11-23T08:05:00Z
    temperature_c = 22.5

    [settings.bridge]
    bridge_s = 0.1

A ``.rrca`` file holds the raw bytes as the computer stores them
(`rrins.firmware_py.diagnostics.calibration_image`).
"""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from rrins.firmware_py.diagnostics import calibration_image
from rrins.firmware_py.diagnostics.calibration_image import ImageError, Parameters
from rrins.firmware_py.diagnostics.codecs import Field, Value, ValueRangeError, Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    ACCELEROMETER_SIGMAS,
    CALIBRATED,
    GYRO_CALIBRATIONS,
    GYRO_SIGMAS,
    SETTINGS,
)
from rrins.host_tools.diag.values import limits_of
from rrins.host_tools.errors import CalibrationFileError, RehearsalError
from rrins.host_tools.files import LARGEST_TOML, JsonObject, content_of, replacing

TOML, RAW = ".toml", ".rrca"
"""Extensions of the two file formats."""

_SENSORS = {"gyros": GYRO_CALIBRATIONS, "accelerometers": ACCELEROMETER_CALIBRATIONS}
_SIGMAS = {"gyros": GYRO_SIGMAS, "accelerometers": ACCELEROMETER_SIGMAS}
_SIGMA, _CALIBRATED = "sigma", "calibrated"
_DATE, _TEMPERATURE = "date_utc", "temperature_c"
_BY_NAME = {did.name: did for did in SETTINGS}


class _Wrong(Exception):  # noqa: N818 - becomes a CalibrationFileError with the file's name
    """An error in a file."""


def _present(dids: Sequence[DataIdentifier], parameters: Mapping[int, Values]) -> list[int]:
    return [did.number for did in dids if did.number in parameters]


# ---- to TOML


def to_toml(parameters: Mapping[int, Values], with_settings: bool) -> str:
    """Return parameters as TOML: the sensors' calibration and, if requested, the settings."""
    return "\n".join(_tables(parameters, with_settings))


def _tables(parameters: Mapping[int, Values], with_settings: bool) -> Iterator[str]:
    yield from _calibrated(parameters.get(CALIBRATED.number, {}))
    for name, dids in _SENSORS.items():
        yield f"[{name}]"
        yield from _lists(dids, parameters)
        yield ""
        sigmas = _SIGMAS[name]
        if any(any(parameters[n].values()) for n in _present(sigmas, parameters)):
            yield f"[{name}.{_SIGMA}]"
            yield from _lists(sigmas, parameters)
            yield ""
    for did in SETTINGS if with_settings else ():
        if did.number in parameters:
            yield f"[settings.{did.name}]"
            for field in did.fields:
                yield f"{field.name} = {_literal(field, parameters[did.number][field.name])}"
            yield ""


def _lists(dids: Sequence[DataIdentifier], parameters: Mapping[int, Values]) -> Iterator[str]:
    numbers = _present(dids, parameters)
    for field in dids[0].fields:
        values = ", ".join(_float(parameters[number][field.name]) for number in numbers)
        yield f"{field.name} = [{values}]"


def _calibrated(values: Mapping[str, Value]) -> Iterator[str]:
    seconds, temperature_c = values.get("date_utc_s", 0), values.get(_TEMPERATURE, 0.0)
    if not seconds and not values.get("temperature_known"):
        return
    yield f"[{_CALIBRATED}]"
    if seconds:
        assert isinstance(seconds, int)
        date = datetime.datetime.fromtimestamp(seconds, datetime.UTC)
        yield f"{_DATE} = {date:%Y-%m-%dT%H:%M:%SZ}"
    if values.get("temperature_known"):
        yield f"{_TEMPERATURE} = {_float(temperature_c)}"
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
    """Return the parameters of a computer, updated from the text of a TOML file.

    Parameters
    ----------
    text : str
    current : dict
        All parameters of the computer.

    Raises
    ------
    CalibrationFileError
        If the text is invalid; the message, one line, names the place and what is allowed.
    """
    try:
        return _changed(tomllib.loads(text), current)
    except tomllib.TOMLDecodeError as error:
        raise CalibrationFileError(f"not TOML: {error}") from error
    except _Wrong as wrong:
        raise CalibrationFileError(str(wrong)) from wrong


def _changed(tables: JsonObject, current: Mapping[int, Values]) -> Parameters:
    known = (*_SENSORS, _CALIBRATED, "settings")
    _require_keys(tables, known, "the file")
    if not tables:
        raise _Wrong(f"empty; allowed: {', '.join(known)}")
    parameters = {number: dict(values) for number, values in current.items()}
    for name, dids in _SENSORS.items():
        if name in tables:
            given = _table(tables[name], name)
            constants = {key: value for key, value in given.items() if key != _SIGMA}
            _change_sensors(parameters, constants, name, dids)
            where = f"{name}.{_SIGMA}"
            _change_sensors(parameters, _table(given.get(_SIGMA, {}), where), where, _SIGMAS[name])
    if any(name in tables for name in (*_SENSORS, _CALIBRATED)):
        _change_origin(parameters, _table(tables.get(_CALIBRATED, {}), _CALIBRATED))
    settings = _table(tables.get("settings", {}), "settings")
    _require_keys(settings, _BY_NAME, "settings")
    for name, values in settings.items():
        _change_setting(parameters, _BY_NAME[name], _table(values, f"settings.{name}"))
    return parameters


def _table(value: object, where: str) -> JsonObject:
    if not isinstance(value, dict):
        raise _Wrong(f"{where} is not a table")
    return value


def _require_keys(table: JsonObject, known: Collection[str], where: str) -> None:
    odd = [key for key in table if key not in known]
    if odd:
        raise _Wrong(f"{where}: unknown key {odd[0]}; allowed: {', '.join(known)}")


def _change_origin(parameters: Parameters, given: JsonObject) -> None:
    """Take when and how warm; what is not given is not known."""
    if CALIBRATED.number not in parameters:
        return
    _require_keys(given, (_DATE, _TEMPERATURE), _CALIBRATED)
    values: Values = {"date_utc_s": 0, "temperature_known": 0, _TEMPERATURE: 0.0}
    if _DATE in given:
        date, where = given[_DATE], f"{_CALIBRATED}.{_DATE}"
        if not isinstance(date, datetime.datetime) or date.tzinfo is None:
            raise _Wrong(
                f"{where}: {date!r} is not a time with its zone, such as 2026-11-23T08:05:00Z"
            )
        values["date_utc_s"] = _checked(CALIBRATED.fields[0], int(date.timestamp()), where)
    if _TEMPERATURE in given:
        where = f"{_CALIBRATED}.{_TEMPERATURE}"
        values["temperature_known"] = 1
        values[_TEMPERATURE] = _checked(CALIBRATED.fields[2], given[_TEMPERATURE], where)
    parameters[CALIBRATED.number] = values


def _change_sensors(
    parameters: Parameters, given: JsonObject, name: str, dids: Sequence[DataIdentifier]
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


def _change_setting(parameters: Parameters, did: DataIdentifier, given: JsonObject) -> None:
    fields = {field.name: field for field in did.fields}
    where = f"settings.{did.name}"
    _require_keys(given, fields, where)
    if did.number not in parameters:
        raise _Wrong(f"{where}: this computer does not have it")
    for key, value in given.items():
        parameters[did.number][key] = _setting(fields[key], value, f"{where}.{key}")


def _setting(field: Field, value: object, where: str) -> Value:
    if field.count == 1:
        return _checked(field, value, where)
    if not isinstance(value, list) or len(value) != field.count:
        raise _Wrong(f"{where}: needs {field.count} values")
    row = tuple(float(_number(field, one, where)) for one in value)
    _check(field, row, where)
    return row


def _checked(field: Field, value: object, where: str) -> int | float:
    """Return a valid value; raise `_Wrong` with the limits if it is not."""
    number = _number(field, value, where)
    _check(field, number, where)
    return number


def _number(field: Field, value: object, where: str) -> int | float:
    if field.choices is not None and isinstance(value, str):
        value = field.choices.__members__.get(value, value)
    is_of_kind = isinstance(value, int) or (field.is_float and isinstance(value, float))
    if not isinstance(value, int | float) or isinstance(value, bool) or not is_of_kind:
        raise _Wrong(f"{where}: {value!r} is invalid; allowed: {limits_of(field)}")
    return float(value) if field.is_float else int(value)


def _check(field: Field, value: Value, where: str) -> None:
    try:
        field.check(value)
    except ValueRangeError as error:
        raise _Wrong(f"{where}: {error}; allowed: {limits_of(field)}") from error


# ---- files


def read(path: Path, current: Mapping[int, Values]) -> Parameters:
    """Return the parameters of a computer, updated from a calibration file.

    Raises
    ------
    CalibrationFileError
        If the file cannot be read, is damaged, or contains an invalid value.
    """
    try:
        data = content_of(path, LARGEST_TOML)
    except OSError as error:
        raise CalibrationFileError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        if path.suffix == RAW:
            return _whole(data, current)
        return from_toml(data.decode("utf-8"), current)
    except UnicodeDecodeError as error:
        raise CalibrationFileError(f"{path}: not TOML: not UTF-8 text") from error
    except (CalibrationFileError, ImageError, _Wrong) as error:
        raise CalibrationFileError(f"{path}: {error}") from error


def _whole(data: bytes, current: Mapping[int, Values]) -> Parameters:
    parameters = calibration_image.decode(data)
    for number in parameters:
        if number not in current:
            raise _Wrong(f"contains 0x{number:04X}, which this computer does not have")
    return parameters


def write(path: Path, data: bytes, may_replace: bool) -> None:
    """Write a file atomically.

    Raises
    ------
    CalibrationFileError
        If it cannot be written, or exists and must not be replaced.
    """
    if path.exists() and not may_replace:
        raise CalibrationFileError(f"{path}: already exists; use --force to replace it")
    try:
        with replacing(path) as part, part.open("wb") as file:
            file.write(data)
    except RehearsalError as error:
        raise CalibrationFileError(str(error)) from error
