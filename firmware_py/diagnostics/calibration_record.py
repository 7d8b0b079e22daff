"""The record of a calibration on the table: one row of numbers for each second.

Rows of little-endian `f64`, at `RECORD_ADDRESS` of ReadMemoryByAddress, by `fields`.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from rrins.firmware_py.core.records.memory import INNER, OUTER, Ram
from rrins.firmware_py.core.turntable.table_sums import ORIENTATIONS, TURNS, TableSums

RECORD_ADDRESS = 0x2000_0000
"""Where ReadMemoryByAddress reads the record."""

AT_REST = 2.0
"""s at rest before the first second is recorded."""


class CalibrationEnd(IntEnum):
    """Why a calibration on the table has ended."""

    NONE = 0
    DONE = 1
    STOPPED = 2
    MODE_LEFT = 3
    AXIS_NOT_FOLLOWING = 4
    AXIS_TAKEN = 5
    GYRO_FAILED = 6
    ACCELEROMETER_FAILED = 7
    BASE_MOVED = 8
    SESSION_ENDED = 9


HEAD = (
    "epoch",
    "epochs",
    "position",
    "gyro_missing",
    "accelerometer_missing",
    "axis_missing",
    "inner_deg",
    "outer_deg",
)
"""First numbers of a row. The angles are the encoders' at the end; missing: one bit per sensor."""


def fields(gyros: int, accelerometers: int) -> list[tuple[str, int]]:
    """Return names and counts of the numbers of a row, in order, for numbers of sensors."""
    return [
        *((name, 1) for name in HEAD),
        ("orientation", ORIENTATIONS),
        ("turn", TURNS),
        ("gyro", gyros),
        ("accelerometer", accelerometers),
    ]


def record_of(state: Ram, sums: TableSums, position: int) -> bytes:
    """Return the row of a second."""
    head = (
        state.epoch,
        sums.epochs,
        position,
        sums.gyro_missing,
        sums.accelerometer_missing,
        sums.axis_missing,
        state.assembly.encoder_angle_deg[INNER],
        state.assembly.encoder_angle_deg[OUTER],
    )
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    row = np.concatenate(
        [
            np.array(head, dtype=float),
            sums.orientation,
            sums.turn,
            sums.gyro[:gyros],
            sums.accelerometer[:accelerometers],
        ]
    )
    return row.astype("<f8").tobytes()
