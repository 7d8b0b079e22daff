"""The RAM image: all state of the firmware, as one record of fixed size.

A step takes an array of one `RAM` record and changes it in place. Copy the array to take a
snapshot; compare two byte for byte to know whether two runs were the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.contract import SENSOR_GROUPS
from firmware_py.diagnostics.records import DIAGNOSTICS

SCHEME_CAPACITY = 64
"""The most positions that a rotation scheme can have."""

INNER, OUTER = 0, 1
"""Index of an axis wherever an array is over the two axes."""


def _record(fields: list[Any]) -> np.dtype[Any]:
    return np.dtype((np.record, fields), align=False)


PARAMETERS = _record(
    [
        ("period_ns", "<i8"),
        ("latitude", "<f8"),  # rad, where navigation starts
        ("longitude", "<f8"),  # rad
        ("height", "<f8"),  # m
        ("C_b_n", "<f8", (3, 3)),  # initial attitude, when given
        ("self_aligned", "?"),
        ("alignment_epochs", "<i8"),
        ("height_channel", "<i8"),
        ("altimeter", "?"),  # whether one is fitted
        ("bridge_epochs", "<i8"),  # the longest gap that is bridged
        ("turn_rate_dps", "<f8"),
        ("axis_acceleration_dps2", "<f8"),
        ("axis_rise_s", "<f8"),  # that an axis takes to reach that acceleration
        ("position_count", "<i8"),
        ("position_axis", "<i8", (SCHEME_CAPACITY,)),
        ("position_turn_deg", "<f8", (SCHEME_CAPACITY,)),
        ("position_epochs", "<i8", (SCHEME_CAPACITY,)),  # turning and standing
        ("angle_span_deg", "<f8"),  # after which an encoder's count begins anew
        ("follow_tolerance_deg", "<f8"),
        ("axis_silence_epochs", "<i8"),
        ("gyro_consistency", "<f8"),  # rad in an epoch
        ("accelerometer_consistency", "<f8"),  # m/s in an epoch
    ]
)
"""What the firmware is set up with; a step only reads it."""

CLOCK = _record(
    [
        ("synchronised", "?"),
        ("sync_seen", "?"),  # in this epoch
        ("sync_lost", "?"),
        ("sync_missed", "<i8"),  # epochs since the last SYNC
        ("sync_arrival_ns", "<i8"),  # own clock, filled in by the shell before a step
        ("next_sync_ns", "<i8"),  # own clock, when the SYNC after this step is expected
        ("period_q16", "<i8"),  # period in own clock, ns * 2**16
        ("fraction_q16", "<i8"),
        ("outliers", "<i8"),  # SYNCs in a row that came when none was expected
        ("jumps", "<i8"),
    ]
)
"""The loop's own clock, disciplined by SYNC."""

ASSEMBLY = _record(
    [
        ("gyro_dtheta", "<f8", (SENSOR_GROUPS,)),
        ("accelerometer_dv", "<f8", (SENSOR_GROUPS,)),
        ("received", "<u4"),  # bit per sensor group
        ("gyro_valid", "<u4"),
        ("accelerometer_valid", "<u4"),
        ("axis_received", "u1", (2,)),
        ("encoder_angle_deg", "<f8", (2,)),
        ("encoder_rate_dps", "<f8", (2,)),
        ("axis_state", "<i8", (2,)),
        ("axis_silent_epochs", "<i8", (2,)),
        ("altimeter_received", "?"),
        ("altimeter_height", "<f8"),  # m
    ]
)
"""What the frames of one epoch brought."""

FUSION = _record(
    [
        ("count", "<i8"),
        ("calibrated", "?"),
        ("bias_increment", "<f8", (SENSOR_GROUPS,)),  # b dt
        ("scale_error", "<f8", (SENSOR_GROUPS,)),  # λ
        ("asymmetric_scale_error", "<f8", (SENSOR_GROUPS,)),  # μ
        ("H", "<f8", (SENSOR_GROUPS, 3)),  # rows h', as calibrated
        ("weight", "<f8", (SENSOR_GROUPS,)),
        ("used", "<u4"),  # sensors that `gain` is for, a bit each
        ("solvable", "?"),
        ("gain", "<f8", (3, SENSOR_GROUPS)),
    ]
)
"""Calibration of the sensors of one kind, and weighted least squares over them."""

ALIGNMENT = _record(
    [
        ("epochs", "<i8"),
        ("done", "?"),
        ("failed", "?"),
        ("dtheta_s", "<f8", (3,)),
        ("dv_s", "<f8", (3,)),
        ("angle_sum", "<f8", (3,)),  # Σ over epochs of the angle so far
        ("angle_moment", "<f8", (3,)),  # Σ of epoch number times the angle so far
        ("C_s_n", "<f8", (3, 3)),
    ]
)
"""Initial attitude; increments and angles summed since the alignment began."""

INS = _record(
    [
        ("first", "?"),
        ("latitude", "<f8"),
        ("longitude", "<f8"),
        ("latitude_carry", "<f8"),  # what adding to the position lost by rounding
        ("longitude_carry", "<f8"),
        ("height", "<f8"),
        ("reference_height", "<f8"),
        ("reference_interval", "<f8"),  # s since the reference before; 0: none in this epoch
        ("height_error_integral", "<f8"),
        ("velocity_n", "<f8", (3,)),
        ("velocity_change_n", "<f8", (3,)),
        ("q_s_n", "<f8", (4,)),
        ("C_s_n", "<f8", (3, 3)),
        ("dtheta_s_previous", "<f8", (3,)),
        ("dv_s_previous", "<f8", (3,)),
        ("work", "<f8", (9, 3)),
        ("work_q", "<f8", (2, 4)),
    ]
)
"""The strapdown navigation."""

SEQUENCER = _record(
    [
        ("running", "?"),
        ("homing", "?"),  # turning both axes to zero, before the first position
        ("position", "<i8"),  # from 0
        ("cycle", "<i8"),
        ("epochs", "<i8"),  # in this position
        ("start_angle_deg", "<f8", (2,)),
        ("target_angle_deg", "<f8", (2,)),
        ("command", "<i8", (2,)),
        ("not_following", "u1", (2,)),
    ]
)
"""The rotation scheme's progress and what the axes are told."""

MODES = _record(
    [
        ("mode", "<i8"),
        ("fault", "<i8"),
        ("request", "<i8"),  # the last one acted on
        ("requested", "<i8"),  # the one received last, from whomever
        ("heard", "<i8"),  # the one that MODE_COMMAND repeats
        ("pending", "<i8"),  # mode that was asked for and not reached yet
        ("epochs", "<i8"),  # in this mode
        ("good_epochs", "<i8"),  # self-test
    ]
)

FAULTS = _record(
    [
        ("crc_errors", "<i8"),
        ("counter_errors", "<i8"),
        ("missing_frames", "<i8"),
        ("bridged_epochs", "<i8"),
        ("consecutive_bridged", "<i8"),
        ("overruns", "<i8"),  # counted by the shell
    ]
)
"""Fault counters since power-on."""

NAVIGATION = np.dtype(
    (
        np.record,
        [
            ("epoch", "<i8"),
            ("mode", "<i8"),
            ("latitude", "<f8"),  # rad
            ("longitude", "<f8"),
            ("height", "<f8"),  # m
            ("velocity_n", "<f8", (3,)),  # m/s
            ("roll", "<f8"),  # rad
            ("pitch", "<f8"),
            ("heading", "<f8"),
        ],
    )
)
"""Navigation output of one epoch."""

RAM = _record(
    [
        ("parameters", PARAMETERS),
        ("dispatch", "<i2", (2048,)),  # identifier -> what the frame is, see firmware_py.intake
        ("epoch", "<i8"),
        ("steps", "<i8"),
        ("altimeter_epochs", "<i8"),  # since the altimeter was last heard
        ("consumed", "<i8"),  # frames of the inbox that the last step took
        ("load_percent", "<f8"),  # filled in by the shell
        ("clock", CLOCK),
        ("assembly", ASSEMBLY),
        ("gyros", FUSION),
        ("accelerometers", FUSION),
        ("dtheta_s", "<f8", (3,)),
        ("dv_s", "<f8", (3,)),
        ("alignment", ALIGNMENT),
        ("ins", INS),
        ("C_s_b", "<f8", (3, 3)),
        ("C_b_n", "<f8", (3, 3)),
        ("navigation", NAVIGATION),
        ("sequencer", SEQUENCER),
        ("modes", MODES),
        ("faults", FAULTS),
        ("mode_command_counter", "<i8"),
        ("transmissions", "<i8"),  # of the status messages, for their counters
        ("navigation_transmissions", "<i8"),
        ("heartbeats", "<i8"),
        ("diagnostics", DIAGNOSTICS),
    ]
)
"""The firmware's whole memory."""


def blank_ram() -> NDArray[Any]:
    """Return an array of one zeroed `RAM` record."""
    return np.zeros(1, dtype=RAM)
