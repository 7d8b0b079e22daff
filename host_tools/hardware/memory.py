"""The hardware's whole state, as one record of fixed size."""

from __future__ import annotations

from typing import Any

import numpy as np

from dbc.contract import SENSOR_GROUPS

INNER, OUTER = 0, 1
"""Index of an axis wherever an array is over the two axes."""


def _record(fields: list[Any]) -> np.dtype[Any]:
    return np.dtype((np.record, fields))


SENSORS = _record(
    [
        ("count", "<i8"),
        ("axis", "<f8", (SENSOR_GROUPS, 3)),  # true input axes, installation errors included
        ("scale_error", "<f8", (SENSOR_GROUPS,)),  # λ
        ("asymmetric_scale_error", "<f8", (SENSOR_GROUPS,)),  # μ
        ("bias_increment", "<f8", (SENSOR_GROUPS,)),  # b dt
        ("noise_increment", "<f8", (SENSOR_GROUPS,)),  # standard deviation per epoch
        ("range_increment", "<f8"),  # range × dt
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
        ("encoder_step_deg", "<f8"),
        ("state", "<i8"),
        ("waiting", COMMAND, (2,)),  # by the epoch they belong to, even and odd
        ("command", "<i8"),
        ("target", "<f8"),  # rad, as commanded
        ("commanded_rate", "<f8"),  # rad/s
        ("angle", "<f8"),  # rad, at the end of the epoch
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
        ("brake_step", "<f8"),  # change of rate per epoch when braking
        ("blocked", "?"),
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

PLANT = _record(
    [
        ("period_ns", "<i8"),
        ("epoch", "<i8"),  # the next one
        ("omega_ib_b", "<f8", (3,)),
        ("specific_force_b", "<f8", (3,)),
        ("dtheta_s", "<f8", (3,)),
        ("dv_s", "<f8", (3,)),
        ("held", "?"),  # the increments are those of axes at rest, made before
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
