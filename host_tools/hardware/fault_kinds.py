"""Kinds of fault of the hardware, one entry each: where it acts, what it does, its parameter.

The scenario's tables, `rrins inject`, the dashboard's form, the value tables of the DBC and the
page `docs/faults.md` follow from the entries. `rrins.host_tools.hardware.faults` has the effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, Self

from rrins.host_tools.hardware.units import ARCSEC, DEG_PER_SQRT_H, DPH, PPM, UG


@dataclass(frozen=True)
class Parameter:
    """The parameter of a kind of fault.

    Attributes
    ----------
    minimum, maximum : float
        In the unit of the key.
    """

    key: str  #: its name in a scenario, with the unit
    unit: str  #: that unit, as shown to people
    default: float | None
    minimum: float
    maximum: float
    si: float = 1.0  #: that unit in SI units; an angle of an encoder stays in degrees
    is_whole: bool = False


AIDS: Final = ("gnss", "odometer", "altimeter")


class Part(IntEnum):
    """Part that fails."""

    AXIS = 0
    GYRO = 1
    ACCELEROMETER = 2
    ODOMETER = 3
    GNSS = 4
    GNSS_POSITION = 5
    ALTIMETER = 6

    @property
    def aid(self) -> str:
        """The table of a scenario that fits it; empty for a part of the RIMU."""
        name = self.name.partition("_")[0].lower()
        return name if name in AIDS else ""


@dataclass(frozen=True)
class Target:
    """The key of a scenario that says which axis, sensor or direction of a part fails."""

    key: str
    names: tuple[str, ...] = ()  #: its values; empty for a number, from 1
    default: str | None = None  #: None for all sensors
    is_needed: bool = False  #: whether there is no default


_SENSOR = Target("sensor")

TARGETS: Final[Mapping[Part, Target]] = {
    Part.AXIS: Target("axis", ("inner", "outer"), is_needed=True),
    Part.GYRO: _SENSOR,
    Part.ACCELEROMETER: _SENSOR,
    Part.GNSS_POSITION: Target("direction", ("east", "north", "up"), "east"),
}
"""By part; the others are one thing."""

EVERY = -1
"""Index of a target that means all sensors, or what is one thing."""


class NumberedKind(IntEnum):
    """A table of kinds; the number of each on the bus is its place in the table, from 1."""

    effect: str
    """In words, for the help page."""
    parameter: Parameter | None

    def __new__(cls, *entry: Any) -> Self:
        """Return the next kind: its part for the hardware, its effect, its parameter if any."""
        number = len(cls.__members__) + 1
        kind = int.__new__(cls, number)
        kind._value_ = number
        kind._describe(*entry)
        return kind

    def _describe(self, effect: str, *parameter: Any) -> None:
        self.effect = effect
        self.parameter = Parameter(*parameter) if parameter else None

    @property
    def word(self) -> str:
        """Its name in a scenario."""
        return self.name.lower()


_AXIS, _GYRO, _ACCELEROMETER, _ODOMETER, _GNSS, _POSITION, _ALTIMETER = Part
_SCALE = ("scale_ppm", "ppm", 10_000.0, -1e6, 1e6, PPM)
_SHIFT = ("shift_arcsec", "″", 60.0, -3600, 3600, ARCSEC)
_REPEATS = "the sensor repeats the last increment"
_BIAS, _RAMP, _NOISE = "additional bias", "a bias that grows from zero", "additional white noise"
_SCALES = "error of the scale factor"
_TURNS_U, _TURNS_V = "the mount turns, by δu", "the mount turns, by δv"
_DEAD, _END = "the sensor reads zero", "the end of the range, flagged"
_ABSENT = "the sensor is flagged as absent"


class HardwareFault(NumberedKind):
    """The kinds, as `kind` of HARDWARE_FAULT_COMMAND; append new ones.

    A kind of accelerometers acts as the kind of gyros of the same name.
    """

    part: Part

    # Part, effect; key, unit, default, minimum, maximum and SI unit of the parameter.
    # fmt: off
    AXIS_STALL = _AXIS, "an axis stops"
    AXIS_RUNAWAY = (_AXIS, "an axis turns, whatever the command",
        "rate_dps", "°/s", 5.0, -60, 60, math.radians(1))
    ENCODER_STUCK = _AXIS, "the encoder repeats the last angle"
    ENCODER_OFFSET = _AXIS, "the encoder reads too high", "offset_deg", "°", 1.0, -180, 180
    GYRO_STUCK = _GYRO, _REPEATS
    GYRO_BIAS = _GYRO, _BIAS, "bias_dph", "°/h", 10.0, -1e6, 1e6, DPH
    GYRO_NOISE = (_GYRO, _NOISE,
        "angle_random_walk_deg_per_sqrt_h", "°/√h", 1.0, 0, 1e4, DEG_PER_SQRT_H)
    GYRO_ABSENT = _GYRO, _ABSENT
    ACCELEROMETER_STUCK = _ACCELEROMETER, _REPEATS
    ACCELEROMETER_BIAS = _ACCELEROMETER, _BIAS, "bias_ug", "µg", 1000.0, -1e7, 1e7, UG
    ACCELEROMETER_NOISE = (_ACCELEROMETER, _NOISE,
        "white_noise_ug_per_sqrt_hz", "µg/√Hz", 1000.0, 0, 1e6, UG)
    ACCELEROMETER_ABSENT = _ACCELEROMETER, _ABSENT
    GYRO_RAMP = _GYRO, _RAMP, "bias_dph_per_min", "°/h per minute", 1.0, -1e6, 1e6, DPH / 60
    GYRO_SCALE = _GYRO, _SCALES, *_SCALE
    GYRO_SHIFT_U = _GYRO, _TURNS_U, *_SHIFT
    GYRO_SHIFT_V = _GYRO, _TURNS_V, *_SHIFT
    GYRO_DEAD = _GYRO, _DEAD
    GYRO_FULL_SCALE = _GYRO, _END
    ACCELEROMETER_RAMP = (_ACCELEROMETER, _RAMP,
        "bias_ug_per_min", "µg per minute", 100.0, -1e7, 1e7, UG / 60)
    ACCELEROMETER_SCALE = _ACCELEROMETER, _SCALES, *_SCALE
    ACCELEROMETER_SHIFT_U = _ACCELEROMETER, _TURNS_U, *_SHIFT
    ACCELEROMETER_SHIFT_V = _ACCELEROMETER, _TURNS_V, *_SHIFT
    ACCELEROMETER_DEAD = _ACCELEROMETER, _DEAD
    ACCELEROMETER_FULL_SCALE = _ACCELEROMETER, _END
    ENCODER_SLIP = (_AXIS, "the encoder misses a share of each turn",
        "slip_percent", "%", 1.0, -100, 100, 0.01)
    ODOMETER_SLIP = (_ODOMETER, "the wheel turns more than the vehicle moves",
        "slip_percent", "%", 10.0, -100, 1000, 0.01)
    ODOMETER_LOCK = _ODOMETER, "the wheel stands, whatever the vehicle does"
    ODOMETER_LOST = _ODOMETER, "the odometer does not count, and says so"
    GNSS_JUMP = _POSITION, "positions are off", "jump_m", "m", 100.0, -1e5, 1e5
    GNSS_PULL = (_POSITION, "positions are led away, and velocities with them",
        "pull_mps", "m/s", 1.0, -100, 100)
    GNSS_LOST = _GNSS, "the receiver has no fix"
    ALTIMETER_JUMP = _ALTIMETER, "heights are off", "jump_m", "m", 100.0, -1e5, 1e5
    ALTIMETER_PULL = _ALTIMETER, "heights drift away", "pull_mps", "m/s", 1.0, -100, 100
    # fmt: on

    def _describe(self, part: Any, *entry: Any) -> None:
        self.part = part
        super()._describe(*entry)

    @property
    def target(self) -> Target | None:
        """The key that says which of its parts fails; None for a part that is one thing."""
        return TARGETS.get(self.part)
