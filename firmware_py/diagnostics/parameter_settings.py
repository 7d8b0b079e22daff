"""Parameters as settings of the computer, and settings as parameters."""

from __future__ import annotations

import datetime
import functools
from collections.abc import Iterator, Mapping

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.sensors.calibration import (
    AccelerometerCalibration,
    AccelerometerSigmas,
    GyroCalibration,
    GyroSigmas,
    Origin,
    each,
)
from rrins.firmware_py.core.settings import Settings, check_weights
from rrins.firmware_py.diagnostics.calibration_image import Parameters
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    ACCELEROMETER_SIGMAS,
    CALIBRATED,
    GYRO_CALIBRATIONS,
    GYRO_SIGMAS,
    LASTING,
    SETTINGS,
    HeightChannel,
)

_NUMBER = {parameter.name: parameter.number for parameter in SETTINGS}

# Settings that a parameter's field has under the same name.
_PLAIN = {
    "start_position": ("latitude_deg", "longitude_deg", "height_m"),
    "initial_attitude": ("roll_deg", "pitch_deg", "heading_deg"),
    "alignment": ("alignment_s",),
    "bridge": ("bridge_s",),
    "axis_watch": ("follow_tolerance_deg", "axis_silence_s"),
    "consistency": ("gyro_consistency_dph", "accelerometer_consistency_ug"),
}
# Enumerated fields: setting, parameter, its field, names.
_NAMED = (
    ("initial_attitude", "alignment", "method", InitialAttitude),
    ("height_channel", "height_channel", "height_channel", HeightChannel),
)
_WEIGHTS = ("gyro_weights", "accelerometer_weights")
_KINDS = ("gyros", "accelerometers")  # fields of the calibration
_LASTING = tuple(name for name, *_ in LASTING)
"""Constants that a calibration is about; a bias is found anew after each power-up."""

_UNKNOWN: Values = {"date_utc_s": 0, "temperature_known": 0, "temperature_c": 0.0}

_Table = tuple[DataIdentifier, ...]
_Sensors = GyroCalibration | AccelerometerCalibration
_Axes = tuple[tuple[float, float], ...]

_SIGMAS: dict[str, tuple[_Table, type[GyroSigmas] | type[AccelerometerSigmas]]] = {
    "gyros": (GYRO_SIGMAS, GyroSigmas),
    "accelerometers": (ACCELEROMETER_SIGMAS, AccelerometerSigmas),
}


@functools.lru_cache(maxsize=8)
def parameters_of(settings: Settings) -> Parameters:
    """Return all parameters that a computer with these settings has, with their values."""
    found: Parameters = {}
    for name, fields in _PLAIN.items():
        found[_NUMBER[name]] = {field: getattr(settings, field) for field in fields}
    for setting, name, field, names in _NAMED:
        chosen = names[getattr(settings, setting).upper().replace("-", "_")]
        found.setdefault(_NUMBER[name], {})[field] = int(chosen)
    for name in _WEIGHTS:
        weights: tuple[float, ...] = getattr(settings, name)
        padding = (1.0,) * (SENSOR_GROUPS - len(weights))
        found[_NUMBER[name]] = {"weights": weights + padding}
    for table, sensors, axes in _calibrations_of(settings):
        columns = {
            name: each(getattr(sensors, name), len(axes)).tolist()
            for name in (field.name for field in table[0].fields)
        }
        for index, parameter in enumerate(table[: len(axes)]):
            found[parameter.number] = {name: column[index] for name, column in columns.items()}
    for kind, (_, sensors, axes) in zip(_KINDS, _calibrations_of(settings), strict=True):
        found |= _sigmas_of(kind, sensors, len(axes))
    found[CALIBRATED.number] = _values_of(settings.calibration.calibrated)
    return found


def _sigmas_of(kind: str, sensors: _Sensors, count: int) -> Parameters:
    table = _SIGMAS[kind][0][:count]
    known = {} if sensors.sigma is None else sensors.sigma.model_dump()
    columns = {f.name: each(known.get(f.name, 0.0), count).tolist() for f in table[0].fields}
    return {
        parameter.number: {name: column[index] for name, column in columns.items()}
        for index, parameter in enumerate(table)
    }


def _values_of(origin: Origin) -> Values:
    """Return when and how warm as the values of a parameter."""
    values = dict(_UNKNOWN)
    if origin.date_utc is not None:
        values["date_utc_s"] = int(origin.date_utc.timestamp())
    if origin.temperature_c is not None:
        values |= {"temperature_known": 1, "temperature_c": origin.temperature_c}
    return values


def _origin_of(values: Values) -> Origin:
    """Return when and how warm of the values of a parameter."""
    seconds, temperature_c = values["date_utc_s"], values["temperature_c"]
    assert isinstance(seconds, int)
    assert isinstance(temperature_c, float)
    date = datetime.datetime.fromtimestamp(seconds, datetime.UTC) if seconds else None
    is_known = bool(values["temperature_known"])
    return Origin(date_utc=date, temperature_c=temperature_c if is_known else None)


def with_origin(before: Mapping[int, Values], parameters: Mapping[int, Values]) -> Parameters:
    """Return changes of parameters, with what they make unknown of the calibration's origin.

    Where a scale factor or the installation of a sensor changes, and nothing says how well it is
    known, and since when, it is not known any more.

    Parameters
    ----------
    before : dict
        All parameters of the computer.
    parameters : dict
        What changes.
    """
    found: Parameters = dict(parameters)
    pairs = (
        *zip(GYRO_CALIBRATIONS, GYRO_SIGMAS, strict=True),
        *zip(ACCELEROMETER_CALIBRATIONS, ACCELEROMETER_SIGMAS, strict=True),
    )
    for constants, sigma in pairs:
        values = parameters.get(constants.number)
        former = before.get(constants.number)
        if values is None or former is None:
            continue
        if all(values[name] == former[name] for name in _LASTING):
            continue
        if sigma.number not in parameters:
            found[sigma.number] = dict.fromkeys((field.name for field in sigma.fields), 0.0)
        if CALIBRATED.number not in parameters:
            found[CALIBRATED.number] = dict(_UNKNOWN)
    return found


def _calibrations_of(settings: Settings) -> Iterator[tuple[_Table, _Sensors, _Axes]]:
    """Yield, for each kind of sensor, its parameters, its calibration and its input axes."""
    calibration = settings.calibration
    yield GYRO_CALIBRATIONS, calibration.gyros, settings.gyro_axes_deg
    yield (ACCELEROMETER_CALIBRATIONS, calibration.accelerometers, settings.accelerometer_axes_deg)


def unusable(settings: Settings, parameters: Mapping[int, Values]) -> set[int]:
    """Return the numbers of the weights among parameters with which the sensors cannot be fused."""
    found = set()
    axes = (settings.gyro_axes_deg, settings.accelerometer_axes_deg)
    for name, axes_deg in zip(_WEIGHTS, axes, strict=True):
        number = _NUMBER[name]
        if number in parameters:
            try:
                check_weights(
                    getattr(changed(settings, {number: parameters[number]}), name), axes_deg
                )
            except ValueError:
                found.add(number)
    return found


def changed(settings: Settings, parameters: Mapping[int, Values]) -> Settings:
    """Return settings with the values of parameters substituted."""
    changes: dict[str, object] = {}
    for name, fields in _PLAIN.items():
        values = parameters.get(_NUMBER[name], {})
        changes.update({field: values[field] for field in fields if field in values})
    for setting, name, field, names in _NAMED:
        if _NUMBER[name] in parameters:
            number = parameters[_NUMBER[name]][field]
            assert isinstance(number, int)
            chosen = names(number)
            changes[setting] = chosen.name.lower().replace("_", "-")
    for name in _WEIGHTS:
        if _NUMBER[name] in parameters:
            weights = parameters[_NUMBER[name]]["weights"]
            assert isinstance(weights, tuple)
            changes[name] = weights[: len(getattr(settings, name))]
    kinds: dict[str, object] = {}
    own = parameters_of(settings)
    for kind, (table, sensors, axes) in zip(_KINDS, _calibrations_of(settings), strict=True):
        sigmas, sigma_model = _SIGMAS[kind]
        columns = _columns(table[: len(axes)], parameters, own)
        known = _columns(sigmas[: len(axes)], parameters, own)
        if known:
            columns["sigma"] = sigma_model.model_validate(known) if _any(known) else None
        if columns:
            kinds[kind] = sensors.model_copy(update=columns)
    if CALIBRATED.number in parameters:
        kinds["calibrated"] = _origin_of(parameters[CALIBRATED.number])
    if kinds:
        changes["calibration"] = settings.calibration.model_copy(update=kinds)
    return settings.model_copy(update=changes)


def _columns(
    table: _Table, parameters: Mapping[int, Values], own: Mapping[int, Values]
) -> dict[str, object]:
    """Return each field's values by sensor, where one of the sensors' parameters is given."""
    if not any(parameter.number in parameters for parameter in table):
        return {}
    rows = [parameters.get(parameter.number, own[parameter.number]) for parameter in table]
    return {field.name: tuple(row[field.name] for row in rows) for field in table[0].fields}


def _any(columns: Mapping[str, object]) -> bool:
    return any(isinstance(values, tuple) and any(values) for values in columns.values())
