"""Least squares of all constants of all sensors, with covariance.

Gauss-Newton over the sums of all seconds. The unknowns are five constants of each sensor, three
angles of the base and one of the axes. Each sensor weighs by the scatter of its own residuals. The
attitude that the computer is given is only where the iteration begins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.firmware_py.core.sensors.data_sheet import DataSheet
from rrins.host_tools.calibration.model import (
    BASE,
    CONSTANTS,
    Axes,
    Inputs,
    Site,
    derivatives,
    inputs,
    predicted,
    rotation,
)
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.errors import CalibrationRecordError

_ITERATIONS = 12
_CONVERGED = 1e-3  # of the standard deviations
_SINGULAR = 1e-15  # of the largest eigenvalue, with unknowns in comparable units

GYRO_UNITS = np.array([DPH, PPM, PPM, ARCSEC, ARCSEC])
"""°/h, ppm, ppm, ″, ″ in SI units, in the order of `CONSTANTS`."""

ACCELEROMETER_UNITS = np.array([UG, PPM, PPM, ARCSEC, ARCSEC])
"""µg, ppm, ppm, ″, ″ in SI units."""


@dataclass(frozen=True)
class Unit:
    """Prior knowledge of a unit before its calibration."""

    gyros: Axes
    accelerometers: Axes
    site: Site
    C_b_n: Floats  #: shape (3, 3); attitude of the base, roughly: where the iteration begins
    sheets: tuple[DataSheet, DataSheet] | None = None  #: of gyros and accelerometers, if known


@dataclass(frozen=True)
class SensorsEstimate:
    """The constants of the m sensors of a kind.

    Attributes
    ----------
    constants, sigma : array, shape (m, 5)
        In the order of `CONSTANTS`, SI units; standard deviations of what noise makes of them.
    before, after : array, shape (n, m)
        What the sensors measured less what was expected with design constants, and with those
        found; the same base. rad/s or m/s²; NaN where a second does not count.
    """

    constants: Floats
    sigma: Floats
    before: Floats
    after: Floats
    noise: Floats  #: shape (m,); standard deviation of a sum over a second, rad/s or m/s²


@dataclass(frozen=True)
class Estimate:
    """A calibration.

    Attributes
    ----------
    epsilon, epsilon_sigma : float
        The inner axis out of square, rad.
    """

    gyros: SensorsEstimate
    accelerometers: SensorsEstimate
    C_b_n: Floats  #: shape (3, 3)
    base_sigma: Floats  #: shape (3,); of the base's attitude about x, y, z of b, rad
    epsilon: float
    epsilon_sigma: float
    seconds: Seconds  #: what it is of
    #: shape (p, p); constants of the gyros, of the accelerometers, then base and ε; SI units
    covariance: Floats


class _Kind:
    """The sensors of a kind in the iteration."""

    def __init__(self, axes: Axes, sums: Floats, usable: NDArray[np.bool_], first: int) -> None:
        self.axes, self.sums, self.usable, self.first = axes, sums, usable, first
        self.constants = np.zeros((len(axes), len(CONSTANTS)))
        self.noise = np.ones(len(axes))

    def residuals(self, given: Inputs, duration_s: Floats) -> Floats:
        """Return the residuals of sums, zero where they do not count."""
        off = self.sums - predicted(self.axes, self.constants, given, duration_s)
        return np.where(self.usable, off, 0.0)

    def add(self, N: Floats, right: Floats, given: Inputs, duration_s: Floats) -> None:
        """Add normal equations: `N` (p, p), `right` (p,)."""
        off = self.residuals(given, duration_s)
        for k in range(len(self.axes)):
            own, base = derivatives(self.axes, self.constants, given, duration_s, k)
            J = np.where(self.usable[:, k, None], np.hstack([own, base]), 0.0)
            J /= self.noise[k] * np.sqrt(duration_s)[:, None]
            place = self.place(k, len(right))
            N[np.ix_(place, place)] += J.T @ J
            right[place] += J.T @ (off[:, k] / (self.noise[k] * np.sqrt(duration_s)))

    def place(self, sensor: int, total: int) -> NDArray[np.int_]:
        """Return where the unknowns of a sensor stand, and those of the base."""
        own = self.first + len(CONSTANTS) * sensor + np.arange(len(CONSTANTS))
        return np.concatenate([own, total - BASE + np.arange(BASE)])

    def weigh(self, given: Inputs, duration_s: Floats) -> None:
        """Take each sensor's noise of a second, per root of its duration, from its residuals."""
        off = self.residuals(given, duration_s) / np.sqrt(duration_s)[:, None]
        count = np.maximum(1, self.usable.sum(axis=0) - len(CONSTANTS))
        least = 1e-15
        self.noise = np.maximum(np.sqrt((off**2).sum(axis=0) / count), least)

    def step(self, change: Floats) -> None:
        """Change the constants."""
        count = self.constants.size
        self.constants += change[self.first : self.first + count].reshape(self.constants.shape)


def scales(unit: Unit) -> Floats:
    """Return units in which all unknowns have comparable sizes, shape (p,), SI."""
    return np.concatenate(
        [
            np.tile(GYRO_UNITS, len(unit.gyros)),
            np.tile(ACCELEROMETER_UNITS, len(unit.accelerometers)),
            np.full(BASE, ARCSEC),
        ]
    )


def _null_space(N: Floats, scale: Floats) -> Floats:
    """Return the directions that normal equations do not see at all, shape (k, p), in `scale`."""
    values, vectors = np.linalg.eigh(N * np.outer(scale, scale))
    found: Floats = vectors[:, values < _SINGULAR * values[-1]].T
    return found


def _kinds(unit: Unit, seconds: Seconds) -> tuple[_Kind, _Kind]:
    gyros = _Kind(unit.gyros, seconds.gyro, seconds.gyro_usable, 0)
    first = len(CONSTANTS) * len(unit.gyros)
    accelerometers = _Kind(
        unit.accelerometers, seconds.accelerometer, seconds.accelerometer_usable, first
    )
    return gyros, accelerometers


def estimate(unit: Unit, seconds: Seconds) -> Estimate:
    """Return the constants that fit the seconds best.

    Raises
    ------
    CalibrationRecordError
        When the seconds do not show all constants.
    """
    T = seconds.duration_s
    kinds = _kinds(unit, seconds)
    scale = scales(unit)
    total = len(scale)
    C_b_n, epsilon = unit.C_b_n, 0.0
    given = inputs(seconds, unit.site, C_b_n, epsilon)
    for kind, one in zip(kinds, given, strict=True):
        kind.weigh(one, T)
    covariance = np.zeros((total, total))
    for _ in range(_ITERATIONS):
        N, right = np.zeros((total, total)), np.zeros(total)
        for kind, one in zip(kinds, given, strict=True):
            kind.add(N, right, one, T)
        if len(_null_space(N, scale)):
            raise CalibrationRecordError(
                f"{seconds.total_s:.0f} s on the table do not show all constants; see "
                "`rrins scheme observability`"
            )
        covariance = np.linalg.inv(N * np.outer(scale, scale)) * np.outer(scale, scale)
        change = covariance @ right
        for kind in kinds:
            kind.step(change)
        C_b_n = C_b_n @ rotation(change[-BASE:-1])
        epsilon += float(change[-1])
        given = inputs(seconds, unit.site, C_b_n, epsilon)
        for kind, one in zip(kinds, given, strict=True):
            kind.weigh(one, T)
        if np.abs(change / np.sqrt(np.diag(covariance))).max() < _CONVERGED:
            break
    sigma = np.sqrt(np.diag(covariance))
    found = [_sensors(kind, one, seconds, sigma) for kind, one in zip(kinds, given, strict=True)]
    return Estimate(
        gyros=found[0],
        accelerometers=found[1],
        C_b_n=C_b_n,
        base_sigma=sigma[-BASE:-1],
        epsilon=epsilon,
        epsilon_sigma=float(sigma[-1]),
        seconds=seconds,
        covariance=covariance,
    )


def _sensors(kind: _Kind, given: Inputs, seconds: Seconds, sigma: Floats) -> SensorsEstimate:
    T = seconds.duration_s
    after = np.where(kind.usable, kind.residuals(given, T), np.nan) / T[:, None]
    design = predicted(kind.axes, np.zeros_like(kind.constants), given, T)
    before = np.where(kind.usable, kind.sums - design, np.nan) / T[:, None]
    size = kind.constants.size
    own = sigma[kind.first : kind.first + size].reshape(kind.constants.shape)
    return SensorsEstimate(kind.constants, own, before, after, kind.noise)


def normal_equations(
    unit: Unit, seconds: Seconds, gyro_noise: Floats, accelerometer_noise: Floats
) -> Floats:
    """Return the information of seconds about all unknowns, shape (p, p), without measurements.

    Parameters
    ----------
    seconds : Seconds
        Of which only the table's motion counts.
    gyro_noise, accelerometer_noise : array, shapes (m,), (k,)
        Of a sum over a second, rad and m/s.
    """
    kinds = _kinds(unit, seconds)
    total = len(scales(unit))
    N, right = np.zeros((total, total)), np.zeros(total)
    given = inputs(seconds, unit.site, unit.C_b_n, 0.0)
    for kind, one, noise in zip(kinds, given, (gyro_noise, accelerometer_noise), strict=True):
        kind.noise = noise
        kind.add(N, right, one, seconds.duration_s)
    return N
