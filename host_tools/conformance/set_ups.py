"""Overrides of scenarios for the runs that are compared."""

from __future__ import annotations

from typing import Any, Final

from rrins.host_tools.testing.scenarios import merged


def of(*tables: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return tables merged, key by key."""
    result: dict[str, Any] = {}
    for table in (*tables, more):
        result = merged(result, table)
    return result


def operator(*requests: tuple[float, str]) -> dict[str, Any]:
    """Return the operator's requests."""
    return {"operator": [{"at_s": at_s, "request": request} for at_s, request in requests]}


QUICK: Final[dict[str, Any]] = {
    "firmware": {"turn_rate_dps": 30.0, "stand_s": 0.5},
    "turntable": {
        "inner": {"acceleration_limit_dps2": 200.0},
        "outer": {"acceleration_limit_dps2": 150.0},
    },
}
"""A position in some seconds."""

SITE: Final[dict[str, Any]] = {
    "site": {"latitude_deg": -33.86, "longitude_deg": 151.2, "height_m": 1200.0},
    "body": {"roll_deg": 3.0, "pitch_deg": -7.0, "heading_deg": 200.0},
}

ALTIMETER: Final[dict[str, Any]] = {
    "altimeter": {"bias_m": 5.0, "noise_m": 0.5},
    "firmware": {"height_channel": "damped"},
}

ROTATING: Final[dict[str, Any]] = {"navigate_at_s": 0.2}

IN: Final = of(QUICK, SITE, ALTIMETER, ROTATING)

REQUESTS: Final = operator(
    (0.1, "NAVIGATE_ROTATING"),
    (4.0, "ALIGN"),
    (5.0, "NAVIGATE_STRAPDOWN"),
    (6.0, "NAVIGATE_ROTATING"),
    (6.9, "STANDBY"),
    (7.0, "ALIGN"),
    (9.5, "NAVIGATE_STRAPDOWN"),
    (10.7, "STANDBY"),
    (11.3, "ALIGN"),
    (11.6, "STANDBY"),
    (12.0, "NAVIGATE_ROTATING"),
    (12.3, "NAVIGATE_STRAPDOWN"),
    (14.0, "NAVIGATE_ROTATING"),
    (16.0, "ALIGN"),
    (17.0, "STANDBY"),
    (17.3, "NAVIGATE_ROTATING"),
)

IN_FAULT: Final = operator(
    (2.0, "NAVIGATE_ROTATING"),
    (4.6, "ALIGN"),
    (5.2, "NAVIGATE_STRAPDOWN"),
    (6.0, "STANDBY"),
    (8.0, "NAVIGATE_ROTATING"),
)

STRAPDOWN: Final[dict[str, Any]] = {"mode": "strapdown", "navigate_at_s": 0.2}

WINDING: Final = of(
    QUICK,
    firmware={
        "scheme": [
            {"axis": "outer", "angle_deg": -90.0},
            {"axis": "inner", "angle_deg": 720.0},
            {"axis": "inner", "angle_deg": 12.3456789},
        ],
        "turn_rate_dps": 55.0,
    },
    turntable={"inner": {"rate_limit_dps": 60.0}, "outer": {"rate_limit_dps": 60.0}},
)
"""A scheme that does not close, with fractions of a degree: angles wrap after 64 turns."""

JERKY: Final = of(
    QUICK,
    turntable={"inner": {"jerk_limit_dps3": 400.0}, "outer": {"jerk_limit_dps3": 400.0}},
    firmware={"stand_s": 1.5},
)

STALLED: Final[dict[str, Any]] = {
    "faults": [
        {"kind": "axis_stall", "axis": "inner", "at_s": 4.0, "for_s": 1.3},
        {"kind": "axis_stall", "axis": "outer", "at_s": 13.0, "for_s": 2.6},
    ]
}

ABANDONED: Final[dict[str, Any]] = {
    "faults": [{"kind": "axis_stall", "axis": "inner", "at_s": 4.0}]
}
RUNAWAY: Final[dict[str, Any]] = {
    "faults": [
        {"kind": "axis_runaway", "axis": "outer", "rate_dps": 8.0, "at_s": 4.0, "for_s": 1.3}
    ]
}

TWICE: Final = operator(
    (0.2, "NAVIGATE_ROTATING"), (5.0, "NAVIGATE_STRAPDOWN"), (6.0, "NAVIGATE_ROTATING")
)

AGAIN: Final = operator((0.2, "NAVIGATE_ROTATING"), (11.5, "STANDBY"), (12.5, "NAVIGATE_ROTATING"))

NORTH: Final = of(
    ROTATING,
    site={"latitude_deg": 71.2, "longitude_deg": -179.5, "height_m": 90_000.0},
    body={"roll_deg": -100.0, "pitch_deg": 40.0, "heading_deg": 359.9999},
    firmware={"height_channel": "free"},
)

DATE_LINE: Final[dict[str, Any]] = {
    "site": {"latitude_deg": 5.0, "longitude_deg": 179.99999},
    "body": {"heading_deg": 0.001},
}

POLE: Final[dict[str, Any]] = {"site": {"latitude_deg": 89.9}}

ALIGNING: Final[dict[str, Any]] = {
    "mode": "strapdown",
    "navigate_at_s": 0.2,
    "firmware": {"initial_attitude": "self-aligned", "alignment_s": 60.0},
}

WEIGHTED: Final[dict[str, Any]] = {
    "rimu": {"geometry": "dodecahedron"},
    "gyros": {"bias_dph": 0.1},
    "accelerometers": {"bias_ug": 50.0},
    "firmware": {
        "gyro_weights": [1.0, 2.0, 0.5, 3.0, 1.0, 0.2],
        "accelerometer_weights": [0.3, 1.0, 1.0, 5.0, 2.0, 1.0],
    },
}

CUSTOM: Final[dict[str, Any]] = {
    "rimu": {
        "geometry": "custom",
        "gyro_axes_deg": [[0, 0], [60, 10], [70, 130], [80, 250], [90, 300]],
        "accelerometer_axes_deg": [[90, 0], [90, 90], [0, 0]],
    },
    "gyros": {"bias_dph": 0.1},
    "accelerometers": {"bias_ug": 50.0},
}

CONE: Final[dict[str, Any]] = {"rimu": {"geometry": "cone"}}

PLANE: Final[dict[str, Any]] = {
    "rimu": {
        "geometry": "custom",
        "gyro_axes_deg": [[90, 0], [90, 60], [90, 120], [0, 0]],
        "accelerometer_axes_deg": [[90, 0], [90, 60], [89.8, 120], [0.3, 0]],
    }
}
"""Without one sensor the others lie in a plane, or almost."""

SCALES: Final[dict[str, Any]] = {
    "gyros": {"scale_error_ppm": 100.0},
    "accelerometers": {"scale_error_ppm": [100.0, -100.0, 100.0, -100.0]},
}

WAVES: Final[dict[str, Any]] = {
    "motion": {"kind": "sway", "begins_s": -60.0, "wave_height_m": 1.2, "wave_period_s": 4.0},
    "firmware": {"height_channel": "free"},
}

SILENCE: Final[dict[str, Any]] = {"firmware": {"axis_silence_s": 0.4, "stand_s": 2.0}}
TWO_ALIGNMENTS: Final = operator(
    (0.2, "NAVIGATE_STRAPDOWN"), (70.0, "STANDBY"), (71.0, "NAVIGATE_STRAPDOWN")
)
RISING: Final[dict[str, Any]] = {"firmware": {"height_channel": "free"}}
