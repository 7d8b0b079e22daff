"""The hardware's whole state, as one record of fixed size."""

from __future__ import annotations

from typing import Any

import numpy as np

from dbc.contract import SENSOR_GROUPS

INNER, OUTER = 0, 1
"""Index of an axis wherever an array is over the two axes."""

FLICKER_POLES = 6
"""Gauss-Markov processes that make up a sensor's bias instability."""

LATENCY_CAPACITY = 32
"""The most epochs by which a sensor's output can lag."""

FAULT_CAPACITY = 32
"""The most faults of the hardware that can be present or planned at a time."""

MOTION_CHANNELS, MOTION_TERMS = 15, 8
"""Channels and polynomial terms of a piece of motion, see `host_tools.hardware.motion`."""


def _record(fields: list[Any]) -> np.dtype[Any]:
    return np.dtype((np.record, fields))


SENSORS = _record(
    [
        ("count", "<i8"),
        ("axis", "<f8", (SENSOR_GROUPS, 3)),  # true input axes, installation errors included
        ("scale_error", "<f8", (SENSOR_GROUPS,)),  # λ, what temperature adds included
        ("asymmetric_scale_error", "<f8", (SENSOR_GROUPS,)),  # μ
        ("bias_increment", "<f8", (SENSOR_GROUPS,)),  # b dt, all that drifts included
        ("noise_increment", "<f8", (SENSOR_GROUPS,)),  # standard deviation per epoch
        ("force_coefficient", "<f8", (SENSOR_GROUPS,)),  # rad/s per m/s² along the input axis
        ("range_increment", "<f8"),  # range × dt
        ("dead_increment", "<f8", (SENSOR_GROUPS,)),  # dead zone × dt
        ("resolution_increment", "<f8"),  # of the sensor itself; 0: finer than the frame's
        ("resolution_remainder", "<f8", (SENSOR_GROUPS,)),
        # Bandwidth and latency
        ("lags", "?"),
        ("lag_share", "<f8"),  # of its state that the first-order low pass keeps over an epoch
        ("lag_mean", "<f8"),  # the same on average over the epoch
        ("lag_state", "<f8", (SENSOR_GROUPS,)),
        ("latency_epochs", "<i8"),
        ("latency_fraction", "<f8"),  # of an epoch, on top
        ("history", "<f8", (SENSOR_GROUPS, LATENCY_CAPACITY)),
        ("history_at", "<i8"),
        # What drifts, brought up to date every `drift_epochs` of the plant
        ("drifts", "?"),
        ("constant_bias_increment", "<f8", (SENSOR_GROUPS,)),
        ("constant_scale_error", "<f8", (SENSOR_GROUPS,)),
        ("temperature_bias_increment", "<f8", (SENSOR_GROUPS,)),  # per K
        ("temperature_scale", "<f8", (SENSOR_GROUPS,)),  # per K
        ("flicker_decay", "<f8", (FLICKER_POLES,)),
        ("flicker_drive", "<f8", (SENSOR_GROUPS, FLICKER_POLES)),
        ("flicker_state", "<f8", (SENSOR_GROUPS, FLICKER_POLES)),
        ("walk_drive", "<f8", (SENSOR_GROUPS,)),
        ("walk_state", "<f8", (SENSOR_GROUPS,)),
        # Faults, a bit per sensor, and what they add
        ("stuck", "<u4"),
        ("absent", "<u4"),
        ("fault_bias_increment", "<f8", (SENSOR_GROUPS,)),
        ("fault_noise_increment", "<f8", (SENSOR_GROUPS,)),
        # Output
        ("remainder", "<f8", (SENSOR_GROUPS,)),  # counts carried into the next epoch
        ("counts", "<i8", (SENSOR_GROUPS,)),
        ("saturated", "<u4"),  # a bit per sensor, in this epoch
        ("noise_state", "<u8", (SENSOR_GROUPS,)),
        ("noise_spare", "<f8", (SENSOR_GROUPS,)),  # second normal of a pair
        ("noise_has_spare", "u1", (SENSOR_GROUPS,)),
    ]
)
"""The sensors of one kind; increments in rad or m/s."""

COMMAND = _record(
    [
        ("valid", "?"),
        ("command", "<i8"),
        ("target", "<f8"),  # rad
        ("rate", "<f8"),  # rad/s
    ]
)
"""An axis command that waits for its epoch."""

AXIS = _record(
    [
        ("rate_limit", "<f8"),  # rad/s
        ("acceleration_limit", "<f8"),  # rad/s²
        ("ramp_smoothing", "<i8"),  # epochs over which the acceleration rises; 0: at once
        ("encoder_step_deg", "<f8"),
        ("encoder_offset_deg", "<f8"),
        ("ripple", "<f8"),  # rad, of the angle
        ("ripple_per_turn", "<f8"),
        ("stiction", "<f8"),  # rad, by which the drive winds up before the table follows
        ("run_out", "<f8"),  # m, of the sensors' centre from the axis
        ("state", "<i8"),
        ("waiting", COMMAND, (2,)),  # by the epoch they belong to, even and odd
        ("command", "<i8"),
        ("target", "<f8"),  # rad, as commanded
        ("commanded_rate", "<f8"),  # rad/s
        ("drive_angle", "<f8"),  # rad, of the motor's shaft at the end of the epoch
        ("drive_rate", "<f8"),
        ("drive_acceleration", "<f8"),
        ("sticks", "?"),
        ("load_angle", "<f8"),  # of the table but for the ripple
        ("angle", "<f8"),  # rad, of the table at the end of the epoch
        ("rate", "<f8"),
        ("angle_before", "<f8"),  # at its beginning
        ("rate_before", "<f8"),
        # The profile being driven: ramp up, cruise, ramp down, in whole epochs.
        ("profile_start", "<f8"),
        ("profile_end", "<f8"),
        ("profile_rate", "<f8"),  # signed peak rate
        ("profile_ramp", "<i8"),
        ("profile_cruise", "<i8"),
        ("profile_epoch", "<i8"),
        # Braking: what is left of the acceleration fades, then the rate goes to zero.
        ("brake_acceleration", "<f8"),
        ("brake_rate", "<f8"),
        ("brake_epochs", "<i8"),
        ("brake_epoch", "<i8"),
        # Faults
        ("blocked", "?"),
        ("runaway", "?"),
        ("runaway_rate", "<f8"),
        ("encoder_stuck", "?"),
        ("encoder_held_deg", "<f8"),
        ("encoder_error_deg", "<f8"),
    ]
)
"""One axis of the turntable."""

COUNTERS = _record(
    [
        ("crc_errors", "<i8"),
        ("counter_errors", "<i8"),
        ("missing_commands", "<i8"),
        ("overruns", "<i8"),  # counted by the shell
    ]
)
"""What the hardware noticed of the frames that it gets."""

TRUTH = np.dtype(
    (
        np.record,
        [
            ("epoch", "<i8"),
            ("latitude", "<f8"),  # rad
            ("longitude", "<f8"),
            ("height", "<f8"),  # m
            ("velocity_n", "<f8", (3,)),
            ("roll", "<f8"),  # rad, of the body
            ("pitch", "<f8"),
            ("heading", "<f8"),
            ("axis_angle", "<f8", (2,)),  # rad
        ],
    )
)
"""Where the vehicle and the table really are at the end of an epoch."""

OPERATOR_CAPACITY = 32

OPERATOR = _record(
    [
        ("count", "<i8"),
        ("epoch", "<i8", (OPERATOR_CAPACITY,)),
        ("request", "<i8", (OPERATOR_CAPACITY,)),
        ("next", "<i8"),
        ("present", "<i8"),
        ("transmissions", "<i8"),
    ]
)
"""What the operator asks the navigation computer for, and when."""

TABLE = _record(
    [
        ("is_crooked", "?"),  # any of the following
        ("tilt", "<f8"),  # rad, of the inner axis from the right angle to the outer, about y
        ("wobble", "<f8"),  # rad, of the inner axis
        ("wobble_per_turn", "<f8"),
    ]
)
"""How the axes lie to each other."""

THERMAL = _record(
    [
        ("offset", "<f8"),  # K, of the surroundings from where the sensors are calibrated
        ("warm_up", "<f8"),  # K, by which the sensors end up warmer than that
        ("time_constant", "<f8"),  # s
    ]
)
"""The sensors' temperature over time since power-on."""

ALTIMETER = _record(
    [
        ("fitted", "?"),
        ("bias", "<f8"),  # m
        ("noise", "<f8"),  # m, standard deviation
        ("noise_state", "<u8", (1,)),
        ("noise_spare", "<f8", (1,)),
        ("noise_has_spare", "u1", (1,)),
    ]
)
"""The barometric altimeter."""

FAULTS = _record(
    [
        ("count", "<i8"),
        ("changes_at", "<i8"),  # the epoch from which on what is active must be seen anew
        ("kind", "<i8", (FAULT_CAPACITY,)),
        ("target", "<i8", (FAULT_CAPACITY,)),
        ("first_epoch", "<i8", (FAULT_CAPACITY,)),
        ("last_epoch", "<i8", (FAULT_CAPACITY,)),
        ("value", "<f8", (FAULT_CAPACITY,)),
    ]
)
"""Faults of the hardware, see `host_tools.hardware.faults`."""

PLANT = _record(
    [
        ("period_ns", "<i8"),
        ("epoch", "<i8"),  # the next one
        ("drift_epochs", "<i8"),
        ("motion_start", "<i8"),  # epoch in which the motion begins
        ("piece_count", "<i8"),  # 0: the vehicle rests
        ("piece_epochs", "<i8"),  # epochs of a piece of motion
        ("loop_from", "<i8"),  # piece to go on with after the last; below 0: rest
        ("omega_ib_b", "<f8", (3,)),
        ("specific_force_b", "<f8", (3,)),
        ("dtheta_s", "<f8", (3,)),
        ("dv_s", "<f8", (3,)),
        ("held", "?"),  # the increments are those of rest, made before
        ("table", TABLE),
        ("thermal", THERMAL),
        ("altimeter", ALTIMETER),
        ("faults", FAULTS),
        ("axis", AXIS, (2,)),
        ("gyros", SENSORS),
        ("accelerometers", SENSORS),
        ("truth", TRUTH),
        ("operator", OPERATOR),
        ("counters", COUNTERS),
        ("heartbeats", "<i8"),
    ]
)
"""The hardware's whole memory."""
