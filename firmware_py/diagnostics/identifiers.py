"""The table of readable data identifiers and controllable outputs."""

from __future__ import annotations

import math
from enum import IntEnum

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest
from rrins.firmware_py.core.records.encoder_records import AngleSource
from rrins.firmware_py.diagnostics.access import UNLOCKED, Session
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.estimator_identifiers import ESTIMATOR
from rrins.firmware_py.diagnostics.redundancy_identifiers import REDUNDANCY

_DEG = math.degrees(1.0)


class ControllerState(IntEnum):
    """State of the CAN controller, as far as the bus reports it."""

    ERROR_ACTIVE = 0
    ERROR_PASSIVE = 1
    BUS_OFF = 2


class MemoryState(IntEnum):
    """Source of the parameters in use."""

    SET_UP = 0
    MEMORY = 1
    OTHER_COPY = 2
    LOST = 3


class IOControl(IntEnum):
    """Control options of InputOutputControlByIdentifier (0x2F)."""

    RETURN_CONTROL = 0x00
    RESET_TO_DEFAULT = 0x01
    FREEZE_CURRENT_STATE = 0x02
    SHORT_TERM_ADJUSTMENT = 0x03


IDENTIFICATION = (
    DataIdentifier(0xF186, "active_session", "The diagnostic session.", (
        Field("session", "u8", choices=Session),
    )),
    DataIdentifier(0xF18A, "supplier", "Supplier of the system.", (
        Field("supplier", "ascii", count=16),
    )),
    DataIdentifier(0xF18C, "serial_number", "Serial number of the computer.", (
        Field("serial_number", "ascii", count=16),
    )),
    DataIdentifier(0xF191, "hardware_number", "Hardware number of the computer.", (
        Field("hardware_number", "ascii", count=16),
    )),
    DataIdentifier(0xF194, "software_number", "Name of the firmware.", (
        Field("software_number", "ascii", count=16),
    )),
    DataIdentifier(0xF195, "software_version", "Version of the firmware.", (
        Field("software_version", "ascii", count=16),
    )),
    DataIdentifier(0xF197, "system_name", "Name of the system.", (
        Field("system_name", "ascii", count=32),
    )),
    DataIdentifier(0x0100, "table_version",
        "CRC-32 of this table; a tool whose table has a different CRC does not match the firmware.",
        (Field("table_crc32", "u32"),)),
)  # fmt: skip
"""Identification. Numbers 0xF1xx are those of ISO 14229-1, table C.1."""

STATUS = (
    DataIdentifier(0x0101, "epoch", "Epoch counter.", (Field("epoch", "i64", source="epoch"),)),
    DataIdentifier(0x0102, "mode", "Mode of the computer.", (
        Field("mode", "u8", choices=Mode, source="modes.mode"),
        Field("fault", "u8", choices=FirmwareFault, source="modes.fault", text="reason for FAULT"),
    )),
    DataIdentifier(0x0103, "mode_request",
        "The operator's latest request, and the mode that is still pending.", (
        Field("requested", "u8", choices=ModeRequest, source="modes.requested"),
        Field("pending", "u8", choices=Mode, source="modes.pending"),
    )),
    DataIdentifier(0x0104, "load", "Load of the computer and the bus.", (
        Field("load_percent", "f32", "%", source="load_percent", text="of the period"),
        Field("overruns", "u32", source="faults.overruns"),
        Field("frames_per_epoch", "f32", source="diagnostics.frames_mean",
            text="received and sent, averaged over 0.25 s"),
        Field("bus_load_percent", "f32", "%", text="of the bit rate in the DBC"),
    )),
    DataIdentifier(0x0105, "clock", "The loop's clock and SYNC.", (
        Field("synchronised", "u8", source="clock.synchronised"),
        Field("sync_lost", "u8", source="clock.sync_lost"),
        Field("sync_missed", "u32", "epochs", source="clock.sync_missed"),
        Field("jumps", "u32", source="clock.jumps"),
        Field("error_ppm", "f32", "ppm", text="how much the computer's own clock runs fast"),
    )),
    DataIdentifier(0x0106, "uptime", "Time since power-on or reset.", (
        Field("steps", "u64", "epochs", source="steps"),
        Field("uptime_s", "f64", "s"),
    )),
    DataIdentifier(0x0107, "fault_counters", "Faults since power-on.", tuple(
        Field(name, "u32", source=f"faults.{name}")
        for name in ("crc_errors", "counter_errors", "disagreeing_frames", "missing_frames",
            "bridged_epochs", "consecutive_bridged", "overruns")
    )),
    DataIdentifier(0x0108, "bus_state", "State of the CAN controller.", (
        Field("bus_state", "u8", choices=ControllerState, source="diagnostics.bus_state"),
    )),
    DataIdentifier(0x0109, "parameter_memory",
        "State of the parameter memory at power-on or hard reset.", (
        Field("state", "u8", choices=MemoryState),
        Field("sequence", "u32", text="number of times it was written"),
        Field("parameters", "u16", text="number of stored parameters"),
    )),
    DataIdentifier(0x010B, "calibration_file", "The calibration file that RequestUpload returns.", (
        Field("length", "u32", "bytes"),
        Field("file_crc32", "u32", text="of the whole file"),
    )),
    DataIdentifier(0x010A, "operation_cycles",
        "Operation cycles since the trouble codes were first stored.", (
        Field("operation_cycles", "u32"),
    )),
)  # fmt: skip
"""State of the computer."""

SENSORS = (
    DataIdentifier(0x0201, "sensors",
        "Number of sensors, and those with a sound frame in the last epoch, one bit per sensor "
        "group.", (
        Field("gyros", "u8", source="gyros.count"),
        Field("accelerometers", "u8", source="accelerometers.count"),
        Field("received", "u32", source="assembly.received"),
        Field("gyro_valid", "u32", source="assembly.gyro_valid"),
        Field("accelerometer_valid", "u32", source="assembly.accelerometer_valid"),
    )),
    DataIdentifier(0x0202, "gyro_increments",
        "Increments of the last epoch along the gyros' input axes.", (
        Field("gyro_dtheta", "f64", "rad", SENSOR_GROUPS, source="assembly.gyro_dtheta"),
    )),
    DataIdentifier(0x0203, "accelerometer_increments",
        "Increments of the last epoch along the accelerometers' input axes.", (
        Field("accelerometer_dv", "f64", "m/s", SENSOR_GROUPS, source="assembly.accelerometer_dv"),
    )),
    DataIdentifier(0x0204, "fused_increments",
        "Increments of the last epoch in the sensor frame s.", (
        Field("dtheta_s", "f64", "rad", 3, source="dtheta_s"),
        Field("dv_s", "f64", "m/s", 3, source="dv_s"),
    )),
    DataIdentifier(0x0205, "gyro_residuals",
        "Measurement of each gyro minus the fused solution, averaged over 10 s. The residual of "
        "an excluded gyro is its full deviation from the others.", (
        Field("residual_dph", "f64", "°/h", SENSOR_GROUPS),
    )),
    DataIdentifier(0x0206, "accelerometer_residuals",
        "Measurement of each accelerometer minus the fused solution, averaged over 10 s.", (
        Field("residual_ug", "f64", "µg", SENSOR_GROUPS),
    )),
    DataIdentifier(0x0211, "excluded_sensors",
        "Sensors excluded from the fusion, one bit each. Control: the default is none.", (
        Field("gyros", "u16", source="diagnostics.excluded_gyros"),
        Field("accelerometers", "u16", source="diagnostics.excluded_accelerometers"),
    ), control=UNLOCKED),
)  # fmt: skip
"""Sensors."""


def _axis(number: int, name: str, index: int) -> DataIdentifier:
    return DataIdentifier(number, f"axis_{name}", f"State of the {name} axis.", (
        Field("encoder_angle_deg", "f64", "°", source=f"assembly.encoder_angle_deg.{index}"),
        Field("encoder_rate_dps", "f32", "°/s", source=f"assembly.encoder_rate_dps.{index}"),
        Field("state", "u8", choices=AxisState, source=f"assembly.axis_state.{index}"),
        Field("silent_epochs", "u32", "epochs", source=f"assembly.axis_silent_epochs.{index}"),
        Field("command", "u8", choices=AxisCommand, source=f"sequencer.command.{index}"),
        Field("target_angle_deg", "f64", "°", source=f"sequencer.target_angle_deg.{index}"),
        Field("not_following", "u8", source=f"sequencer.not_following.{index}"),
        Field("angle_source", "u8", choices=AngleSource, source=f"encoders.source.{index}"),
        Field("encoder_offset_deg", "f64", "°", source=f"encoders.offset_deg.{index}"),
    ))  # fmt: skip


def _axis_control(number: int, name: str, index: int) -> DataIdentifier:
    return DataIdentifier(number, f"axis_{name}_control",
        f"Target angle of the {name} axis. Control in STANDBY, FAULT and NAVIGATION_STRAPDOWN: "
        "the default is zero; frozen, the axis holds its angle.", (
        Field("target_angle_deg", "f64", "°", minimum=-3600.0, maximum=3600.0,
            source=f"sequencer.target_angle_deg.{index}"),
    ), control=UNLOCKED)  # fmt: skip


AXES = (
    _axis(0x0301, "inner", 0),
    _axis(0x0302, "outer", 1),
    DataIdentifier(0x0303, "axis_angles", "Angles of both axes.", (
        Field("inner_deg", "f64", "°", source="assembly.encoder_angle_deg.0"),
        Field("outer_deg", "f64", "°", source="assembly.encoder_angle_deg.1"),
    )),
    DataIdentifier(0x0304, "scheme", "Progress of the rotation scheme.", (
        Field("running", "u8", source="sequencer.running"),
        Field("homing", "u8", source="sequencer.homing", text="turning to zero first"),
        Field("position", "u16", source="sequencer.position", text="counted from 0"),
        Field("cycle", "u32", source="sequencer.cycle"),
        Field("epochs", "u32", "epochs", source="sequencer.epochs", text="in this position"),
    )),
    _axis_control(0x0311, "inner", 0),
    _axis_control(0x0312, "outer", 1),
)  # fmt: skip
"""The turntable."""

NAVIGATION = (
    DataIdentifier(0x0401, "position", "Position, WGS-84.", (
        Field("latitude_deg", "f64", "°", source="navigation.latitude", factor=_DEG),
        Field("longitude_deg", "f64", "°", source="navigation.longitude", factor=_DEG),
        Field("height_m", "f64", "m", source="navigation.height"),
    )),
    DataIdentifier(0x0402, "velocity", "Velocity over ground.", tuple(
        Field(f"{name}_mps", "f64", "m/s", source=f"navigation.velocity_n.{k}")
        for k, name in enumerate(("east", "north", "up"))
    )),
    DataIdentifier(0x0403, "attitude", "Attitude of the body.", tuple(
        Field(f"{name}_deg", "f64", "°", source=f"navigation.{name}", factor=_DEG)
        for name in ("roll", "pitch", "heading")
    )),
    DataIdentifier(0x0404, "alignment_progress", "Progress of the alignment.", (
        Field("epochs", "u32", "epochs", source="alignment.epochs"),
        Field("wanted_epochs", "u32", "epochs", source="parameters.alignment_epochs"),
        Field("done", "u8", source="alignment.done"),
        Field("failed", "u8", source="alignment.failed"),
    )),
    DataIdentifier(0x0405, "altimeter", "The altimeter, if fitted.", (
        Field("fitted", "u8", source="parameters.altimeter"),
        Field("height_m", "f64", "m", source="assembly.altimeter_height", text="latest"),
        Field("silent_epochs", "u32", "epochs", source="diagnostics.altimeter_silence"),
    )),
    DataIdentifier(0x0406, "gnss", "The GNSS receiver, if fitted, and its latest fix.", (
        Field("interval_epochs", "u32", "epochs", source="gnss.interval_epochs", text="0: none"),
        Field("available", "u8", source="gnss.available", text="whether fixes come"),
        Field("fixes", "u32", source="gnss.fixes"),
        Field("losses", "u32", source="gnss.losses", text="how often they stopped"),
        Field("too_old", "u32", source="gnss.too_old", text="not used"),
        Field("age_epochs", "u32", "epochs", source="gnss.age_epochs"),
        Field("silent_epochs", "u32", "epochs", source="gnss.silent_epochs"),
        Field("latitude_deg", "f64", "°", source="gnss.latitude", factor=_DEG),
        Field("longitude_deg", "f64", "°", source="gnss.longitude", factor=_DEG),
        Field("height_m", "f64", "m", source="gnss.height"),
        *(Field(f"velocity_{name}_mps", "f64", "m/s", source=f"gnss.velocity_n.{k}")
            for k, name in enumerate(("east", "north", "up"))),
    )),
    DataIdentifier(0x0407, "odometer", "The odometer, if fitted.", (
        Field("interval_epochs", "u32", "epochs", source="odometer.interval_epochs",
            text="0: none"),
        Field("available", "u8", source="odometer.available", text="whether distances come"),
        Field("valid", "u8", source="odometer.valid", text="as last received"),
        Field("measurements", "u32", source="odometer.measurements"),
        Field("losses", "u32", source="odometer.losses", text="how often they stopped"),
        Field("gaps", "u32", source="odometer.gaps", text="in the distance travelled"),
        Field("implausible", "u32", source="odometer.implausible", text="not used"),
        Field("age_epochs", "u32", "epochs", source="odometer.age_epochs"),
        Field("silent_epochs", "u32", "epochs", source="odometer.silent_epochs"),
        Field("pulses", "u32", source="odometer.pulses"),
        Field("distance_m", "f64", "m", source="odometer.distance", text="latest"),
        Field("travelled_m", "f64", "m", source="odometer.travelled"),
    )),
    DataIdentifier(0x0408, "zero_velocity", "What the operator says of the vehicle's standing.", (
        Field("standing", "u8", source="zero_velocity.standing"),
        Field("velocity_sigma_mps", "f64", "m/s", source="zero_velocity.velocity_sigma"),
        Field("epochs", "u32", "epochs", source="zero_velocity.epochs", text="so far"),
        Field("silent_epochs", "u32", "epochs", source="zero_velocity.silent_epochs"),
    )),
    DataIdentifier(0x0409, "master",
        "The master unit of a transferred start, and its latest transfer.", (
        Field("valid", "u8", source="master.valid", text="as last received"),
        Field("transfers", "u32", source="master.transfers"),
        Field("too_old", "u32", source="master.too_old", text="not used"),
        Field("age_epochs", "u32", "epochs", source="master.age_epochs"),
        Field("silent_epochs", "u32", "epochs", source="master.silent_epochs"),
        Field("roll_deg", "f64", "°", source="master.roll", factor=_DEG),
        Field("pitch_deg", "f64", "°", source="master.pitch", factor=_DEG),
        Field("heading_deg", "f64", "°", source="master.heading", factor=_DEG),
        Field("latitude_deg", "f64", "°", source="master.latitude", factor=_DEG),
        Field("longitude_deg", "f64", "°", source="master.longitude", factor=_DEG),
        Field("height_m", "f64", "m", source="master.height"),
        *(Field(f"velocity_{name}_mps", "f64", "m/s", source=f"master.velocity_n.{k}")
            for k, name in enumerate(("east", "north", "up"))),
    )),
)  # fmt: skip
"""Navigation."""

READINGS = (*IDENTIFICATION, *STATUS, *SENSORS, *REDUNDANCY, *ESTIMATOR, *AXES, *NAVIGATION)
"""All identifiers that are not parameters."""
