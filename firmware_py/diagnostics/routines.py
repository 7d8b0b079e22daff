"""The table of routines."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.dbc.values import AxisState
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.records.memory import SCHEME_CAPACITY
from rrins.firmware_py.core.records.redundancy_records import (
    TEST_LEAST_S,
    TEST_LONGEST_S,
    SensorKind,
)
from rrins.firmware_py.diagnostics.access import UNLOCKED, Access
from rrins.firmware_py.diagnostics.calibration_record import CalibrationEnd
from rrins.firmware_py.diagnostics.codecs import Field, Layout
from rrins.firmware_py.diagnostics.redundancy_identifiers import READMISSION


class RoutineState(IntEnum):
    """Progress of a routine: the first byte of every routine's results."""

    NEVER_STARTED = 0
    RUNNING = 1
    DONE = 2
    FAILED = 3
    STOPPED = 4


class AxisName(IntEnum):
    """Which axis."""

    INNER = 0
    OUTER = 1


@dataclass(frozen=True)
class Routine:
    """A routine of RoutineControl (0x31)."""

    number: int
    name: str
    text: str
    arguments: tuple[Field, ...]  #: of startRoutine
    #: in the responses to all three sub-functions, after the routine's number
    results: tuple[Field, ...]
    can_stop: bool  #: whether stopRoutine is supported
    access: Access = UNLOCKED

    @cached_property
    def argument_layout(self) -> Layout:
        """Encodes and decodes the arguments."""
        return Layout(self.arguments)

    @cached_property
    def result_layout(self) -> Layout:
        """Encodes and decodes the results."""
        return Layout(self.results)


_STATE = Field("state", "u8", choices=RoutineState)

ROUTINES = (
    Routine(0x0201, "self_test",
        "Repeats the self-test: SYNC, all sensors and both axes must be sound for half a second "
        "within ten seconds. In STANDBY and FAULT. Ends in STANDBY or FAULT.", (), (
        _STATE,
        Field("fault", "u8", choices=FirmwareFault, source="modes.fault"),
        Field("gyro_valid", "u32", source="assembly.gyro_valid"),
        Field("accelerometer_valid", "u32", source="assembly.accelerometer_valid"),
    ), can_stop=False),
    Routine(0x0202, "alignment",
        "Repeats the alignment. In STANDBY, with the vehicle at rest. If stopped, it goes to "
        "STANDBY; if it fails, to FAULT.", (), (
        _STATE,
        Field("epochs", "u32", "epochs", source="alignment.epochs"),
        Field("wanted_epochs", "u32", "epochs", source="parameters.alignment_epochs"),
    ), can_stop=True),
    Routine(0x0203, "go_to_axis_angle",
        "Turns an axis to an angle. In STANDBY, FAULT and NAVIGATION_STRAPDOWN. Done when the "
        "axis holds there; failed if it has not arrived within twice the time of the turn plus 10 "
        "s. If stopped, the axis holds.", (
        Field("axis", "u8", choices=AxisName),
        Field("angle_deg", "f64", "°", minimum=-3600.0, maximum=3600.0),
    ), (
        _STATE,
        Field("axis", "u8", choices=AxisName),
        Field("encoder_angle_deg", "f64", "°"),
        Field("axis_state", "u8", choices=AxisState),
    ), can_stop=True),
    Routine(0x0204, "rotation",
        "Starts the rotation scheme in NAVIGATION_STRAPDOWN, or stops it in NAVIGATION_ROTATING.",
        (), (
        _STATE,
        Field("mode", "u8", choices=Mode, source="modes.mode"),
        Field("position", "u16", source="sequencer.position", text="counted from 0"),
        Field("cycle", "u32", source="sequencer.cycle"),
    ), can_stop=True),
    Routine(0x0205, "calibration",
        "Estimates the bias of every sensor at standstill, using the position and attitude in the "
        "parameters `start_position` and `initial_attitude`. In STANDBY, with both axes at rest. "
        "Fails if the mode is left, an axis moves, or a sensor is missing in a tenth of the "
        "epochs. With `store`, the biases are written to the parameter memory at the end; fails "
        "if one is beyond its limits.", (
        Field("duration_s", "u16", "s", minimum=1, maximum=3600),
        Field("store", "u8", minimum=0, maximum=1, text="1: store the biases"),
    ), (
        _STATE,
        Field("epochs", "u32", "epochs", text="recorded so far"),
        Field("gyro_bias_dph", "f32", "°/h", SENSOR_GROUPS),
        Field("accelerometer_bias_ug", "f32", "µg", SENSOR_GROUPS),
        Field("gyro_bias_sigma_dph", "f32", "°/h", SENSOR_GROUPS, text="standard error"),
        Field("accelerometer_bias_sigma_ug", "f32", "µg", SENSOR_GROUPS, text="standard error"),
        Field("stored", "u8"),
    ), can_stop=True),
    Routine(0x0207, "standby",
        "Ends alignment or navigation and waits in standby for the operator's next request. In "
        "ALIGNMENT, NAVIGATION_STRAPDOWN and NAVIGATION_ROTATING.", (), (
        _STATE,
        Field("mode", "u8", choices=Mode, source="modes.mode"),
    ), can_stop=False),
    Routine(0x0208, "readmit_sensor",
        "Takes a sensor that was found to fail back into use, after a test: for `test_s` it is "
        "compared with the others, but not used. With `anew`, its constants are learned anew; "
        "else they must be as they were. In every mode, where redundant sensors are compared. "
        "Failed if `refusal` says why; stopped, the sensor stays left out.", (
        Field("kind", "u8", choices=SensorKind),
        Field("sensor", "u8", minimum=1, maximum=SENSOR_GROUPS, text="from 1"),
        Field("test_s", "u16", "s", minimum=TEST_LEAST_S, maximum=TEST_LONGEST_S),
        Field("anew", "u8", minimum=0, maximum=1, text="1: learn its constants anew"),
    ), (_STATE, *READMISSION), can_stop=True),
    Routine(0x0209, "table_calibration",
        "Turns the table through a scheme and records the sums of every second, which a tool "
        "reads from 0x20000000 while they grow. In STANDBY, with the vehicle at rest; both axes "
        "turn to where position `first` begins, first. Stores nothing. Fails if the mode is left, "
        "an axis does not follow or is commanded otherwise, a sensor fails, or the base moves. If "
        "stopped, and at the end, both axes hold.", (
        Field("positions", "u8", minimum=1, maximum=SCHEME_CAPACITY),
        Field("first", "u8", minimum=0, maximum=SCHEME_CAPACITY - 1, text="counted from 0"),
        Field("turn_rate_dps", "f64", "°/s", minimum=0.01, maximum=60.0),
        Field("stand_s", "f64", "s", minimum=0.0, maximum=3600.0, text="after each turn"),
        Field("axis", "u8", "", SCHEME_CAPACITY, choices=AxisName, text="by position"),
        Field("angle_deg", "f64", "°", SCHEME_CAPACITY, minimum=-720.0, maximum=720.0,
            text="by position"),
    ), (
        _STATE,
        Field("end", "u8", choices=CalibrationEnd),
        Field("sensor", "u8", text="that has failed, from 1"),
        Field("position", "u8", text="counted from 0"),
        Field("seconds", "u32", text="recorded so far"),
        Field("second_bytes", "u16", "bytes"),
        Field("period_ns", "u32", "ns", text="of an epoch"),
    ), can_stop=True),
    Routine(0x0206, "restore_set_up",
        "Empties the parameter memory: the set-up values take effect at the next reset.", (),
        (_STATE,), can_stop=False),
)  # fmt: skip
"""The routines."""
