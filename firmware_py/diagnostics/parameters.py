"""The table of parameters: calibration and settings stored in the parameter memory.

A parameter is a data identifier that can be written. A written value takes effect at the next
reset; a parameter that was never written has the value of the computer's set-up.
"""

from __future__ import annotations

from enum import IntEnum

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.diagnostics.access import ANYWHERE, UNLOCKED
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier


class HeightChannel(IntEnum):
    """Treatment of the height."""

    HELD = 0
    DAMPED = 1
    FREE = 2


def _parameter(number: int, name: str, text: str, *fields: Field) -> DataIdentifier:
    return DataIdentifier(number, name, text, fields, ANYWHERE, write=UNLOCKED)


def _weights(number: int, sensors: str) -> DataIdentifier:
    # Limits as far apart as the fusion can compute with.
    return _parameter(number, f"{sensors}_weights",
        f"Fusion weights of the {sensors}s, by sensor; those beyond the last have no effect.",
        Field("weights", "f64", "", SENSOR_GROUPS, minimum=1e-9, maximum=1e9))  # fmt: skip


LASTING = (
    ("scale_error_ppm", "ppm", 1e5, "scale factor error"),
    ("asymmetric_scale_error_ppm", "ppm", 1e5,
        "scale factor error that changes sign with the input"),
    ("installation_u_arcsec", "″", 36_000.0, "installation error, paper (13)"),
    ("installation_v_arcsec", "″", 36_000.0, "installation error, paper (13)"),
)  # fmt: skip
"""Calibrated errors of a sensor besides its bias: name, unit, limit, text."""


def _calibration(
    base: int, index: int, sensor: str, bias: str, unit: str, limit: float, *more: Field
) -> DataIdentifier:
    errors = ((bias, unit, limit, "bias"), *LASTING)
    return _parameter(base + index, f"{sensor}_{index}_calibration",
        f"Errors of {sensor} {index} that the firmware removes from its increments.",
        *(Field(name, "f64", of, minimum=-most, maximum=most, text=text)
            for name, of, most, text in errors),
        *more)  # fmt: skip


def _sigma(base: int, index: int, sensor: str, bias: str, unit: str) -> DataIdentifier:
    errors = ((bias, unit), *(error[:2] for error in LASTING))
    return _parameter(base + index, f"{sensor}_{index}_calibration_sigma",
        f"Standard deviations of the calibrated errors of {sensor} {index}; 0: not known.",
        *(Field(name, "f64", of, minimum=0.0, maximum=1e5) for name, of in errors))  # fmt: skip


_POSITION = tuple(
    Field(f"position_{axis}_mm", "f64", "mm", minimum=-1000.0, maximum=1000.0,
        text=f"position on {axis} of the sensor frame, from the reference point")
    for axis in "xyz"
)  # fmt: skip

SETTINGS = (
    _parameter(0x1001, "start_position", "Position at the start of navigation.",
        Field("latitude_deg", "f64", "°", minimum=-89.9, maximum=89.9),
        Field("longitude_deg", "f64", "°", minimum=-180.0, maximum=180.0),
        Field("height_m", "f64", "m", minimum=-1000.0, maximum=100_000.0)),
    _parameter(0x1002, "initial_attitude",
        "The body's attitude at the start of navigation, if the attitude is given, and during the "
        "routine `calibration`.",
        Field("roll_deg", "f64", "°", minimum=-180.0, maximum=180.0),
        Field("pitch_deg", "f64", "°", minimum=-90.0, maximum=90.0),
        Field("heading_deg", "f64", "°", minimum=-360.0, maximum=360.0)),
    _parameter(0x1003, "alignment", "Method and duration of the alignment.",
        Field("method", "u8", choices=InitialAttitude),
        Field("alignment_s", "f64", "s", minimum=0.001, maximum=86_400.0)),
    _parameter(0x1004, "bridge", "Longest gap in the sensor data that is bridged.",
        Field("bridge_s", "f64", "s", minimum=0.0, maximum=10.0)),
    _parameter(0x1005, "axis_watch", "Limits beyond which an axis counts as not following.",
        Field("follow_tolerance_deg", "f64", "°", minimum=0.001, maximum=180.0),
        Field("axis_silence_s", "f64", "s", minimum=0.001, maximum=60.0)),
    _parameter(0x1006, "height_channel", "Treatment of the height.",
        Field("height_channel", "u8", choices=HeightChannel)),
    _weights(0x1007, "gyro"),
    _weights(0x1008, "accelerometer"),
    _parameter(0x1009, "consistency",
        "Permitted disagreement between redundant sensors: the root sum of squares of their "
        "residuals.",
        Field("gyro_consistency_dph", "f64", "°/h", minimum=0.001, maximum=1e6),
        Field("accelerometer_consistency_ug", "f64", "µg", minimum=0.1, maximum=1e7)),
)  # fmt: skip
"""Settings of the navigation computer."""

CALIBRATED = _parameter(0x1300, "calibrated",
    "When the sensors were calibrated, and how warm they were then.",
    Field("date_utc_s", "u32", "s", minimum=0, maximum=(1 << 32) - 1,
        text="since 1970-01-01 UTC; 0: not known"),
    Field("temperature_known", "u8", minimum=0, maximum=1),
    Field("temperature_c", "f64", "°C", minimum=-100.0, maximum=200.0))  # fmt: skip
"""Origin of the calibration."""

_SENSORS = range(1, SENSOR_GROUPS + 1)

GYRO_CALIBRATIONS = tuple(
    _calibration(0x1100, index, "gyro", "bias_dph", "°/h", 10_000.0) for index in _SENSORS
)
"""Calibration of each gyro."""

ACCELEROMETER_CALIBRATIONS = tuple(
    _calibration(0x1200, index, "accelerometer", "bias_ug", "µg", 1_000_000.0, *_POSITION)
    for index in _SENSORS
)
"""Calibration of each accelerometer."""

GYRO_SIGMAS = tuple(_sigma(0x1180, index, "gyro", "bias_dph", "°/h") for index in _SENSORS)
"""How well each gyro's calibration is known."""

ACCELEROMETER_SIGMAS = tuple(
    _sigma(0x1280, index, "accelerometer", "bias_ug", "µg") for index in _SENSORS
)
"""How well each accelerometer's calibration is known."""

PARAMETERS = (
    *SETTINGS,
    *GYRO_CALIBRATIONS,
    *GYRO_SIGMAS,
    *ACCELEROMETER_CALIBRATIONS,
    *ACCELEROMETER_SIGMAS,
    CALIBRATED,
)
"""All parameters."""
