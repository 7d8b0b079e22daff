"""Parameters as settings of the computer, and settings as parameters."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.calibration import AccelerometerCalibration, GyroCalibration, each
from rrins.firmware_py.core.initial_attitude import InitialAttitude
from rrins.firmware_py.core.settings import Settings, check_weights
from rrins.firmware_py.diagnostics.calibration_image import Parameters
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    GYRO_CALIBRATIONS,
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

_Table = tuple[DataIdentifier, ...]
_Sensors = GyroCalibration | AccelerometerCalibration
_Axes = tuple[tuple[float, float], ...]


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
    return found


def _calibrations_of(settings: Settings) -> Iterator[tuple[_Table, _Sensors, _Axes]]:
    """Yield, for each kind of sensor, its parameters, its calibration and its input axes."""
    calibration = settings.calibration
    yield GYRO_CALIBRATIONS, calibration.gyros, settings.gyro_axes_deg
    yield (
        ACCELEROMETER_CALIBRATIONS,
        calibration.accelerometers,
        settings.accelerometer_axes_deg,
    )


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
    kinds = {}
    own = parameters_of(settings)
    for kind, (table, sensors, axes) in zip(_KINDS, _calibrations_of(settings), strict=True):
        used = table[: len(axes)]
        if any(parameter.number in parameters for parameter in used):
            rows = [parameters.get(p.number, own[p.number]) for p in used]
            columns = {f.name: tuple(row[f.name] for row in rows) for f in table[0].fields}
            kinds[kind] = sensors.model_copy(update=columns)
    if kinds:
        changes["calibration"] = settings.calibration.model_copy(update=kinds)
    return settings.model_copy(update=changes)
