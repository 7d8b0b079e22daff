"""Redundant sensors in data identifiers, freeze frames and routines."""

from __future__ import annotations

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.calibration_records import DriftState
from rrins.firmware_py.core.records.redundancy_records import (
    BEFORE_S,
    Found,
    ReadmissionState,
    Refusal,
    SensorKind,
)
from rrins.firmware_py.core.sensors.calibration import DPH, PPM, UG
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier

_ORDERED = "redundancy.readmission"

READMISSION = (
    Field("refusal", "u8", choices=Refusal, source=f"{_ORDERED}.refusal"),
    Field("kind", "u8", choices=SensorKind, source=f"{_ORDERED}.kind"),
    Field("sensor", "u8", source=f"{_ORDERED}.sensor", text="from 1; 0: none was ordered yet"),
    Field("anew", "u8", source=f"{_ORDERED}.anew", text="its constants are learned anew"),
    Field("passed_s", "u16", "s", source=f"{_ORDERED}.passed_s", text="compared so far"),
    Field("test_s", "u16", "s", source=f"{_ORDERED}.wanted_s", text="length of the test"),
    Field("parity_ratio", "f32", source=f"{_ORDERED}.ratio",
        text="the largest over its threshold; above 1, the sensor does not pass"),
)  # fmt: skip
"""A sensor on its way back."""


def _parity(number: int, kind: str, one: str, unit: str) -> DataIdentifier:
    source = f"redundancy.{kind}"
    suffix = "dph" if unit == "°/h" else "ug"
    return DataIdentifier(number, f"{one}_parity",
        f"How well the {kind} agree, and which of them has been left out.", (
        Field("parity_ratio", "f32", source=f"{source}.ratio",
            text="the largest parity of the last second over its threshold"),
        Field("window_s", "f32", "s", source=f"{source}.window_s", text="of that parity"),
        Field("suspect", "u8", source=f"{source}.suspect", offset=1, text="from 1; 0: none"),
        Field("alarm", "u8", source=f"{source}.alarm"),
        Field("redundancy_left", "u8", source=f"{source}.redundancy_left"),
        Field("standing_s", "u32", "s", source=f"{source}.now.standing",
            text="compared with encoders, Earth rate and gravity, too"),
        Field("excluded", "u16", source=f"{source}.excluded", text="left out, one bit each"),
        Field("isolated", "u8", source=f"{source}.isolated", offset=1,
            text="left out last, from 1; 0: none"),
        Field("how", "u8", choices=Found, source=f"{source}.how", text="it was found"),
        Field("readmitted", "u8", source=f"{source}.readmitted", offset=1,
            text="came back last, from 1; 0: none"),
        Field("alarm_epoch", "i64", source=f"{source}.alarm_epoch", text="0: none"),
        Field("isolated_epoch", "i64", source=f"{source}.isolated_epoch", text="0: none"),
        Field("repaired_epoch", "i64", source=f"{source}.repaired_epoch",
            text="from which on the navigation was repaired; -1: none"),
        Field("readmitted_epoch", "i64", source=f"{source}.readmitted_epoch", text="0: none"),
        Field(f"parity_residual_{suffix}", "f32", unit, SENSOR_GROUPS,
            text="mean of the last second, less what was learned"),
        Field(f"parity_threshold_{suffix}", "f32", unit, SENSOR_GROUPS,
            text="of that residual; 0: the sensor is not compared"),
    ))  # fmt: skip


def _before(number: int, kind: str, one: str, unit: str, size: float) -> DataIdentifier:
    source = f"redundancy.{kind}.before"
    return DataIdentifier(number, f"{one}_parity_before",
        f"The {BEFORE_S} s before the last alarm of the {kind}, oldest first; in the freeze "
        "frames of their trouble codes, too.", (
        Field("alarm_epoch", "i64", source=f"{source}.epoch", text="0: none"),
        Field("parity_ratio", "f32", "", BEFORE_S, source=f"{source}.ratio"),
        Field(f"residual_{'dph' if unit == '°/h' else 'ug'}", "f32", unit, BEFORE_S * SENSOR_GROUPS,
            source=f"{source}.residual", factor=1.0 / size,
            text=f"{SENSOR_GROUPS} sensors in each second"),
    ))  # fmt: skip


PARITY_BEFORE = {
    SensorKind.GYRO: _before(0x0223, "gyros", "gyro", "°/h", DPH),
    SensorKind.ACCELEROMETER: _before(0x0224, "accelerometers", "accelerometer", "µg", UG),
}
"""In the freeze frames of the trouble codes of a kind's redundancy."""


def _drift(kind: str, one: str) -> tuple[Field, ...]:
    source = f"calibration.{kind}"
    return (
        Field(f"{one}_drift", "u8", choices=DriftState, source=f"{source}.state"),
        Field(f"{one}_drift_sigma", "f32", source=f"{source}.distance",
            text="distance of what the parity has learned from what was calibrated, σ"),
        Field(f"{one}_limit_sigma", "f32", source=f"{source}.limit", text="of that distance"),
        Field(f"{one}_drift_ppm", "f32", "ppm", source=f"{source}.change", factor=1.0 / PPM,
            text="if it is of one sensor; 1 ppm of scale factor or 0.2″ of installation"),
        Field(f"{one}_told", "u8", source=f"{source}.told",
            text="directions x, y, z of the sensor frame of which the parity tells, one bit each"),
        Field(f"{one}_drift_epoch", "i64", source=f"{source}.since_epoch",
            text="in which the drift was last found; 0: never"),
    )  # fmt: skip


CALIBRATION_STATUS = DataIdentifier(0x0210, "calibration_status",
    "The calibration in use: when it was made, how warm the sensors were, and whether the parity "
    "has found that scale factors or installation have drifted since.", (
    Field("date_utc_s", "u32", "s", source="calibration.date_utc_s",
        text="since 1970-01-01 UTC; 0: not known"),
    Field("temperature_known", "u8", source="calibration.temperature_known"),
    Field("temperature_c", "f32", "°C", source="calibration.temperature_c"),
    *_drift("gyros", "gyro"),
    *_drift("accelerometers", "accelerometer"),
))  # fmt: skip
"""The calibration in use."""

REDUNDANCY = (
    _parity(0x0221, "gyros", "gyro", "°/h"),
    _parity(0x0222, "accelerometers", "accelerometer", "µg"),
    *PARITY_BEFORE.values(),
    DataIdentifier(0x0225, "readmission",
        "The last order to readmit a sensor, and what has become of it.",
        (Field("state", "u8", choices=ReadmissionState, source=f"{_ORDERED}.state"), *READMISSION)),
    CALIBRATION_STATUS,
)  # fmt: skip
"""Redundancy."""
