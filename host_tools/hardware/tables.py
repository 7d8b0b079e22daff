"""The tables of a scenario that describe the hardware: every key, with unit, limits and default.

A key is declared here and nowhere else. Its unit is the end of its name (`hardware.units`). A field
of the record with the name without the unit takes the value in SI units.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rrins.host_tools.hardware.units import Called

PerSensor = float | tuple[float, ...]
"""One number for all sensors, or one per sensor."""

LONGEST_RISE_S = 10.0
"""Longest time in which an axis may reach its acceleration."""

_Mount = Annotated[float, Field(ge=-324_000, le=324_000)]
_MountPerSensor = _Mount | tuple[_Mount, ...]
_Signed6 = Annotated[float, Field(ge=-1e6, le=1e6)]
_Signed6PerSensor = _Signed6 | tuple[_Signed6, ...]
_Signed7 = Annotated[float, Field(ge=-1e7, le=1e7)]
_Signed7PerSensor = _Signed7 | tuple[_Signed7, ...]
_UpTo6 = Annotated[float, Field(ge=0, le=1e6)]
_UpTo6PerSensor = _UpTo6 | tuple[_UpTo6, ...]
_UpTo7 = Annotated[float, Field(ge=0, le=1e7)]
_UpTo7PerSensor = _UpTo7 | tuple[_UpTo7, ...]
_Walk = Annotated[float, Field(ge=0, le=1e4)]
_WalkPerSensor = _Walk | tuple[_Walk, ...]
_Distance = Annotated[float, Field(ge=-1000, le=1000)]
_DistancePerSensor = _Distance | tuple[_Distance, ...]
_Arm = Annotated[float, Field(ge=-100, le=100)]


class TomlTable(BaseModel):
    """A table of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    if not TYPE_CHECKING:

        def __setattr__(self, name: str, value: object) -> None:
            raise AttributeError(
                f"{name}: a scenario stays as it is; load_scenario(scenario, {name}=…) returns "
                "one with another value"
            )


class _Sensors(TomlTable):
    """Errors that both kinds of sensors have. Paper, (13), (16), (17)."""

    scale_error_ppm: _Signed6PerSensor = 0.0
    """Symmetric scale factor error λ."""
    asymmetric_scale_error_ppm: _Signed6PerSensor = 0.0
    """Asymmetric scale factor error μ: added for positive input, subtracted for negative."""
    installation_u_arcsec: _MountPerSensor = 0.0
    """Installation error δu."""
    installation_v_arcsec: _MountPerSensor = 0.0
    """Installation error δv."""
    scale_repeatability_ppm: _UpTo6PerSensor = 0.0
    """Standard deviation of the scale factor's change at each power-up."""
    scale_temperature_ppm_per_k: _Signed6PerSensor = 0.0
    """Temperature coefficient of the scale factor, see `[thermal]`."""
    bandwidth_hz: float | None = Field(default=None, ge=0.01, le=1e6)
    """-3 dB, first order."""
    latency_ms: float = Field(default=0.0, ge=0, le=25)
    """Delay of the output."""


class Gyros(_Sensors):
    """Errors of the gyros. Paper, (16)."""

    bias_dph: _Signed6PerSensor = 0.0
    """Bias b."""
    bias_repeatability_dph: _UpTo6PerSensor = 0.0
    """Standard deviation of the bias change at each power-up."""
    bias_instability_dph: _UpTo6PerSensor = 0.0
    """Coefficient B of IEEE 952; the floor of the Allan deviation is 0.664 B."""
    bias_temperature_dph_per_k: _Signed6PerSensor = 0.0
    """Temperature coefficient of the bias, see `[thermal]`."""
    angle_random_walk_deg_per_sqrt_h: Annotated[_WalkPerSensor, Called("white_noise")] = 0.0
    """White noise."""
    rate_random_walk_dph_per_sqrt_h: _UpTo6PerSensor = 0.0
    """Random walk of the bias."""
    g_sensitivity_dph_per_g: _Signed6PerSensor = 0.0
    """Bias per g of specific force along the input axis."""
    dead_zone_dph: _UpTo6PerSensor = 0.0
    """Input below this has no effect."""
    resolution_arcsec: float = Field(default=0.0, ge=0, le=360_000)
    """The sensor's own quantisation step, if coarser than the frame's; remainders carry over."""
    range_dps: float = Field(default=300.0, gt=0, le=1e6)
    """Measuring range."""


class Accelerometers(_Sensors):
    """Errors of the accelerometers. Paper, (17)."""

    bias_ug: _Signed7PerSensor = 0.0
    """Bias b."""
    bias_repeatability_ug: _UpTo7PerSensor = 0.0
    """Standard deviation of the bias change at each power-up."""
    bias_instability_ug: _UpTo7PerSensor = 0.0
    """Coefficient B of IEEE 952."""
    bias_temperature_ug_per_k: _Signed7PerSensor = 0.0
    """Temperature coefficient of the bias, see `[thermal]`."""
    white_noise_ug_per_sqrt_hz: _UpTo6PerSensor = 0.0
    """White noise."""
    random_walk_ug_per_sqrt_h: Annotated[_UpTo7PerSensor, Called("rate_random_walk")] = 0.0
    """Random walk of the bias."""
    dead_zone_ug: _UpTo7PerSensor = 0.0
    """Input below this has no effect."""
    resolution_um_per_s: float = Field(default=0.0, ge=0, le=1e7)
    """The sensor's own quantisation step, if coarser than the frame's; remainders carry over."""
    range_g: float = Field(default=20.0, gt=0, le=1e6)
    """Measuring range."""
    position_x_mm: _DistancePerSensor = 0.0
    """Position in the sensor frame, measured from the intersection of the table's axes:
    [size effect](error-model.md#size-effect)."""
    position_y_mm: _DistancePerSensor = 0.0
    """The same along y."""
    position_z_mm: _DistancePerSensor = 0.0
    """The same along z."""


class Axis(TomlTable):
    """Limits, encoder and imperfections of one axis of the turntable."""

    rate_limit_dps: float = Field(default=30.0, gt=0, le=60)
    """Highest rate."""
    acceleration_limit_dps2: float = Field(default=10.0, ge=0.001, le=10_000)
    """Highest acceleration."""
    jerk_limit_dps3: float | None = Field(default=None, gt=0, le=1e9)
    """Lengthens each turn by acceleration / jerk, 10 s at most."""
    encoder_bits: int = Field(default=24, ge=8, le=26)
    """Bits per turn."""
    encoder_offset_deg: float = Field(default=0.0, ge=-5, le=5)
    """Constant error of the encoder reading."""
    ripple_arcsec: float = Field(default=0.0, ge=0, le=3600)
    """Amplitude of the angle ripple."""
    ripple_per_turn: float = Field(default=36.0, gt=0, le=10_000)
    """Ripple periods per turn."""
    stiction_arcsec: float = Field(default=0.0, ge=0, le=3600)
    """How far the drive winds up before the table moves."""
    run_out_um: float = Field(default=0.0, ge=-100_000, le=100_000)
    """Distance between the sensors' centre and the axis."""

    @property
    def rise_s(self) -> float:
        """Time to reach the full acceleration."""
        jerk = self.jerk_limit_dps3
        return 0.0 if jerk is None else self.acceleration_limit_dps2 / jerk

    @property
    def encoder_step_deg(self) -> float:
        """Resolution of the encoder."""
        return 360 / 2**self.encoder_bits

    @model_validator(mode="after")
    def _consistent(self) -> Axis:
        if self.rise_s > LONGEST_RISE_S:
            raise ValueError(
                f"jerk_limit_dps3: the acceleration takes {round(self.rise_s, 1):g} s to rise, "
                f"{LONGEST_RISE_S:g} s at most"
            )
        return self


class Turntable(TomlTable):
    """The two axes, and their alignment to each other."""

    inner: Axis = Axis()
    outer: Axis = Axis()
    non_orthogonality_arcsec: float = Field(default=0.0, ge=-3600, le=3600)
    """Deviation of the axes from a right angle."""
    wobble_arcsec: float = Field(default=0.0, ge=0, le=3600)
    """Wobble of the inner axis as it turns."""
    wobble_per_turn: float = Field(default=1.0, gt=0, le=100)
    """Wobble periods per turn."""


class Thermal(TomlTable):
    """Temperature of the sensors above that of their calibration."""

    ambient_offset_k: float = Field(default=0.0, ge=-100, le=100)
    """Ambient temperature relative to the calibration temperature."""
    warm_up_k: float = Field(default=0.0, ge=-100, le=100)
    """Temperature rise of the sensors after switch-on."""
    time_constant_s: float = Field(default=600.0, ge=0.001, le=100_000)
    """Time constant of the warm-up."""


class Altimeter(TomlTable):
    """A barometric altimeter; fitted if the table is present."""

    bias_m: float = Field(default=0.0, ge=-1000, le=1000)
    """Constant error."""
    noise_m: float = Field(default=0.0, ge=0, le=100)
    """Standard deviation."""
    random_walk_m_per_sqrt_h: float = Field(default=0.0, ge=0, le=100)
    """Random walk of the bias, by the weather."""


class Periodic(TomlTable):
    """A unit that measures at a rate, and sends what it measured some time later."""

    rate_hz: int
    latency_s: float

    def interval_epochs(self, rate_hz: int) -> int:
        """Return the epochs from one measurement to the next."""
        return round(rate_hz / self.rate_hz)

    def latency_epochs(self, rate_hz: int) -> int:
        """Return the epochs from a measurement to its frames, less than the interval."""
        return min(round(self.latency_s * rate_hz), self.interval_epochs(rate_hz) - 1)


class GnssReceiver(Periodic):
    """A GNSS receiver."""

    rate_hz: Annotated[int, Field(ge=1, le=10)] = 1
    """Fixes per second."""
    position_noise_m: float = Field(default=1.5, ge=0, le=40)
    """Standard deviation of each component."""
    velocity_noise_mps: float = Field(default=0.05, ge=0, le=10)
    """Standard deviation of each component."""
    position_correlated_noise_m: float = Field(default=0.0, ge=0, le=40)
    """Standard deviation of each component's time-correlated error."""
    position_correlation_s: float = Field(default=60.0, ge=0.1, le=100_000)
    """Its time constant."""
    latency_s: float = Field(default=0.1, ge=0, lt=1)
    """From the time of validity to the frames on the bus; less than the interval."""
    lever_arm_m: tuple[_Arm, _Arm, _Arm] = (0.0, 0.0, 0.0)
    """From the reference point to the antenna, in the body frame; the firmware knows it."""


class Odometer(Periodic):
    """An odometer; fitted if the table is present."""

    rate_hz: Annotated[int, Field(ge=1, le=50)] = 10
    """Counts per second."""
    pulse_mm: float = Field(default=2.0, ge=0.01, le=10_000)
    """Nominal distance per pulse, which the firmware uses."""
    scale_error_ppm: float = Field(default=0.0, ge=-100_000, le=100_000)
    """Scale error; positive if it counts too many pulses."""
    noise_mps: float = Field(default=0.02, ge=0, le=10)
    """Standard deviation of the mean speed over an interval while the wheel turns."""
    latency_s: float = Field(default=0.0, ge=0, le=0.5)
    """From the count to its frame; less than the interval."""
    mounting_heading_deg: float = Field(default=0.0, ge=-180, le=180)
    """Heading of the vehicle's forward axis in the body frame, clockwise."""
    mounting_pitch_deg: float = Field(default=0.0, ge=-30, le=30)
    """Its pitch, upwards."""
    lever_arm_m: tuple[_Arm, _Arm, _Arm] = (0.0, 0.0, 0.0)
    """From the reference point to where the wheel touches the ground, in the body frame."""
