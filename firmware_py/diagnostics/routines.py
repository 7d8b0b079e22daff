"""The table of routines."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

from dbc.contract import SENSOR_GROUPS
from dbc.values import AxisState
from firmware_py.diagnostics.access import UNLOCKED, Access
from firmware_py.diagnostics.codecs import Field, Layout
from firmware_py.modes import Fault, Mode


class RoutineState(IntEnum):
    """How far a routine is: the first byte of every routine's results."""

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
    """A routine of RoutineControl (0x31).

    Attributes
    ----------
    number : int
    name : str
    text : str
    arguments : tuple of Field
        Of startRoutine.
    results : tuple of Field
        In the responses to all three sub-functions, after the routine's number.
    can_stop : bool
        Whether stopRoutine is supported.
    access : Access
    """

    number: int
    name: str
    text: str
    arguments: tuple[Field, ...]
    results: tuple[Field, ...]
    can_stop: bool
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
    Routine(
        0x0201,
        "self_test",
        "The self-test: SYNC, all sensors and both axes sound for half a second, within ten. In "
        "STANDBY and FAULT. Ends in STANDBY or FAULT.",
        (),
        (
            _STATE,
            Field("fault", "u8", choices=Fault, source="modes.fault"),
            Field("gyro_valid", "u32", source="assembly.gyro_valid"),
            Field("accelerometer_valid", "u32", source="assembly.accelerometer_valid"),
        ),
        can_stop=False,
    ),
    Routine(
        0x0202,
        "alignment",
        "Aligns anew. In STANDBY, the vehicle standing. Stopped, or failed, it goes to STANDBY or "
        "FAULT.",
        (),
        (
            _STATE,
            Field("epochs", "u32", "epochs", source="alignment.epochs"),
            Field("wanted_epochs", "u32", "epochs", source="parameters.alignment_epochs"),
        ),
        can_stop=True,
    ),
    Routine(
        0x0203,
        "go_to_axis_angle",
        "Turns an axis to an angle. In STANDBY, FAULT and NAVIGATION_STRAPDOWN. Done when it holds "
        "there; failed when it has not come in twice the time that the turn takes, plus 10 s. "
        "Stopped, it holds.",
        (
            Field("axis", "u8", choices=AxisName),
            Field("angle_deg", "f64", "°", minimum=-3600.0, maximum=3600.0),
        ),
        (
            _STATE,
            Field("axis", "u8", choices=AxisName),
            Field("encoder_angle_deg", "f64", "°"),
            Field("axis_state", "u8", choices=AxisState),
        ),
        can_stop=True,
    ),
    Routine(
        0x0204,
        "rotation",
        "Starts the rotation scheme, in NAVIGATION_STRAPDOWN, and stops it, in "
        "NAVIGATION_ROTATING.",
        (),
        (
            _STATE,
            Field("mode", "u8", choices=Mode, source="modes.mode"),
            Field("position", "u16", source="sequencer.position", text="from 0"),
            Field("cycle", "u32", source="sequencer.cycle"),
        ),
        can_stop=True,
    ),
    Routine(
        0x0205,
        "calibration",
        "Finds the bias of every sensor from a standing record, with the position and attitude of "
        "the parameters `start_position` and `initial_attitude`. In STANDBY, both axes at rest. "
        "Fails when the mode is left, an axis moves, or a sensor is missing in a tenth of the "
        "epochs. With `store`, the biases go into the parameter memory when it is done; fails when "
        "one is beyond its limits.",
        (
            Field("duration_s", "u16", "s", minimum=1, maximum=3600),
            Field("store", "u8", minimum=0, maximum=1, text="1: keep the biases"),
        ),
        (
            _STATE,
            Field("epochs", "u32", "epochs", text="recorded so far"),
            Field("gyro_bias_dph", "f32", "°/h", SENSOR_GROUPS),
            Field("accelerometer_bias_ug", "f32", "µg", SENSOR_GROUPS),
            Field("gyro_bias_sigma_dph", "f32", "°/h", SENSOR_GROUPS, text="standard error"),
            Field("accelerometer_bias_sigma_ug", "f32", "µg", SENSOR_GROUPS, text="standard error"),
            Field("stored", "u8"),
        ),
        can_stop=True,
    ),
    Routine(
        0x0207,
        "standby",
        "Ends navigation or alignment: to STANDBY, which the operator's next request leaves. Not "
        "in SELF_TEST and FAULT.",
        (),
        (_STATE, Field("mode", "u8", choices=Mode, source="modes.mode")),
        can_stop=False,
    ),
    Routine(
        0x0206,
        "restore_set_up",
        "Empties the parameter memory: the values of the set-up are in force from the next reset "
        "on.",
        (),
        (_STATE,),
        can_stop=False,
    ),
)
"""The routines."""
