"""Horizontal velocity error that a RIMU's errors cause while a scheme runs.

The running integral of an accelerometer error is a velocity error. That of a gyro error is a tilt,
and the integral of the tilt times g is a velocity error. Both start from zero at the beginning of
the cycle. All errors of all sensors are treated as independent, so their mean squares add. The
Earth's rate and the Schuler oscillation are neglected, so this holds for times short compared with
84 min; heading and height are too, as they do not affect the horizontal velocity at rest.

Within a leg the velocity error is ``A + B t + s(t)``: A and B come from the preceding legs, s from
the leg alone. Three moments of s yield the exact mean square for any A and B, so a leg that occurs
in many schemes is integrated only once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.rotation.analysis import (
    SPECIFIC_FORCE_B,
    earth_rate_b,
    grid_of,
    rates_at,
    running_integral,
)
from rrins.host_tools.rotation.errors import Sensors
from rrins.host_tools.rotation.kinematics import Leg, legs_of


@dataclass(frozen=True)
class SensorSet:
    """The sensors of both kinds, and their latitude.

    `earth_latitude_deg` as in `rrins.host_tools.rotation.analysis.analyse`.
    """

    gyros: Sensors
    accelerometers: Sensors
    earth_latitude_deg: float | None = None

    @property
    def felt_by(self) -> list[tuple[Sensors, Floats]]:
        """Sensors of each kind with their input apart from the rotation."""
        earth = earth_rate_b(self.earth_latitude_deg)
        return [(self.gyros, earth), (self.accelerometers, SPECIFIC_FORCE_B)]


@dataclass(frozen=True)
class Moments:
    """The velocity error s(t) due to one leg alone; arrays have shape (channels,).

    A channel is one error of one sensor on one horizontal axis of the body.

    Attributes
    ----------
    sum_s, sum_ts, sum_ss : array
        Integrals of s, t s and s² over the leg.
    """

    duration_s: float
    step: Floats  #: s at the end, m/s
    slope: Floats  #: change of the slope of the velocity error over the leg, m/s²
    sum_s: Floats
    sum_ts: Floats
    sum_ss: Floats


@dataclass(frozen=True)
class VelocityError:
    """Horizontal velocity error of a cycle, for all errors of all sensors."""

    rms_mps: float  #: root of the mean square over the first cycle
    growth_mps_per_h: float  #: residual error of the cycle, per hour


def velocity_error(scheme: Scheme, rimu: SensorSet) -> VelocityError:
    """Return the horizontal velocity error over the first cycle of a scheme."""
    legs = legs_of(scheme)
    moments = [leg_moments(leg, rimu) for leg in legs]
    count = len(moments[0].step) if moments else 0
    velocity, slope, square = np.zeros(count), np.zeros(count), np.zeros(count)
    for leg in moments:
        square += sum_of_squares(velocity, slope, leg)
        velocity = velocity + slope * leg.duration_s + leg.step
        slope = slope + leg.slope
    duration_s = sum(leg.duration_s for leg in legs)
    return VelocityError(
        rms_mps=float(np.sqrt(square.sum() / duration_s)) if legs else 0.0,
        growth_mps_per_h=float(np.linalg.norm(velocity)) / duration_s * 3600 if legs else 0.0,
    )


def sum_of_squares(velocity: Floats, slope: Floats, leg: Moments) -> Floats:
    """Return the integral of the squared velocity error over a leg, per channel.

    `velocity` and `slope` are the values at its beginning, shape (..., channels).
    """
    t = leg.duration_s
    squares: Floats = (
        velocity**2 * t
        + velocity * slope * t**2
        + slope**2 * (t**3 / 3)
        + 2 * velocity * leg.sum_s
        + 2 * slope * leg.sum_ts
        + leg.sum_ss
    )
    return squares


def leg_moments(leg: Leg, rimu: SensorSet) -> Moments:
    """Return the contribution of one leg to the horizontal velocity error."""
    grid = grid_of(leg, rimu.felt_by)
    parts = []
    for sensors, field_b in rimu.felt_by:
        rate = _horizontal(rates_at(leg, sensors, field_b, grid))
        integral = _horizontal(running_integral(leg, sensors, field_b, grid))
        if sensors.kind == "gyro":
            rate, integral = STANDARD_GRAVITY * rate, STANDARD_GRAVITY * integral
            parts.append((_integrate(integral, rate, grid), integral, integral[-1]))
        else:
            parts.append((integral, rate, np.zeros(integral.shape[1])))
    s = np.concatenate([part[0] for part in parts], axis=1)
    rate = np.concatenate([part[1] for part in parts], axis=1)
    t = grid[:, None]
    return Moments(
        duration_s=leg.duration_s,
        step=s[-1],
        slope=np.concatenate([part[2] for part in parts]),
        sum_s=_integrate(s, rate, grid)[-1],
        sum_ts=_integrate(t * s, s + t * rate, grid)[-1],
        sum_ss=_integrate(s**2, 2 * s * rate, grid)[-1],
    )


def _horizontal(values: Floats) -> Floats:
    """Return x and y of every error of every sensor as columns, shape (n, channels)."""
    return values[..., :2].reshape(len(values), -1)


def _integrate(values: Floats, rate: Floats, grid: Floats) -> Floats:
    """Return the running integral from values and rates at the interval ends (fourth order)."""
    width = np.diff(grid)[:, None]
    pieces = width / 2 * (values[:-1] + values[1:]) + width**2 / 12 * (rate[:-1] - rate[1:])
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])
