"""What data identifiers tell of the estimator."""

from __future__ import annotations

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.estimator_records import AIDS, Aid
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier

_SOURCES = ", ".join(aid.name.lower() for aid in Aid)


def _biases(number: int, one: str, unit: str, suffix: str) -> DataIdentifier:
    return DataIdentifier(
        number,
        f"estimator_{one}s",
        f"The bias that the estimator finds of each {one}, and how well it knows it.",
        (
            Field(
                f"estimated_bias_{suffix}",
                "f32",
                unit,
                SENSOR_GROUPS,
                text="along the input axis, beyond what calibration removes",
            ),
            Field(f"estimated_bias_sigma_{suffix}", "f32", unit, SENSOR_GROUPS),
        ),
    )


ESTIMATOR = (
    DataIdentifier(
        0x0226,
        "estimator_sigma",
        "How well the estimator knows the navigation: standard deviations after the last second.",
        (
            Field("running", "u8", source="estimator.running"),
            Field(
                "aligned_epochs",
                "u32",
                source="estimator.aligned_epochs",
                text="length of the last fine alignment, so far",
            ),
            Field("attitude_sigma_arcsec", "f32", "″", 3, text="about east, north, up"),
            Field("velocity_sigma_mps", "f32", "m/s", 3, text="east, north, up"),
            Field("position_sigma_m", "f32", "m", 3, text="east, north, up"),
        ),
    ),
    DataIdentifier(
        0x0227,
        "estimator_sources",
        f"How the measurements of each source fared, in this order: {_SOURCES}.",
        (
            Field("used", "u32", "", AIDS, source="estimator.sources.used", text="scalars"),
            Field(
                "rejected",
                "u32",
                "",
                AIDS,
                source="estimator.sources.rejected",
                text="scalars that failed the gate",
            ),
            Field(
                "rejected_in_a_row",
                "u32",
                "",
                AIDS,
                source="estimator.sources.rejected_in_a_row",
                text="of these, since the last one that passed",
            ),
            Field(
                "nis",
                "f32",
                "",
                AIDS,
                text="mean square of the innovations used over their variance",
            ),
        ),
    ),
    _biases(0x0228, "gyro", "°/h", "dph"),
    _biases(0x0229, "accelerometer", "µg", "ug"),
)
"""The estimator."""
