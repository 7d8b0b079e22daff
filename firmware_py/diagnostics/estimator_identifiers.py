"""Data identifiers of the estimator."""

from __future__ import annotations

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.estimator_records import AIDS, Aid
from rrins.firmware_py.core.records.integrity_records import IntegrityStatus
from rrins.firmware_py.core.sensors.calibration import ARCSEC, PPM
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier

_SOURCES = ", ".join(aid.name.lower() for aid in Aid)


def _biases(number: int, one: str, unit: str, suffix: str) -> DataIdentifier:
    return DataIdentifier(number, f"estimator_{one}s",
        f"The bias that the estimator finds of each {one}, and how well it knows it.", (
        Field(f"estimated_bias_{suffix}", "f32", unit, SENSOR_GROUPS,
            text="along the input axis, beyond what calibration removes"),
        Field(f"estimated_bias_sigma_{suffix}", "f32", unit, SENSOR_GROUPS),
    ))  # fmt: skip


CONSTANTS = (
    ("scale_ppm", PPM),
    ("asymmetry_ppm", PPM),
    ("installation_u_arcsec", ARCSEC),
    ("installation_v_arcsec", ARCSEC),
)
"""Names and units of what is estimated of a sensor besides its bias, in the order of `constant`."""

_UNITS = {PPM: "ppm", ARCSEC: "″"}


def _constants(number: int, one: str) -> DataIdentifier:
    return DataIdentifier(number, f"estimator_{one}_constants",
        f"Scale factors and installation errors that the estimator finds of each {one}.", tuple(
        Field(f"{one}_{name}{suffix}", "f32", _UNITS[unit], SENSOR_GROUPS, text=text)
        for name, unit in CONSTANTS
        for suffix, text in (("", "beyond what calibration removes"), ("_sigma", ""))
    ))  # fmt: skip


ESTIMATOR = (
    DataIdentifier(0x0226, "estimator_sigma",
        "How well the estimator knows the navigation: standard deviations after the last second.", (
        Field("running", "u8", source="estimator.running"),
        Field("aligned_epochs", "u32", source="estimator.aligned_epochs",
            text="length of the last fine alignment, so far"),
        Field("attitude_sigma_arcsec", "f32", "″", 3, text="about east, north, up"),
        Field("velocity_sigma_mps", "f32", "m/s", 3, text="east, north, up"),
        Field("position_sigma_m", "f32", "m", 3, text="east, north, up"),
    )),
    DataIdentifier(0x0227, "estimator_sources",
        f"How the measurements of each source fared, in this order: {_SOURCES}.", (
        Field("used", "u32", "", AIDS, source="estimator.sources.used", text="scalars"),
        Field("rejected", "u32", "", AIDS, source="estimator.sources.rejected",
            text="scalars that failed the gate"),
        Field("rejected_in_a_row", "u32", "", AIDS, source="estimator.sources.rejected_in_a_row",
            text="of these, since the last one that passed"),
        Field("nis", "f32", "", AIDS,
            text="mean square of the innovations used over their variance"),
    )),
    _biases(0x0228, "gyro", "°/h", "dph"),
    _biases(0x0229, "accelerometer", "µg", "ug"),
    _constants(0x022A, "gyro"),
    _constants(0x022B, "accelerometer"),
    DataIdentifier(0x022C, "estimator_aids",
        "What the estimator finds of odometer and altimeter, where they are fitted.", (
        Field("odometer_scale_ppm", "f32", "ppm", text="what it counts too little"),
        Field("odometer_scale_sigma_ppm", "f32", "ppm"),
        Field("mounting_deg", "f32", "°", 2,
            text="by how much the forward axis points right of and above y of the body"),
        Field("mounting_sigma_deg", "f32", "°", 2),
        Field("altimeter_bias_m", "f32", "m"),
        Field("altimeter_bias_sigma_m", "f32", "m"),
    )),
    DataIdentifier(0x022D, "integrity",
        "Bounds of the navigation's error for the stated risk, and what they are worth.", (
        Field("integrity_status", "u8", choices=IntegrityStatus, source="integrity.status"),
        Field("suspected", "u8", source="integrity.suspected",
            text="whether a fault is suspected that is not resolved"),
        Field("unmonitored", "u8", source="integrity.unmonitored",
            text="whether redundant sensors are not compared, or one is left out"),
        Field("refusing", "u8", source="integrity.refusing", text="whether an aid is refused"),
        Field("horizontal_protection_m", "f32", "m", text="1e9: no bound"),
        Field("vertical_protection_m", "f32", "m", text="1e9: no bound"),
        Field("heading_protection_deg", "f32", "°", text="1e9: no bound"),
    )),
)  # fmt: skip
"""The estimator, and the integrity that follows from it."""
