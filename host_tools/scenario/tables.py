"""The tables of a scenario: every key, with unit and limits."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

import rrins.firmware_py.core.sensors.calibration
import rrins.firmware_py.core.settings
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.redundancy_records import TEST_LEAST_S, TEST_LONGEST_S
from rrins.firmware_py.core.sensors.fusion import CONDITION_LIMIT
from rrins.host_tools.hardware.memory import OUTAGE_CAPACITY, READMISSION_CAPACITY
from rrins.host_tools.scenario.geometry import GEOMETRIES, AxesDeg

PerSensor = float | tuple[float, ...]
"""One number for all sensors, or one per sensor."""

LONGEST_RISE_S = 10.0
"""Longest time in which an axis may reach its acceleration."""

LONGEST_S = 10_000_000.0
"""Longest time of navigation, and latest time of anything that happens in it."""

MOST_LETTERS = 200
"""Letters of a title at most."""

_Magnitude = Annotated[float, Field(ge=0)]
_Distance = Annotated[float, Field(ge=-1000, le=1000)]
_DistancePerSensor = _Distance | tuple[_Distance, ...]
_Arm = Annotated[float, Field(ge=-100, le=100)]
_NotNegative = _Magnitude | tuple[_Magnitude, ...]


class TomlTable(BaseModel):
    """A table of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Site(TomlTable):
    """Where the vehicle stands, on WGS-84."""

    latitude_deg: float = Field(default=40.3554, ge=-89.9, le=89.9)
    longitude_deg: float = Field(default=116.668, ge=-180, le=180)
    height_m: float = Field(default=40.0, ge=-1000, le=100_000)


class Body(TomlTable):
    """The vehicle's attitude."""

    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    pitch_deg: float = Field(default=0.0, ge=-90, le=90)
    heading_deg: float = Field(default=0.0, ge=-360, le=360)


class Rimu(TomlTable):
    """Design directions of the input axes: a built-in geometry, or angles for each kind."""

    geometry: Literal[
        "tetrahedron", "orthogonal", "dodecahedron", "cone", "orthogonal-plus-one", "custom"
    ] = "tetrahedron"
    gyro_axes_deg: tuple[tuple[float, float], ...] | None = None
    accelerometer_axes_deg: tuple[tuple[float, float], ...] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Rimu:
        given = (self.gyro_axes_deg, self.accelerometer_axes_deg)
        if self.geometry != "custom":
            if given != (None, None):
                raise ValueError('axes are for geometry = "custom" only')
            return self
        for name, axes in zip(("gyro_axes_deg", "accelerometer_axes_deg"), given, strict=True):
            if axes is None:
                raise ValueError(f'geometry = "custom" needs {name}')
            if not 3 <= len(axes) <= SENSOR_GROUPS:
                raise ValueError(f"{name}: {len(axes)} sensors, must be 3 to {SENSOR_GROUPS}")
            _check_span(name, axes)
        return self

    @property
    def gyros(self) -> AxesDeg:
        """Design directions of the gyros."""
        return self.gyro_axes_deg or GEOMETRIES[self.geometry]

    @property
    def accelerometers(self) -> AxesDeg:
        """Design directions of the accelerometers."""
        return self.accelerometer_axes_deg or GEOMETRIES[self.geometry]


class _Sensors(TomlTable):
    """Errors that both kinds of sensors have. Paper, (13), (16), (17)."""

    scale_error_ppm: PerSensor = 0.0
    asymmetric_scale_error_ppm: PerSensor = 0.0
    installation_u_arcsec: PerSensor = 0.0
    installation_v_arcsec: PerSensor = 0.0
    scale_repeatability_ppm: _NotNegative = 0.0
    """Standard deviation over power-ups."""
    scale_temperature_ppm_per_k: PerSensor = 0.0
    bandwidth_hz: float | None = Field(default=None, gt=0)
    """-3 dB, first order; unlimited by default."""
    latency_ms: float = Field(default=0.0, ge=0, le=25)


class Gyros(_Sensors):
    """Errors of the gyros. Paper, (16)."""

    bias_dph: PerSensor = 0.0
    bias_repeatability_dph: _NotNegative = 0.0
    bias_instability_dph: _NotNegative = 0.0
    """Coefficient B of IEEE 952: the floor of the Allan deviation is 0.664 B."""
    bias_temperature_dph_per_k: PerSensor = 0.0
    angle_random_walk_deg_per_sqrt_h: _NotNegative = 0.0
    rate_random_walk_dph_per_sqrt_h: _NotNegative = 0.0
    g_sensitivity_dph_per_g: PerSensor = 0.0
    """Bias per g of specific force along the input axis."""
    dead_zone_dph: _NotNegative = 0.0
    resolution_arcsec: float = Field(default=0.0, ge=0)
    range_dps: float = Field(default=300.0, gt=0)


class Accelerometers(_Sensors):
    """Errors of the accelerometers. Paper, (17)."""

    bias_ug: PerSensor = 0.0
    bias_repeatability_ug: _NotNegative = 0.0
    bias_instability_ug: _NotNegative = 0.0
    bias_temperature_ug_per_k: PerSensor = 0.0
    white_noise_ug_per_sqrt_hz: _NotNegative = 0.0
    random_walk_ug_per_sqrt_h: _NotNegative = 0.0
    dead_zone_ug: _NotNegative = 0.0
    resolution_um_per_s: float = Field(default=0.0, ge=0)
    range_g: float = Field(default=20.0, gt=0)
    position_x_mm: _DistancePerSensor = 0.0
    """In the sensor frame, from the reference point: where the axes of the table meet."""
    position_y_mm: _DistancePerSensor = 0.0
    position_z_mm: _DistancePerSensor = 0.0


class Axis(TomlTable):
    """Limits, encoder and imperfections of one axis of the turntable."""

    rate_limit_dps: float = Field(default=30.0, gt=0, le=60)
    acceleration_limit_dps2: float = Field(default=10.0, gt=0, le=10_000)
    jerk_limit_dps3: float | None = Field(default=None, gt=0)
    encoder_bits: int = Field(default=24, ge=8, le=26)
    """Bits per revolution."""
    encoder_offset_deg: float = Field(default=0.0, ge=-5, le=5)
    ripple_arcsec: float = Field(default=0.0, ge=0, le=3600)
    """Amplitude of the periodic angle error."""
    ripple_per_turn: float = Field(default=36.0, gt=0, le=10_000)
    stiction_arcsec: float = Field(default=0.0, ge=0, le=3600)
    """By how much the drive winds up before the table follows."""
    run_out_um: float = Field(default=0.0, ge=-100_000, le=100_000)
    """Distance of the sensors' centre from the axis."""

    @property
    def rise_s(self) -> float:
        """Time to reach the full acceleration."""
        jerk = self.jerk_limit_dps3
        return 0.0 if jerk is None else self.acceleration_limit_dps2 / jerk

    @model_validator(mode="after")
    def _consistent(self) -> Axis:
        if self.rise_s > LONGEST_RISE_S:
            raise ValueError(
                f"jerk_limit_dps3: the acceleration takes {self.rise_s:.3g} s to rise, "
                f"{LONGEST_RISE_S:g} s at most"
            )
        return self


class Turntable(TomlTable):
    """The two axes, and their alignment to each other."""

    inner: Axis = Axis()
    outer: Axis = Axis()
    non_orthogonality_arcsec: float = Field(default=0.0, ge=-3600, le=3600)
    wobble_arcsec: float = Field(default=0.0, ge=0, le=3600)
    """Of the inner axis."""
    wobble_per_turn: float = Field(default=1.0, gt=0, le=100)

    def check(self, rotates: bool, firmware: Firmware) -> None:
        """Raise ValueError unless both axes can do what the firmware will tell them."""
        for name, axis in (("inner", self.inner), ("outer", self.outer)):
            if rotates and axis.rate_limit_dps < firmware.turn_rate_dps:
                raise ValueError(
                    f"turntable.{name}.rate_limit_dps: {axis.rate_limit_dps:g}, below the "
                    f"scheme's {firmware.turn_rate_dps:g}"
                )
        if firmware.isolate_heading and self.inner.jerk_limit_dps3 is not None:
            raise ValueError(
                "firmware.isolate_heading: an inner axis with jerk_limit_dps3 follows no angle "
                "that moves"
            )


class Thermal(TomlTable):
    """Temperature of the sensors above that of their calibration."""

    ambient_offset_k: float = Field(default=0.0, ge=-100, le=100)
    warm_up_k: float = Field(default=0.0, ge=-100, le=100)
    """Final temperature rise after power-on."""
    time_constant_s: float = Field(default=600.0, gt=0, le=100_000)


class Altimeter(TomlTable):
    """A barometric altimeter; fitted if the table is present."""

    bias_m: float = Field(default=0.0, ge=-1000, le=1000)
    noise_m: float = Field(default=0.0, ge=0, le=100)


class Outage(TomlTable):
    """A time without a fix, or without a transfer."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    """Since power-on, as of faults."""
    for_s: float = Field(gt=0, le=LONGEST_S)


class Tunnel(TomlTable):
    """A stretch of the vehicle's way without a fix, m from where its motion begins."""

    from_m: float = Field(ge=0, le=1e7)
    to_m: float = Field(gt=0, le=1e7)

    @model_validator(mode="after")
    def _in_order(self) -> Tunnel:
        if self.to_m <= self.from_m:
            raise ValueError(f"to_m: {self.to_m:g}, but from_m is {self.from_m:g}")
        return self


class Gnss(TomlTable):
    """A GNSS receiver; fitted if the table is present."""

    rate_hz: Annotated[int, Field(ge=1, le=10)] = 1
    position_noise_m: float = Field(default=1.5, ge=0, le=40)
    """Standard deviation of each component, as of the velocity."""
    velocity_noise_mps: float = Field(default=0.05, ge=0, le=10)
    position_correlated_noise_m: float = Field(default=0.0, ge=0, le=40)
    """Standard deviation of each component's first-order Gauss-Markov error."""
    position_correlation_s: float = Field(default=60.0, ge=0.1, le=100_000)
    """Its time constant."""
    latency_s: float = Field(default=0.1, ge=0, lt=1)
    lever_arm_m: tuple[_Arm, _Arm, _Arm] = (0.0, 0.0, 0.0)
    """In the body frame, from the reference point to the antenna."""
    outages: tuple[Outage, ...] = Field(default=(), max_length=OUTAGE_CAPACITY)
    tunnels: tuple[Tunnel, ...] = Field(default=(), max_length=OUTAGE_CAPACITY)
    tunnel_map: str | None = Field(default=None, min_length=1)
    """GeoJSON file, relative to the scenario's folder: no fix inside its polygons, on its lines."""
    tunnel_width_m: float = Field(default=20.0, gt=0, le=1000)
    """Of the lines."""


class Master(TomlTable):
    """The master unit of a transferred start."""

    rate_hz: Annotated[int, Field(ge=1, le=10)] = 1
    latency_s: float = Field(default=0.1, ge=0, lt=1)
    """From the time of validity to the frames on the bus."""
    outages: tuple[Outage, ...] = Field(default=(), max_length=OUTAGE_CAPACITY)
    """Times in which it has nothing valid to send."""


class ZeroVelocity(TomlTable):
    """A time in which the operator says that the vehicle stands."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    """Since power-on, as of faults."""
    for_s: float = Field(gt=0, le=LONGEST_S)
    velocity_sigma_mps: float = Field(default=0.01, ge=0.001, le=65)
    """How still it stands: standard deviation of each component of its velocity."""


class Odometer(TomlTable):
    """An odometer; fitted if the table is present."""

    rate_hz: Annotated[int, Field(ge=1, le=50)] = 10
    pulse_mm: float = Field(default=2.0, ge=0.01, le=10_000)
    """What a pulse means by the data sheet."""
    scale_error_ppm: float = Field(default=0.0, ge=-100_000, le=100_000)
    """What it counts too much."""
    noise_mps: float = Field(default=0.02, ge=0, le=10)
    """Standard deviation of the mean speed over an interval, while the wheel turns."""
    latency_s: float = Field(default=0.0, ge=0, le=0.5)
    mounting_heading_deg: float = Field(default=0.0, ge=-180, le=180)
    """Of the vehicle's forward axis in the body frame, as is the pitch."""
    mounting_pitch_deg: float = Field(default=0.0, ge=-30, le=30)
    lever_arm_m: tuple[_Arm, _Arm, _Arm] = (0.0, 0.0, 0.0)
    """In the body frame, from the reference point to where the wheel touches the ground."""


class Firmware(TomlTable):
    """Settings of the navigation computer."""

    initial_attitude: Literal[
        "given", "self-aligned", "self-aligned-swaying", "self-aligned-moving", "transferred"
    ] = "given"
    """Self-aligned at standstill, of a vehicle that sways about its place, or one that moves and
    has GNSS. Transferred: another unit's, with velocity and position, also of a vehicle that
    moves."""
    roll_error_arcsec: float = Field(default=0.0, ge=-36_000, le=36_000)
    """Of the given or transferred attitude, as are all of these errors: given minus true."""
    pitch_error_arcsec: float = Field(default=0.0, ge=-36_000, le=36_000)
    heading_error_arcsec: float = Field(default=0.0, ge=-36_000, le=36_000)
    level_error_sigma_arcsec: float = Field(default=0.0, ge=0, le=36_000)
    """Standard deviation of what a run draws for roll and pitch, on top."""
    heading_error_sigma_arcsec: float = Field(default=0.0, ge=0, le=36_000)
    velocity_error_sigma_mps: float = Field(default=0.0, ge=0, le=100)
    """The same of each component of a transferred velocity."""
    position_error_sigma_m: float = Field(default=0.0, ge=0, le=10_000)
    alignment_s: float = Field(default=2.0, gt=0, le=86_400)
    height_channel: Literal["held", "damped", "free"] = "held"
    """`damped` follows the altimeter, or the initial height if there is none."""
    calibration: str | None = Field(default=None, min_length=1)
    """TOML file of calibrated errors, relative to the scenario's folder."""
    scheme: (
        Literal["16-position", "8-position", "4-position", "single-axis-4-position", "calibration"]
        | tuple[rrins.firmware_py.core.settings.Turn, ...]
    ) = "16-position"
    turn_rate_dps: float = Field(default=2.0, ge=0.01, le=60)
    stand_s: float = Field(default=10.0, ge=0, le=86_400)
    isolate_heading: bool = False
    """Whether the inner axis takes the vehicle's turn out, too."""
    gyro_weights: PerSensor = 1.0
    accelerometer_weights: PerSensor = 1.0
    clock_error_ppm: float = Field(default=0.0, ge=-1000, le=1000)
    bridge_s: float = Field(default=0.1, ge=0, le=10)
    follow_tolerance_deg: float = Field(default=5.0, gt=0, le=180)
    axis_silence_s: float = Field(default=1.0, gt=0, le=60)
    gyro_consistency_dph: float = Field(default=50.0, ge=0.001, le=1e6)
    accelerometer_consistency_ug: float = Field(default=5000.0, ge=0.1, le=1e7)

    @property
    def has_attitude_error(self) -> bool:
        """Whether the given attitude is off."""
        return any(
            (
                self.roll_error_arcsec,
                self.pitch_error_arcsec,
                self.heading_error_arcsec,
                self.level_error_sigma_arcsec,
                self.heading_error_sigma_arcsec,
            )
        )

    @model_validator(mode="after")
    def _consistent(self) -> Firmware:
        source = self.initial_attitude
        if self.has_attitude_error and source not in ("given", "transferred"):
            raise ValueError(
                'errors of the attitude are for initial_attitude = "given" or "transferred" only'
            )
        has_motion_error = self.velocity_error_sigma_mps > 0 or self.position_error_sigma_m > 0
        if has_motion_error and source != "transferred":
            raise ValueError(
                'errors of velocity and position are for initial_attitude = "transferred" only'
            )
        return self


class Readmission(TomlTable):
    """An order of the operator to take a sensor that was left out back into use."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    """After power-on of the hardware."""
    kind: Literal["gyro", "accelerometer"]
    sensor: int = Field(ge=1, le=SENSOR_GROUPS)
    test_s: int = Field(default=60, ge=TEST_LEAST_S, le=TEST_LONGEST_S)
    """How long it is compared with the others before it is used."""
    anew: bool = False
    """Learn its constants anew; else they must be as they were."""


class Redundancy(TomlTable):
    """What the firmware does with redundant sensors."""

    enabled: bool = True
    """Compare them, leave out the one that fails, repair the history; where there are more than
    three of a kind."""
    false_alarms_per_1000_h: float = Field(default=0.05, gt=0, le=1000)
    """The promise from which, with the sensors' data sheet, the thresholds follow."""
    readmit: tuple[Readmission, ...] = Field(default=(), max_length=READMISSION_CAPACITY)
    """Sensors to take back into use, in order of time."""

    @model_validator(mode="after")
    def _in_order(self) -> Redundancy:
        times = [order.at_s for order in self.readmit]
        if times != sorted(times):
            raise ValueError("readmit: the orders are not in order of time")
        return self


class Estimator(TomlTable):
    """The firmware's error-state Kalman filter."""

    enabled: bool = False
    fine_alignment_s: float = Field(default=0.0, ge=0, le=86_400)
    """Between the alignment and navigation, while the table turns; 0: none."""
    constants: bool = False
    """Estimate scale factors, asymmetries and installation errors, too, not only biases."""
    heading_sigma_enough_arcsec: float = Field(default=0.0, ge=0, le=36_000)
    """Ends the fine alignment before its time once the heading is known this well; 0: never."""
    zero_velocity_sigma_mps: float = Field(default=0.002, gt=0, le=10)
    """Of the velocity of a vehicle that stands, each component."""
    detects_standing: bool = False
    """Find standing by the sensors themselves, and take it for zero velocity."""
    position_sigma_m: float = Field(default=0.02, gt=0, le=1000)
    """Of the position where navigation begins, each component."""
    gate: float = Field(default=5.0, gt=1, le=100)
    """Standard deviations beyond which a measurement is not used."""
    level_sigma_arcsec: float | None = Field(default=None, ge=0, le=36_000)
    """Of a given roll and pitch; by default what `[firmware]` draws for them."""
    heading_sigma_arcsec: float | None = Field(default=None, ge=0, le=36_000)
    """Of a given heading; by default what `[firmware]` draws for it."""

    @model_validator(mode="after")
    def _whole(self) -> Estimator:
        if self.fine_alignment_s > 0 and not self.enabled:
            raise ValueError("fine_alignment_s: needs enabled = true")
        if self.constants and not self.enabled:
            raise ValueError("constants: needs enabled = true")
        if self.detects_standing and not self.enabled:
            raise ValueError("detects_standing: needs enabled = true")
        return self


class OperatorRequest(TomlTable):
    """A mode that the operator requests, and when (after power-on of the hardware)."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    request: Literal["STANDBY", "ALIGN", "NAVIGATE_STRAPDOWN", "NAVIGATE_ROTATING"]


class Bus(TomlTable):
    """The wire between the two sides."""

    bitrate: Literal[125_000, 250_000, 500_000, 1_000_000] | None = None
    """bit/s. Models the timing of the wire; without it the wire is ideal and takes no time."""


class EastNorth(TomlTable):
    """A pair of figures."""

    east: float
    north: float


class Paper(TomlTable):
    """The paper's figures for the same run, for comparison."""

    source: str = Field(default="", max_length=MOST_LETTERS)
    duration_s: float | None = None
    max_abs_position_error_m: EastNorth | None = None
    max_abs_velocity_error_mps: EastNorth | None = None
    end_position_error_m: float | None = None


def _check_span(name: str, axes_deg: AxesDeg) -> None:
    """Raise ValueError unless the firmware can fuse the sensors to a vector."""
    H = rrins.firmware_py.core.sensors.calibration.input_axes(axes_deg)
    condition = rrins.firmware_py.core.sensors.calibration.condition_number(H)
    if condition <= CONDITION_LIMIT:
        return
    first, second, third = np.linalg.svd(H, compute_uv=False)
    shape = "line" if first > CONDITION_LIMIT / 3 * second else "plane"
    if math.isinf(condition):
        raise ValueError(f"{name}: the axes lie in one {shape}")
    raise ValueError(
        f"{name}: the axes are too close to one {shape}: across it, a vector would have "
        f"{1 / third:.3g} times the error of a sensor (condition number {condition:.4g}, at most "
        f"{CONDITION_LIMIT:g})"
    )


def each(value: PerSensor, count: int) -> tuple[float, ...]:
    """Return a value for each of `count` sensors."""
    return value if isinstance(value, tuple) else (value,) * count
