"""Findings in words, by the names of their values in the DBC; importing this is quick."""

from __future__ import annotations

from typing import Final

FOUND_BY: Final = {
    "PARITY": "comparison with the others",
    "FULL_SCALE": "its end of range, where the others measure little",
    "STANDING": "comparison with encoders, Earth rate and gravity",
    "STUCK": "its repeated increments",
    "ABSENT": "its flag",
    "REFERENCE": "a reference of velocity",
    "OPERATOR": "the operator",
}
"""How a faulty sensor was found."""

NOT_READMITTED: Final = {
    "NOT_LEFT_OUT": "it is in use",
    "NOT_COMPARABLE": "no other sensor depends on it",
    "PARITY": "it differs from the others",
    "LIMITS": "its bias is far beyond its data sheet",
    "MISSING": "it is absent too often",
    "STUCK": "it repeats itself",
    "SET_CHANGED": "another sensor was excluded or came back meanwhile",
}
"""Why a sensor was not readmitted."""

WITHOUT_ENCODER: Final = {
    "CORRECTED": "its angle is corrected",
    "GYROS": "the gyros' angle is used",
    "COMMAND": "the commanded angle is used",
}
"""Source of the angle of an encoder that was found wrong."""


MOST_PARITY: Final = 40.95
"""Largest ratio of a parity to its threshold that the bus carries: it may have been larger."""


def parity_words(ratio: float) -> str:
    """Return a parity over its threshold: `0.17`, `40.95 or more`."""
    return f"{ratio:.2f}{' or more' if ratio >= MOST_PARITY else ''}"


def extent_words(drift: str) -> str:
    """Return how far a calibration has drifted: `from 10 to 20 ppm`."""
    return drift.lower().replace("_", " ")


def drift_words(sensor: str, drift: str) -> str:
    """Return that the calibration of a kind of sensor, `gyro` or `accelerometer`, has drifted."""
    return f"{sensor} calibration drifted: {extent_words(drift)}, if it is one {sensor}"


def abandoned_words(axis: str) -> str:
    """Return that the rotation about an axis was abandoned."""
    return f"the {axis} axis did not follow in any try: rotation abandoned"
