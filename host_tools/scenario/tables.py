"""The tables of a scenario that do not describe the hardware: every key, with unit and limits.

Those that do are in `rrins.host_tools.hardware.tables`.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

import rrins.firmware_py.core.sensors.calibration
import rrins.firmware_py.core.settings
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.integrity.settings import IntegritySettings
from rrins.firmware_py.core.records.redundancy_records import TEST_LEAST_S, TEST_LONGEST_S
from rrins.firmware_py.core.sensors.fusion import CONDITION_LIMIT
from rrins.host_tools.hardware.memory import OUTAGE_CAPACITY, READMISSION_CAPACITY
from rrins.host_tools.hardware.tables import (
    GnssReceiver,
    Periodic,
    PerSensor,
    TomlTable,
    Turntable,
)
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.geometry import GEOMETRIES, AxesDeg

LONGEST_S = 10_000_000.0
"""Longest time of navigation, and latest time of anything that happens in it."""

MOST_LETTERS = 200
"""Letters of a title at most."""

_Angle = Annotated[float, Field(ge=-360, le=360)]
_Weight = Annotated[float, Field(gt=0, le=1e25)]
_WeightPerSensor = _Weight | tuple[_Weight, ...]


class Site(TomlTable):
    """Where the vehicle stands, on WGS-84."""

    latitude_deg: float = Field(default=40.3554, ge=-89.9, le=89.9)
    """Geodetic latitude, north positive."""
    longitude_deg: float = Field(default=116.668, ge=-180, le=180)
    """Longitude, east positive."""
    height_m: float = Field(default=40.0, ge=-1000, le=100_000)
    """Above the ellipsoid."""


class Body(TomlTable):
    """The vehicle's attitude."""

    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    """Right side down positive."""
    pitch_deg: float = Field(default=0.0, ge=-90, le=90)
    """Nose up positive."""
    heading_deg: float = Field(default=0.0, ge=-360, le=360)
    """Clockwise from north."""


class Rimu(TomlTable):
    """Design directions of the input axes: a built-in geometry, or angles for each kind."""

    geometry: Literal[
        "tetrahedron", "orthogonal", "dodecahedron", "cone", "orthogonal-plus-one", "custom"
    ] = "tetrahedron"
    """A built-in arrangement of the sensors, or `custom` with the two keys below."""
    gyro_axes_deg: tuple[tuple[_Angle, _Angle], ...] | None = None
    """Polar angle from z and azimuth from x of each gyro's input axis."""
    accelerometer_axes_deg: tuple[tuple[_Angle, _Angle], ...] | None = None
    """The same of the accelerometers."""

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


class Outage(TomlTable):
    """A time without a fix, or without a transfer."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    """Since power-on, as of faults."""
    for_s: float = Field(gt=0, le=LONGEST_S)
    """How long it lasts."""


class Tunnel(TomlTable):
    """A stretch of the vehicle's way without a fix, m from where its motion begins."""

    from_m: float = Field(ge=0, le=1e7)
    """Where it begins."""
    to_m: float = Field(gt=0, le=1e7)
    """Where it ends."""

    @model_validator(mode="after")
    def _in_order(self) -> Tunnel:
        if self.to_m <= self.from_m:
            raise ValueError(f"to_m: {self.to_m:g}, but from_m is {self.from_m:g}")
        return self


class Gnss(GnssReceiver):
    """A GNSS receiver, and where it has no fix; fitted if the table is present."""

    outages: tuple[Outage, ...] = Field(default=(), max_length=OUTAGE_CAPACITY)
    """Times without a fix: `[{ at_s = 100, for_s = 30 }]`, s since power-on."""
    tunnels: tuple[Tunnel, ...] = Field(default=(), max_length=OUTAGE_CAPACITY)
    """Stretches of the route without a fix: `[{ from_m = 1200, to_m = 1500 }]`, distance driven
    since the motion began."""
    tunnel_map: str | None = Field(default=None, min_length=1)
    """No fix inside its polygons or on its lines."""
    tunnel_width_m: float = Field(default=20.0, gt=0, le=1000)
    """Width of the lines."""


class Master(Periodic):
    """The master unit of a transferred start."""

    rate_hz: Annotated[int, Field(ge=1, le=10)] = 1
    """Transfers per second."""
    latency_s: float = Field(default=0.1, ge=0, lt=1)
    """From the time of validity to the frames on the bus; less than the interval."""
    outages: tuple[Outage, ...] = Field(default=(), max_length=OUTAGE_CAPACITY)
    """Times in which nothing that it sends is valid: `[{ at_s = 0, for_s = 30 }]`, s since
    power-on."""


class ZeroVelocity(TomlTable):
    """A time in which the operator says that the vehicle stands."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    """Since power-on, as of faults."""
    for_s: float = Field(gt=0, le=LONGEST_S)
    """How long it lasts."""
    velocity_sigma_mps: float = Field(default=0.01, ge=0.001, le=65)
    """How still it stands: standard deviation of each component of its velocity."""


class Firmware(rrins.firmware_py.core.settings.Keys, TomlTable):
    """Settings of the navigation computer."""

    roll_error_arcsec: float = Field(default=0.0, ge=-36_000, le=36_000)
    """Of the given or transferred attitude, as are all of these errors: given minus true."""
    pitch_error_arcsec: float = Field(default=0.0, ge=-36_000, le=36_000)
    """Nose up positive."""
    heading_error_arcsec: float = Field(default=0.0, ge=-36_000, le=36_000)
    """Clockwise positive."""
    level_error_sigma_arcsec: float = Field(default=0.0, ge=0, le=36_000)
    """Standard deviation of what a run draws for roll and pitch, on top."""
    heading_error_sigma_arcsec: float = Field(default=0.0, ge=0, le=36_000)
    """The same of the heading."""
    velocity_error_sigma_mps: float = Field(default=0.0, ge=0, le=100)
    """The same of each component of a transferred velocity."""
    position_error_sigma_m: float = Field(default=0.0, ge=0, le=10_000)
    """The same of each component of a transferred position."""
    calibration: str | None = Field(default=None, min_length=1)
    """TOML file of calibrated errors, relative to the scenario's folder."""
    scheme: (
        Literal["16-position", "8-position", "4-position", "single-axis-4-position", "calibration"]
        | tuple[rrins.firmware_py.core.settings.Turn, ...]
    ) = "16-position"
    """Rotation scheme: a built-in one, or its turns."""
    turn_rate_dps: float = Field(default=2.0, ge=0.01, le=60)
    """Commanded rate of the axes."""
    stand_s: float = Field(default=10.0, ge=0, le=86_400)
    """Time at rest after each turn."""
    isolate_heading: bool = False
    """Whether the inner axis takes the vehicle's turn out, too."""
    gyro_weights: _WeightPerSensor = 1.0
    """Of the fusion: 1/σ² of the gyros up to a common factor. Paper, (54)."""
    accelerometer_weights: _WeightPerSensor = 1.0
    """The same of the accelerometers."""
    clock_error_ppm: float = Field(default=0.0, ge=-1000, le=1000)
    """How much the firmware's own clock runs fast."""

    @property
    def has_attitude_error(self) -> bool:
        """Whether the given attitude is off."""
        fixed = self.roll_error_arcsec, self.pitch_error_arcsec, self.heading_error_arcsec
        return any((*fixed, self.level_error_sigma_arcsec, self.heading_error_sigma_arcsec))

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
    """Which kind of sensor."""
    sensor: int = Field(ge=1, le=SENSOR_GROUPS)
    """Its number, from 1."""
    test_s: int = Field(default=60, ge=TEST_LEAST_S, le=TEST_LONGEST_S)
    """How long it is compared with the others before it is used."""
    anew: bool = False
    """Learn its constants anew; else they must be as they were."""


class Redundancy(TomlTable):
    """The firmware's use of redundant sensors."""

    enabled: bool = True
    """Compare them, leave out the one that fails, repair the history; where there are more than
    three of a kind."""
    false_alarms_per_1000_h: float = Field(default=0.05, ge=1e-9, le=1000)
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
    """Estimate errors of the navigation and biases from all aids that are fitted."""
    fine_alignment_s: float = Field(default=0.0, ge=0, le=86_400)
    """Between the alignment and navigation, while the table turns; 0: none."""
    constants: bool | None = None
    """Estimate scale factors, asymmetries and installation errors, too, not only biases. By default
    where asymmetries are large."""
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
        for key in ("fine_alignment_s", "constants", "detects_standing"):
            if getattr(self, key) and not self.enabled:
                raise ValueError(f"{key}: needs enabled = true")
        return self


class Integrity(IntegritySettings, TomlTable):
    """Bounds of the navigation's error for a stated risk, and the rates of faults they assume."""

    enabled: bool = False
    """Find the bounds; needs the estimator."""


class Xcp(rrins.firmware_py.core.settings.XcpSettings, TomlTable):
    """The measurement and calibration protocol XCP of the firmware."""


class OperatorRequest(TomlTable):
    """A mode that the operator requests, and when (after power-on of the hardware)."""

    at_s: float = Field(ge=0, le=LONGEST_S)
    """After power-on of the hardware."""
    request: Literal["STANDBY", "ALIGN", "NAVIGATE_STRAPDOWN", "NAVIGATE_ROTATING"]
    """The mode."""


class Bus(TomlTable):
    """The wire between the two sides."""

    bitrate: Literal[125_000, 250_000, 500_000, 1_000_000] | None = None
    """bit/s. Models the timing of the wire; without it the wire is ideal and takes no time."""


class EastNorth(TomlTable):
    """A pair of figures."""

    east: float = Field(ge=-1e9, le=1e9)
    """To the east."""
    north: float = Field(ge=-1e9, le=1e9)
    """To the north."""


class Paper(TomlTable):
    """The paper's figures for the same run, for comparison."""

    source: str = Field(default="", max_length=MOST_LETTERS)
    """Where the figures stand."""
    duration_s: float | None = Field(default=None, gt=0, le=LONGEST_S)
    """Length of the paper's run."""
    max_abs_position_error_m: EastNorth | None = None
    max_abs_velocity_error_mps: EastNorth | None = None
    end_position_error_m: float | None = Field(default=None, ge=0, le=1e9)
    """Horizontal."""


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
        f"{rounded(1 / third)} times the error of a sensor (condition number "
        f"{rounded(condition, 4)}, at most {CONDITION_LIMIT:g})"
    )


def each(value: PerSensor, count: int) -> tuple[float, ...]:
    """Return a value for each of `count` sensors."""
    return value if isinstance(value, tuple) else (value,) * count


def check_turntable(table: Turntable, rotates: bool, firmware: Firmware) -> None:
    """Raise ValueError unless both axes can do what the firmware will command."""
    for name, axis in (("inner", table.inner), ("outer", table.outer)):
        if rotates and axis.rate_limit_dps < firmware.turn_rate_dps:
            raise ValueError(
                f"turntable.{name}.rate_limit_dps: {axis.rate_limit_dps:g}, below the "
                f"scheme's {firmware.turn_rate_dps:g}"
            )
    if firmware.isolate_heading and table.inner.jerk_limit_dps3 is not None:
        raise ValueError(
            "firmware.isolate_heading: an inner axis with jerk_limit_dps3 follows no angle that "
            "moves"
        )
