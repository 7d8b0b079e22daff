"""What the step keeps for diagnostics in the RAM image."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from dbc.contract import SENSOR_GROUPS
from firmware_py.diagnostics.trouble_table import TROUBLES
from firmware_py.diagnostics.troubles import Kind


class Order(IntEnum):
    """What a routine asks the modes for; acted on in the next step."""

    NONE = 0
    STANDBY = 1
    SELF_TEST = 2
    ALIGN = 3
    START_ROTATION = 4
    STOP_ROTATION = 5


ATTENTION_FRAMES, ATTENTION_TROUBLES = 1, 2
"""Bits of `attention`: diagnostic frames came; a test has failed that had not."""


def _record(fields: list[Any]) -> np.dtype[Any]:
    return np.dtype((np.record, fields), align=False)


SNAPSHOT = _record(
    [
        ("epoch", "<i8"),
        ("modes", _record([("mode", "<i8"), ("fault", "<i8")])),
        ("assembly", _record([("encoder_angle_deg", "<f8", (2,))])),
        (
            "navigation",
            _record(
                [
                    ("latitude", "<f8"),
                    ("longitude", "<f8"),
                    ("height", "<f8"),
                    ("velocity_n", "<f8", (3,)),
                    ("roll", "<f8"),
                    ("pitch", "<f8"),
                    ("heading", "<f8"),
                ]
            ),
        ),
    ]
)
"""Freeze frame of a trouble code: fields of `firmware_py.memory.RAM` by the same names."""

TROUBLE_MEMORY = _record(
    [
        ("status", "u1", (len(TROUBLES),)),
        ("occurrences", "<i8", (len(TROUBLES),)),
        ("aging", "<i8", (len(TROUBLES),)),  # operation cycles without the fault
        ("snapshots", SNAPSHOT, (len(TROUBLES), 2)),  # of the first and the latest occurrence
    ]
)
"""What is remembered of trouble codes when the power is off, in the order of the table."""

DIAGNOSTICS = _record(
    [
        ("attention", "<i8"),  # what is to be done between two steps
        # Of the present epoch, a bit per source or sensor group.
        ("crc_wrong", "<i8"),
        ("counter_wrong", "<i8"),
        ("stale", "<i8"),
        ("command_seen", "?"),
        ("gyro_absent", "<i8"),
        ("gyro_saturated", "<i8"),
        ("accelerometer_absent", "<i8"),
        ("accelerometer_saturated", "<i8"),
        # Controlled from outside.
        ("order", "<i8"),  # an `Order` for the next step
        ("excluded_gyros", "<i8"),
        ("excluded_accelerometers", "<i8"),
        ("held", "?"),  # trouble codes are not set
        # Filled in by the shell.
        ("memory_faults", "<i8"),  # bits of SystemFault
        ("frames_capacity", "<f8"),  # frames of an epoch that fill the bus
        ("frames_share", "<f8"),  # of an epoch in the mean of frames
        ("patience_epochs", "<i8"),  # without a frame that is not sent in every epoch
        ("stuck_epochs", "<i8"),  # an even number
        ("clock_tolerance_q16", "<i8"),  # ns * 2**16
        ("gyro_resolution", "<f8"),  # rad
        ("accelerometer_resolution", "<f8"),  # m/s
        ("residual_share", "<f8"),  # of an epoch in the mean residuals
        # What the monitor follows.
        ("bus_state", "<i8"),
        ("bus_state_worst", "<i8"),  # in this epoch
        ("frames_mean", "<f8"),
        ("command_silence", "<i8"),  # epochs
        ("altimeter_silence", "<i8"),
        ("overruns_before", "<i8"),
        ("jumps_before", "<i8"),
        ("encoder_seen", "<i8"),  # a bit per axis
        ("encoder_before_deg", "<f8", (2,)),
        ("rate_before_dps", "<f8", (2,)),
        ("gyro_last", "<f8", (SENSOR_GROUPS,)),
        ("gyro_unchanged", "<i8", (SENSOR_GROUPS,)),  # epochs
        ("gyro_expected", "<f8", (SENSOR_GROUPS,)),  # by the others, when it had stood for a while
        ("gyro_varied", "<i8"),  # what the others expect has changed since
        ("gyro_compared", "<i8"),  # the sensors of which the last expectation was made
        ("accelerometer_last", "<f8", (SENSOR_GROUPS,)),
        ("accelerometer_unchanged", "<i8", (SENSOR_GROUPS,)),
        ("accelerometer_expected", "<f8", (SENSOR_GROUPS,)),
        ("accelerometer_varied", "<i8"),
        ("accelerometer_compared", "<i8"),
        ("gyro_residual", "<f8", (SENSOR_GROUPS,)),  # rad in an epoch, a mean
        ("gyro_apart", "<i8"),  # usable, but left out of the fusion
        ("accelerometer_residual", "<f8", (SENSOR_GROUPS,)),  # m/s in an epoch, a mean
        ("accelerometer_apart", "<i8"),
        # A word per kind of fault, a bit per trouble code.
        ("failing", "<i8", (len(Kind),)),  # in this epoch
        ("tested", "<i8", (len(Kind),)),  # in this epoch
        ("unsettled", "<i8", (len(Kind),)),  # fault detection counter above -128
        # By trouble code, in the order of the table.
        ("counter", "<i8", (len(TROUBLES),)),  # fault detection counter * 2**16
        ("up", "<i8", (len(TROUBLES),)),  # its change in an epoch with the fault
        ("down", "<i8", (len(TROUBLES),)),  # in one without it
        ("troubles", TROUBLE_MEMORY),
    ]
)
"""The monitor's state."""
