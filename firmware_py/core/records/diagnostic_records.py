"""Records of the diagnostics in the RAM image."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.record import F8, I8, Bool, Bytes, Floats, Integers, Record, Records
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.redundancy_records import ParityBefore
from rrins.firmware_py.core.records.trouble_table import PARITY_KIND, TROUBLES
from rrins.firmware_py.core.records.troubles import Kind


class RoutineRequest(IntEnum):
    """Requests of routines to the mode logic; handled in the next step."""

    NONE = 0
    STANDBY = 1
    SELF_TEST = 2
    ALIGN = 3
    START_ROTATION = 4
    STOP_ROTATION = 5


ATTENTION_FRAMES, ATTENTION_TROUBLES, ATTENTION_XCP = 1, 2, 4
"""Bits of `attention`: diagnostic frames arrived; a test has newly failed; XCP frames arrived."""


class SnapshotModes(Record):
    """Of a freeze frame."""

    mode: I8
    fault: I8


class SnapshotAssembly(Record):
    """Of a freeze frame."""

    encoder_angle_deg: Annotated[Floats, 2]


class SnapshotNavigation(Record):
    """Of a freeze frame."""

    latitude: F8
    longitude: F8
    height: F8
    velocity_n: Annotated[Floats, 3]
    roll: F8
    pitch: F8
    heading: F8


class Snapshot(Record):
    """Freeze frame of a trouble code: fields of the RAM image by the same names."""

    epoch: I8
    modes: SnapshotModes
    assembly: SnapshotAssembly
    navigation: SnapshotNavigation


class TroubleMemory(Record):
    """The data of trouble codes stored across power-off, in the order of the table."""

    status: Annotated[Bytes, len(TROUBLES)]
    occurrences: Annotated[Integers, len(TROUBLES)]
    aging: Annotated[Integers, len(TROUBLES)]  #: operation cycles without the fault
    snapshots: Annotated[Records[Snapshot], (len(TROUBLES), 2)]  #: first and latest occurrence
    parities: Annotated[Records[ParityBefore], (len(PARITY_KIND), 2)]  #: of those that have one


class Repetition(Record):
    """State of the test whether sensors of one kind repeat themselves; see `stuck`."""

    resolution: F8  #: of the frames or the sensors, the coarser; rad or m/s
    enough: Annotated[Integers, SENSOR_GROUPS]  #: equal epochs that noise does not allow; 0: any
    promised: Annotated[Floats, SENSOR_GROUPS]  #: mean change by that noise at least, rad or m/s
    changes: Annotated[Floats, SENSOR_GROUPS]  #: mean of those that are not zero, rad or m/s
    largest_change: F8  #: from the previous epoch to this
    last: Annotated[Floats, SENSOR_GROUPS]
    unchanged: Annotated[Integers, SENSOR_GROUPS]  #: epochs
    repeats: Bool  #: whether any usable sensor has not changed in this epoch
    expected: Annotated[Floats, SENSOR_GROUPS]  #: by the others, once it had been constant
    varied: I8  #: the others' expectation has changed since
    compared: I8  #: the usable sensors
    lacking: I8  #: epochs in a row that lack one of these
    reference: Annotated[Floats, (SENSOR_GROUPS, SENSOR_GROUPS)]  #: all increments at that time
    stuck: I8  #: the result, one bit each


class DiagnosticState(Record):
    """The monitor's state."""

    attention: I8  #: work due between two steps
    # Of the current epoch, one bit per source or sensor group.
    crc_wrong: I8
    counter_wrong: I8
    stale: I8
    command_seen: Bool
    gyro_absent: I8
    gyro_saturated: I8
    accelerometer_absent: I8
    accelerometer_saturated: I8
    # Controlled from outside.
    routine_request: I8  #: a `RoutineRequest` for the next step
    excluded_gyros: I8
    excluded_accelerometers: I8
    held: Bool  #: trouble codes are not set
    # Filled in by the shell.
    memory_faults: I8  #: bits of SystemFault
    frames_capacity: F8  #: frames of an epoch that fill the bus
    frames_share: F8  #: of an epoch in the mean of frames
    patience_epochs: I8  #: timeout of a frame that is not sent in every epoch
    stuck_epochs: I8  #: an even number
    clock_tolerance_q16: I8  #: ns * 2**16
    residual_share: F8  #: of an epoch in the mean residuals
    # Tracked by the monitor.
    bus_state: I8
    bus_state_worst: I8  #: in this epoch
    frames_mean: F8
    command_silence: I8  #: epochs
    altimeter_silence: I8
    overruns_before: I8
    jumps_before: I8
    gyro_repetition: Repetition
    accelerometer_repetition: Repetition
    gyro_residual: Annotated[Floats, SENSOR_GROUPS]  #: rad in an epoch, a mean
    gyro_apart: I8  #: usable, but left out of the fusion
    accelerometer_residual: Annotated[Floats, SENSOR_GROUPS]  #: m/s in an epoch, a mean
    accelerometer_apart: I8
    # One word per kind of fault, one bit per trouble code.
    failing: Annotated[Integers, len(Kind)]  #: in this epoch
    tested: Annotated[Integers, len(Kind)]  #: in this epoch
    unsettled: Annotated[Integers, len(Kind)]  #: fault detection counter above -128
    # By trouble code, in the order of the table.
    counter: Annotated[Integers, len(TROUBLES)]  #: fault detection counter * 2**16
    up: Annotated[Integers, len(TROUBLES)]  #: its change in an epoch with the fault
    down: Annotated[Integers, len(TROUBLES)]  #: in one without it
    troubles: TroubleMemory
