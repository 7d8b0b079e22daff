"""The firmware's set-up, and the RAM image made from it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rrins.compiled.record import Records
from rrins.dbc.codec import span_of
from rrins.dbc.contract import SENSOR_GROUPS, Contract
from rrins.firmware_py.core.estimator import settings as estimator
from rrins.firmware_py.core.estimator.settings import EstimatorSettings
from rrins.firmware_py.core.frames_in import clock, intake
from rrins.firmware_py.core.integrity import settings as integrity
from rrins.firmware_py.core.integrity.settings import IntegritySettings
from rrins.firmware_py.core.maths.attitude import matrix_of_euler
from rrins.firmware_py.core.navigation import strapdown, transfer
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import (
    INNER,
    OUTER,
    SCHEME_CAPACITY,
    Fusion,
    Odometer,
    Parameters,
    Ram,
    blank_ram,
)
from rrins.firmware_py.core.redundancy import drift_settings as drift
from rrins.firmware_py.core.redundancy import settings as redundancy
from rrins.firmware_py.core.redundancy.settings import RedundancySettings
from rrins.firmware_py.core.sensors import calibration, size_effect
from rrins.firmware_py.core.sensors.calibration import (
    AccelerometerCalibration,
    Calibration,
    GyroCalibration,
)
from rrins.firmware_py.core.sensors.fusion import GAIN_LIMIT, WEIGHT_RATIO_LIMIT

_HEIGHT_CHANNELS = {
    "held": strapdown.HEIGHT_HELD,
    "damped": strapdown.HEIGHT_DAMPED,
    "free": strapdown.HEIGHT_FREE,
}


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Turn(_Checked):
    """One position of a rotation scheme: a turn of one axis."""

    axis: Literal["inner", "outer"]
    """Inner: z of the sensors; outer: x of the body."""
    angle_deg: float = Field(ge=-720, le=720)
    """By which it turns."""


class Scheme(_Checked):
    """A rotation scheme: consecutive turns, each followed by a dwell."""

    turns: tuple[Turn, ...] = Field(min_length=1, max_length=SCHEME_CAPACITY)
    turn_rate_dps: float = Field(default=2.0, gt=0, le=60)
    stand_s: float = Field(default=10.0, ge=0, le=86400)
    isolate_heading: bool = False
    """Whether the inner axis takes the vehicle's turn out, too."""

    def position_s(self, turn: Turn) -> float:
        """Return the duration of a position, s: its turn at the full rate, and the dwell."""
        return abs(turn.angle_deg) / self.turn_rate_dps + self.stand_s

    @property
    def cycle_s(self) -> float:
        """Duration of one cycle, s."""
        return sum(self.position_s(turn) for turn in self.turns)


@lru_cache(64)
def check_weights(weights: tuple[float, ...], axes_deg: tuple[tuple[float, float], ...]) -> None:
    """Raise ValueError unless sensors along these axes can be fused with these weights."""
    if min(weights) <= 0:
        raise ValueError("a weight must be above 0")
    if max(weights) > WEIGHT_RATIO_LIMIT * min(weights):
        raise ValueError(
            f"{max(weights):g} and {min(weights):g} are too far apart, at most "
            f"{WEIGHT_RATIO_LIMIT:g} to 1"
        )
    share = calibration.largest_gain(calibration.input_axes(axes_deg), weights)
    if share > GAIN_LIMIT:
        raise ValueError(
            f"they rely on axes close to one plane: {share:,.0f} times the error of a sensor would "
            f"be in the vector, at most {GAIN_LIMIT:g} times"
        )


class OdometerSettings(_Checked):
    """The odometer, as its data sheet and the drawings of the vehicle say."""

    interval_s: float = Field(gt=0, le=1)
    metres_per_pulse: float = Field(gt=0, le=10)
    noise_mps: float = Field(default=0.0, ge=0, le=10)
    """Standard deviation of the mean speed over an interval."""
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the reference point to the wheel's contact, in the body frame."""


class XcpSettings(_Checked):
    """The measurement and calibration protocol XCP."""

    frames_hz: int = Field(default=6000, ge=100, le=100_000)
    """Most frames of XCP that the navigation computer sends in a second, responses and measured
    data."""


class Keys(_Checked):
    """Keys that the table `[firmware]` of a scenario and the firmware's settings share."""

    initial_attitude: Literal[
        "given", "self-aligned", "self-aligned-swaying", "self-aligned-moving", "transferred"
    ] = "given"
    """Self-aligned at standstill, of a vehicle that sways about its place, or one that moves and
    has GNSS. Transferred: another unit's, with velocity and position, also of a vehicle that
    moves."""
    alignment_s: float = Field(default=2.0, gt=0, le=86_400)
    """Length of the alignment; of a vehicle that sways or moves its minimum."""
    height_channel: Literal["held", "damped", "free"] = "held"
    """`damped` follows the altimeter, or the initial height if there is none."""
    bridge_s: float = Field(default=0.1, ge=0, le=10)
    """Longest gap in the sensor data that is bridged."""
    follow_tolerance_deg: float = Field(default=5.0, gt=0, le=180)
    """Permitted distance between an axis and its expected angle."""
    axis_silence_s: float = Field(default=1.0, gt=0, le=60)
    """Longest permitted silence of an axis."""
    gyro_consistency_dph: float = Field(default=50.0, ge=0.001, le=1e6)
    """Permitted disagreement between redundant gyros."""
    accelerometer_consistency_ug: float = Field(default=5000.0, ge=0.1, le=1e7)
    """The same of accelerometers."""


class Settings(Keys):
    """The firmware's set-up; angles in degrees as a person writes them.

    `gyro_axes_deg` and `accelerometer_axes_deg` are the design directions of the input axes:
    polar angle from z and azimuth from x of the sensor frame (paper, figure 1).
    """

    rate_hz: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    gyro_axes_deg: tuple[tuple[float, float], ...]
    accelerometer_axes_deg: tuple[tuple[float, float], ...]
    gyro_weights: tuple[float, ...]
    accelerometer_weights: tuple[float, ...]
    axis_acceleration_dps2: float
    axis_rise_s: float = 0.0
    isolation_rate_dps: float = Field(default=30.0, gt=0, le=60)
    """At most, of the inner axis while it takes the vehicle's turn out."""
    encoder_step_deg: float = 0.0
    scheme: Scheme
    altimeter: bool = False
    gnss_interval_s: float = Field(default=0.0, ge=0, le=10)
    """Between fixes; 0: no receiver is fitted."""
    gnss_lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the reference point to the antenna, in the body frame."""
    odometer: OdometerSettings | None = None
    calibration: Calibration = Calibration()
    redundancy: RedundancySettings | None = None
    estimator: EstimatorSettings | None = None
    integrity: IntegritySettings | None = None
    xcp: XcpSettings | None = None
    """None: the computer does not listen to XCP."""
    calibration_file: str | None = None
    """Source of the initial attitude."""

    @model_validator(mode="after")
    def _weights(self) -> Settings:
        check_weights(self.gyro_weights, self.gyro_axes_deg)
        check_weights(self.accelerometer_weights, self.accelerometer_axes_deg)
        return self


def _fill_fusion(
    fusion: Fusion,
    axes_deg: tuple[tuple[float, float], ...],
    weights: tuple[float, ...],
    sensors: GyroCalibration | AccelerometerCalibration,
    dt: float,
) -> None:
    count = len(axes_deg)
    assert count <= SENSOR_GROUPS
    fusion.count = count
    fusion.weight[:count] = weights
    calibration.fill(fusion, axes_deg, sensors, dt)


def _fill_scheme(parameters: Parameters, scheme: Scheme, rate_hz: int) -> None:
    parameters.turn_rate_dps = scheme.turn_rate_dps
    parameters.position_count = len(scheme.turns)
    for k, turn in enumerate(scheme.turns):
        parameters.position_axis[k] = INNER if turn.axis == "inner" else OUTER
        parameters.position_turn_deg[k] = turn.angle_deg
        parameters.position_epochs[k] = max(1, round(scheme.position_s(turn) * rate_hz))


def _fill_odometer(record: Odometer, odometer: OdometerSettings | None, rate_hz: int) -> None:
    if odometer is None:
        return
    record.interval_epochs = round(odometer.interval_s * rate_hz)
    record["metres_per_pulse"] = odometer.metres_per_pulse
    record.noise = odometer.noise_mps
    record.lever_arm_b[:] = odometer.lever_arm_m


def power_on(settings: Settings, contract: Records[Contract]) -> Records[Ram]:
    """Return the RAM image of the firmware at power-on."""
    ram = blank_ram()
    _fill_computer(ram[0], settings, contract)
    fill_unit(ram[0], settings, contract)
    return ram


def _fill_computer(state: Ram, settings: Settings, contract: Records[Contract]) -> None:
    """Fill in what all units of a design have in common."""
    parameters = state.parameters
    rate_hz = settings.rate_hz
    parameters.period_ns = 1_000_000_000 // rate_hz
    parameters.angle_span_deg = span_of(contract[0].axis_inner_status.encoder_angle_deg)
    source = settings.initial_attitude.upper().replace("-", "_")
    parameters.initial_attitude = InitialAttitude[source]
    parameters.alignment_epochs = max(1, round(settings.alignment_s * rate_hz))
    parameters.height_channel = _HEIGHT_CHANNELS[settings.height_channel]
    parameters.altimeter = settings.altimeter
    state.gnss.interval_epochs = round(settings.gnss_interval_s * rate_hz)
    state.antenna.lever_arm_b[:] = settings.gnss_lever_arm_m
    state.antenna.present = any(settings.gnss_lever_arm_m)
    state.transfer.last = transfer.NEVER
    _fill_odometer(state.odometer, settings.odometer, rate_hz)
    parameters.bridge_epochs = round(settings.bridge_s * rate_hz)
    parameters["axis_acceleration_dps2"] = settings.axis_acceleration_dps2
    parameters.axis_rise_s = settings.axis_rise_s
    parameters.isolate_heading = settings.scheme.isolate_heading
    parameters["isolation_rate_dps"] = settings.isolation_rate_dps
    resolution_deg = float(contract[0].axis_inner_status.encoder_angle_deg.scale)
    state.encoders.step_deg = max(settings.encoder_step_deg, resolution_deg)
    parameters.follow_tolerance_deg = settings.follow_tolerance_deg
    parameters.axis_silence_epochs = round(settings.axis_silence_s * rate_hz)
    dt = 1 / rate_hz
    parameters.gyro_consistency = settings.gyro_consistency_dph * calibration.DPH * dt
    parameters.accelerometer_consistency = (
        settings.accelerometer_consistency_ug * calibration.UG * dt
    )
    _fill_scheme(parameters, settings.scheme, rate_hz)
    _fill_fusion(
        state.gyros,
        settings.gyro_axes_deg,
        settings.gyro_weights,
        settings.calibration.gyros,
        dt,
    )
    _fill_fusion(
        state.accelerometers,
        settings.accelerometer_axes_deg,
        settings.accelerometer_weights,
        settings.calibration.accelerometers,
        dt,
    )
    size_effect.fill(
        state.size_effect,
        settings.calibration.accelerometers,
        len(settings.accelerometer_axes_deg),
    )
    calibration.fill_origin(state.calibration, settings.calibration.calibrated)
    redundancy.blank(state)
    state.dispatch = intake.dispatch_table(contract, has_xcp=settings.xcp is not None)
    state.epoch = -1
    clock.power_on(state.clock, parameters.period_ns)


def fill_unit(state: Ram, settings: Settings, contract: Records[Contract]) -> None:
    """Fill in what differs from unit to unit: its pose, and what its data sheets make of faults.

    `state` is at power-on, with settings that may differ in these.
    """
    parameters, rate_hz = state.parameters, settings.rate_hz
    parameters.latitude = math.radians(settings.latitude_deg)
    parameters.longitude = math.radians(settings.longitude_deg)
    parameters.height = settings.height_m
    matrix_of_euler(
        parameters.C_b_n,
        math.radians(settings.roll_deg),
        math.radians(settings.pitch_deg),
        math.radians(settings.heading_deg),
    )
    axes = settings.gyro_axes_deg, settings.accelerometer_axes_deg
    if settings.redundancy is not None:
        sensor = contract[0].sensor[0]
        resolutions = (float(sensor.gyro_dtheta.scale), float(sensor.accelerometer_dv.scale))
        redundancy.set_up(state, settings.redundancy, rate_hz, resolutions)
        drift.set_up(state, settings.calibration, settings.redundancy, axes)
    if settings.estimator is not None:
        if settings.altimeter:
            estimator.take_altimeter(state)
        estimator.set_up(state, settings.estimator, rate_hz, axes)
    if settings.integrity is not None:
        integrity.set_up(state, settings.integrity)
