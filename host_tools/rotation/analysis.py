"""Integrates the errors of a RIMU over one cycle of a scheme, numerically.

Each leg is split into short intervals and wherever a sensor's input changes sign; over each
interval Gauss-Legendre quadrature is exact to rounding. Extrema of the running integrals inside an
interval are located as well, so the largest excursion does not depend on the step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.hardware.earth import ROTATION_RATE
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.rotation import closed_form, harmonics
from rrins.host_tools.rotation.errors import ERRORS, Kind, Sensors, error_rates
from rrins.host_tools.rotation.kinematics import (
    INNER,
    OUTER,
    Leg,
    angles_at,
    attitude,
    cos_sin,
    legs_of,
    table_rate_s,
)

SPECIFIC_FORCE_B: Final = np.array([0.0, 0.0, STANDARD_GRAVITY])
"""m/s², in a level body at rest."""

VANISHES: Final = 1e-9
"""A residual below this share of the error's largest excursion counts as zero."""

_ROUNDING = 1e-13
"""An axis whose excursion is below this share of the largest axis's counts as unaffected."""
_STEP_DEG = 2.0
_LEAST_INTERVALS = 16
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class ResidualRow:
    """Residual of one error of one sensor on one body axis after a cycle.

    Attributes
    ----------
    residual, closed_form : float
        Integral over the cycle, computed numerically and by antiderivatives.
    """

    sensor_kind: Kind
    sensor: int  #: from 1
    error: str  #: "bias", "MESSF", "MEASF" or "MEIE"
    axis: str  #: of the body
    unit: str  #: unit of the three values: "rad" or "m/s"
    residual: float
    closed_form: float
    excursion: float  #: largest magnitude of the running integral within the cycle
    #: whether the residual is below `VANISHES` times the largest excursion of this error over the
    #: three axes. True for an error that is zero throughout the cycle.
    vanishes: bool


@dataclass(frozen=True)
class Integrals:
    """The errors of the sensors of one kind over a cycle.

    Attributes
    ----------
    residual, excursion, closed_form : array, shape (m, 4, 3)
        As in `ResidualRow`.
    """

    sensors: Sensors
    #: shape (k, m, 4, 3); integral from the beginning up to the times of `Variation.time_s`, rad or
    #: m/s.
    running: Floats
    residual: Floats
    excursion: Floats
    closed_form: Floats

    @property
    def vanishes(self) -> NDArray[np.bool_]:
        """Whether each residual counts as zero, shape (m, 4, 3)."""
        largest = self.excursion.max(axis=-1, keepdims=True)
        vanishes: NDArray[np.bool_] = np.abs(self.residual) <= VANISHES * largest
        return vanishes

    def residual_rows(self) -> Iterator[ResidualRow]:
        """Return a row for every sensor, error and axis."""
        vanishes = self.vanishes
        for i in range(len(self.sensors)):
            for k, error in enumerate(ERRORS):
                for j, axis in enumerate("xyz"):
                    yield ResidualRow(
                        sensor_kind=self.sensors.kind,
                        sensor=i + 1,
                        error=error,
                        axis=axis,
                        unit=self.sensors.unit,
                        residual=float(self.residual[i, k, j]),
                        closed_form=float(self.closed_form[i, k, j]),
                        excursion=float(self.excursion[i, k, j]),
                        vanishes=bool(vanishes[i, k, j]),
                    )


@dataclass(frozen=True)
class Variation:
    """Evolution of a RIMU's errors over one cycle of a scheme.

    Attributes
    ----------
    inner_deg, outer_deg : array, shape (k,)
    gyros, accelerometers : Integrals
    """

    scheme: Scheme
    legs: tuple[Leg, ...]
    #: shape (k,); time since the beginning of the cycle: the ends of all intervals, not equally
    #: spaced
    time_s: Floats
    inner_deg: Floats
    outer_deg: Floats
    gyros: Integrals
    accelerometers: Integrals

    def residual_rows(self) -> list[ResidualRow]:
        """Return a row for every sensor of both kinds, error and axis."""
        return [*self.gyros.residual_rows(), *self.accelerometers.residual_rows()]


def analyse(
    scheme: Scheme,
    gyros: Sensors,
    accelerometers: Sensors,
    *,
    earth_latitude_deg: float | None = None,
) -> Variation:
    """Return the integral of each constant error over one cycle, on each body axis.

    The body is level and at rest; accelerometers sense standard gravity upwards. The table turns at
    its constant rate, without ramps.

    Parameters
    ----------
    scheme : Scheme
    gyros, accelerometers : Sensors
        See `rrins.host_tools.rotation.errors.sensors_of`.
    earth_latitude_deg : float, optional
        Adds the Earth's rate at this latitude to the gyro inputs, with the body's y axis pointing
        north. By default the gyros sense only the table, as in the paper (section 2.2.2).
    """
    legs = legs_of(scheme)
    fields = (earth_rate_b(earth_latitude_deg), SPECIFIC_FORCE_B)
    both = (gyros, accelerometers)
    grids = [grid_of(leg, list(zip(both, fields, strict=True))) for leg in legs]
    starts = np.cumsum([0.0, *(leg.duration_s for leg in legs)])
    time_s = [np.zeros(1)]
    angles = [np.zeros((1, 2))]
    for leg, grid, start in zip(legs, grids, starts, strict=False):
        time_s.append(start + grid[1:])
        angles.append(np.stack(angles_at(leg, grid[1:]), axis=-1))
    inner_deg, outer_deg = np.concatenate(angles).T
    integrals = [
        _integrals(legs, grids, sensors, field) for sensors, field in zip(both, fields, strict=True)
    ]
    return Variation(
        scheme, legs, np.concatenate(time_s), inner_deg, outer_deg, integrals[0], integrals[1]
    )


def earth_rate_b(latitude_deg: float | None) -> Floats:
    """Return the Earth's rate in a level body with y pointing north, rad/s; zeros for None."""
    if latitude_deg is None:
        return np.zeros(3)
    cosine, sine = cos_sin(latitude_deg)
    return ROTATION_RATE * np.array([0.0, float(cosine), float(sine)])


def felt_s(
    leg: Leg, sensors: Sensors, field_b: Floats, inner_deg: Floats, outer_deg: Floats
) -> tuple[Floats, Floats]:
    """Return ``C_s_b`` and the sensor-frame input at angles along a leg.

    Returns
    -------
    C_s_b : array, shape (n, 3, 3)
    felt : array, shape (n, 3)
        ω^s in rad/s or f^s in m/s².
    """
    C_s_b = attitude(inner_deg, outer_deg)
    felt = field_b @ C_s_b
    if sensors.kind == "gyro":
        felt = felt + table_rate_s(leg, inner_deg)
    return C_s_b, felt


def rates_at(leg: Leg, sensors: Sensors, field_b: Floats, time_s: Floats) -> Floats:
    """Return the rates of all errors in the body frame, shape (n, m, 4, 3)."""
    return error_rates(sensors, *felt_s(leg, sensors, field_b, *angles_at(leg, time_s)))


def grid_of(leg: Leg, felt_by: list[tuple[Sensors, Floats]]) -> Floats:
    """Return the ends of the leg's intervals, s since its beginning.

    `felt_by` pairs sensors with their input apart from the rotation, constant in the body frame.
    """
    if leg.axis is None:
        return np.linspace(0.0, leg.duration_s, _LEAST_INTERVALS + 1)
    count = max(_LEAST_INTERVALS, round(abs(leg.turn_deg) / _STEP_DEG))
    grid = np.linspace(0.0, leg.duration_s, count + 1)
    crossings = [_crossings(leg, sensors, field) for sensors, field in felt_by]
    return np.unique(np.concatenate([grid, *crossings]))


def _crossings(leg: Leg, sensors: Sensors, field_b: Floats) -> Floats:
    """Return when the sensor inputs change sign, s since the leg's beginning."""
    assert leg.axis is not None
    start, end = leg.start_deg[leg.axis], leg.end_deg[leg.axis]
    # Three angles determine a harmonic: 0°, 90° and 180° of the turning axis.
    turning = np.array([0.0, 90.0, 180.0])
    inner_deg, outer_deg = (
        turning if leg.axis == axis else np.full(3, leg.start_deg[axis]) for axis in (INNER, OUTER)
    )
    _, felt = felt_s(leg, sensors, field_b, inner_deg, outer_deg)
    at_0, at_90, at_180 = felt @ sensors.H.T
    harmonic = np.stack([(at_0 + at_180) / 2, (at_0 - at_180) / 2, at_90 - (at_0 + at_180) / 2])
    found = [angle for f in harmonic.T for angle in harmonics.zeros(f, start, end)]
    return (np.array(found) - start) / leg.turn_deg * leg.duration_s


def _integrals(
    legs: tuple[Leg, ...], grids: list[Floats], sensors: Sensors, field_b: Floats
) -> Integrals:
    shape = (len(sensors), len(ERRORS), 3)
    running = [np.zeros((1, *shape))]
    excursion = np.zeros(shape)
    for leg, grid in zip(legs, grids, strict=True):
        so_far = running_integral(leg, sensors, field_b, grid) + running[-1][-1]
        excursion = np.maximum(excursion, _largest(leg, sensors, field_b, grid, so_far))
        running.append(so_far[1:])
    moves = excursion > _ROUNDING * excursion.max(axis=-1, keepdims=True)
    whole = np.concatenate(running) * moves
    return Integrals(
        sensors=sensors,
        running=whole,
        residual=whole[-1],
        excursion=excursion * moves,
        closed_form=closed_form.cycle_integral(legs, sensors, field_b),
    )


def running_integral(leg: Leg, sensors: Sensors, field_b: Floats, grid: Floats) -> Floats:
    """Return the running integrals at times since the leg's beginning, s.

    Shape (n, m, 4, 3). Exact to rounding if no input changes sign within an interval and no
    interval exceeds about 10° of rotation.
    """
    width = np.diff(grid)
    nodes = grid[:-1, None] + width[:, None] * (_NODES + 1) / 2
    rates = rates_at(leg, sensors, field_b, nodes.ravel())
    rates = rates.reshape(*nodes.shape, *rates.shape[1:])
    pieces = np.einsum("ig,ig...->i...", width[:, None] * _WEIGHTS / 2, rates)
    return np.concatenate([np.zeros((1, *pieces.shape[1:])), np.cumsum(pieces, axis=0)])


def _largest(leg: Leg, sensors: Sensors, field_b: Floats, grid: Floats, so_far: Floats) -> Floats:
    """Return the largest magnitudes of running integrals, including those between grid points.

    If the rate changes sign within an interval, the cubic Hermite interpolant is evaluated at the
    zero of the rate; its error is of fourth order in the step.
    """
    rates = rates_at(leg, sensors, field_b, grid)
    before, after = rates[:-1], rates[1:]
    turns = before * after < 0
    share = np.where(turns, before / np.where(turns, before - after, 1.0), 0.0)
    width = np.diff(grid)[:, None, None, None]
    low, high = so_far[:-1], so_far[1:]
    rest = 1 - share
    between = (
        low * rest**2 * (1 + 2 * share)
        + high * share**2 * (3 - 2 * share)
        + width * share * rest * (before * rest - after * share)
    )
    largest: Floats = np.maximum(np.abs(so_far).max(axis=0), np.abs(between * turns).max(axis=0))
    return largest
