"""Least squares of all constants of all sensors, with covariance.

Gauss-Newton over the sums of all seconds. The unknowns are five constants of each sensor, three
angles of the base and one of the axes; and, where the data sheets have them, the g-sensitivity of
each gyro and the wobble of the inner axis, of which is known before how large they may be. Each
sensor weighs by the scatter of its own residuals. The attitude that the computer is given is only
where the iteration begins. The covariance is that of white noise and of biases that wander.
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
    wobble_inputs,
)
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.calibration.wandering import first_rows, instability_of, wander_covariance
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
    #: of the inner axis: rms, rad, and periods in a turn
    wobble: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True)
class SensorsEstimate:
    """The constants of the m sensors of a kind.

    Attributes
    ----------
    constants, sigma : array, shape (m, 5)
        In the order of `CONSTANTS`, SI units.
    before, after : array, shape (n, m)
        What the sensors measured less what was expected with design constants, and with those
        found; the same base. rad/s or m/s²; NaN where a second does not count.
    """

    constants: Floats
    sigma: Floats
    before: Floats
    after: Floats
    noise: Floats  #: shape (m,); standard deviation of a sum over a second, rad/s or m/s²
    instability: Floats  #: shape (m,); bias instability that `sigma` is of, rad/s or m/s²


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
    information: Floats  #: shape (p, p); about the same, of white noise alone
    #: shape (m,); of the gyros, rad/s per m/s²; 0 where the data sheet has none
    g_sensitivity: Floats


class _Kind:
    """The sensors of a kind in the iteration."""

    def __init__(
        self,
        axes: Axes,
        sums: Floats,
        usable: NDArray[np.bool_],
        first: int,
        sheet: DataSheet | None = None,
    ) -> None:
        self.axes, self.sums, self.usable, self.first = axes, sums, usable, first
        self.sheet = sheet
        self.constants = np.zeros((len(axes), len(CONSTANTS)))
        self.noise = np.ones(len(axes))
        self.instability = np.zeros(len(axes))
        self.more = np.zeros(0)
        """Common unknowns besides the base: g-sensitivities, and both phases of the wobble."""
        self.by_more = np.zeros((*sums.shape, 0))

    def residuals(self, given: Inputs, duration_s: Floats) -> Floats:
        """Return the residuals of sums, zero where they do not count."""
        off = self.sums - predicted(self.axes, self.constants, given, duration_s)
        return np.where(self.usable, off - self.by_more @ self.more, 0.0)

    def columns(self, given: Inputs, duration_s: Floats, sensor: int) -> Floats:
        """Return the derivatives of a sensor's sums by its own and the common unknowns."""
        parts = derivatives(self.axes, self.constants, given, duration_s, sensor)
        found = np.hstack([*parts, self.by_more[:, sensor]])
        return np.where(self.usable[:, sensor, None], found, 0.0)

    def add(self, N: Floats, right: Floats, given: Inputs, duration_s: Floats) -> None:
        """Add normal equations: `N` (p, p), `right` (p,)."""
        off = self.residuals(given, duration_s)
        for k in range(len(self.axes)):
            J = self.columns(given, duration_s, k)
            J /= self.noise[k] * np.sqrt(duration_s)[:, None]
            place = self.place(k, len(right))
            N[np.ix_(place, place)] += J.T @ J
            right[place] += J.T @ (off[:, k] / (self.noise[k] * np.sqrt(duration_s)))

    def add_scatter(self, M: Floats, given: Inputs, duration_s: Floats) -> None:
        """Add the covariance of the right side of the normal equations, shape (p, p)."""
        off = np.where(self.usable, self.residuals(given, duration_s), np.nan) / duration_s[:, None]
        times, first = np.cumsum(duration_s), first_rows(len(duration_s))
        for k in range(len(self.axes)):
            J = self.columns(given, duration_s, k)
            change = np.diff(off[:, k])
            white = float(np.sqrt(0.5 * np.nanmean(change**2)))
            walk = 0.0 if self.sheet is None else self.sheet.rate_random_walk[k]
            stated = None if self.sheet is None else self.sheet.bias_instability[k]
            rates = J / duration_s[:, None]
            self.instability[k] = instability_of(off[:, k], white, rates, times, stated)
            place = self.place(k, len(M))
            weighed = J / (self.noise[k] * np.sqrt(duration_s)[:, None])
            sums = np.add.reduceat(J / self.noise[k] ** 2, first)
            C = wander_covariance(times[first], self.instability[k], walk)
            both = (white / self.noise[k]) ** 2 * weighed.T @ weighed + sums.T @ C @ sums
            M[np.ix_(place, place)] += both

    def place(self, sensor: int, total: int) -> NDArray[np.int_]:
        """Return where the unknowns of a sensor stand, and those of the base."""
        own = self.first + len(CONSTANTS) * sensor + np.arange(len(CONSTANTS))
        common = BASE + len(self.more)
        return np.concatenate([own, total - common + np.arange(common)])

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
    sheets = unit.sheets or (None, None)
    gyros = _Kind(unit.gyros, seconds.gyro, seconds.gyro_usable, 0, sheets[0])
    first = len(CONSTANTS) * len(unit.gyros)
    accelerometers = _Kind(
        unit.accelerometers, seconds.accelerometer, seconds.accelerometer_usable, first, sheets[1]
    )
    return gyros, accelerometers


def _prior(unit: Unit) -> Floats:
    """Return how large what is common besides the base may be: of each gyro, and both phases."""
    force = unit.sheets[0].force_sigma if unit.sheets is not None else 0.0
    gyros = [force] * len(unit.gyros) if force > 0.0 else []
    return np.array([*gyros, *([unit.wobble[0]] * 2 if unit.wobble[0] > 0.0 else [])])


def _by_more(
    unit: Unit, seconds: Seconds, C_b_n: Floats, force: Inputs, count: int
) -> tuple[Floats, Floats]:
    """Return the derivatives of the sums by what is common besides the base, (n, m, count)."""
    kinds = (unit.gyros, unit.accelerometers)
    gyro, accelerometer = (np.zeros((len(seconds), len(axes), count)) for axes in kinds)
    if unit.wobble[0] > 0.0:
        both = wobble_inputs(seconds, unit.site, C_b_n, unit.wobble[1])
        for found, axes, added in zip((gyro, accelerometer), kinds, both, strict=True):
            found[:, :, -2:] = np.einsum("mj,njk->nmk", axes.h, added)
    if count >= len(unit.gyros):
        along = force.x @ unit.gyros.h.T
        for k in range(len(unit.gyros)):
            gyro[:, k, k] += along[:, k]
    return gyro, accelerometer


def estimate(unit: Unit, seconds: Seconds) -> Estimate:
    """Return the constants that fit the seconds best.

    Raises
    ------
    CalibrationRecordError
        When the seconds do not show all constants.
    """
    T = seconds.duration_s
    kinds = _kinds(unit, seconds)
    prior = _prior(unit)
    scale = np.concatenate([scales(unit), prior])
    total = len(scale)
    first_common, last_common = len(scales(unit)) - BASE, len(scales(unit))
    known = np.zeros((total, total))
    known[last_common:, last_common:] = np.diag(1.0 / prior**2)
    C_b_n, epsilon, more = unit.C_b_n, 0.0, np.zeros(len(prior))

    def look() -> tuple[Inputs, Inputs]:
        given = inputs(seconds, unit.site, C_b_n, epsilon)
        by_more = _by_more(unit, seconds, C_b_n, given[1], len(prior))
        for kind, one, by in zip(kinds, given, by_more, strict=True):
            kind.more, kind.by_more = more, by
            kind.weigh(one, T)
        return given

    given = look()
    covariance, both_scales = np.zeros((total, total)), np.outer(scale, scale)
    for _ in range(_ITERATIONS):
        N, right = known.copy(), -known[:, last_common:] @ more
        for kind, one in zip(kinds, given, strict=True):
            kind.add(N, right, one, T)
        if len(_null_space(N, scale)):
            raise CalibrationRecordError(
                f"{seconds.total_s:.0f} s on the table do not show all constants; see "
                "`rrins scheme observability`"
            )
        covariance = np.asarray(np.linalg.inv(N * both_scales) * both_scales, dtype=np.float64)
        change = covariance @ right
        for kind in kinds:
            kind.step(change)
        C_b_n = C_b_n @ rotation(change[first_common : last_common - 1])
        epsilon += float(change[last_common - 1])
        more = more + change[last_common:]
        given = look()
        if np.abs(change / np.sqrt(np.diag(covariance))).max() < _CONVERGED:
            break
    M = known.copy()
    for kind, one in zip(kinds, given, strict=True):
        kind.add_scatter(M, one, T)
    unknowns = slice(0, last_common)
    whole = (covariance @ M @ covariance)[unknowns, unknowns]
    sigma = np.sqrt(np.diag(whole))
    found = [_sensors(kind, one, seconds, sigma) for kind, one in zip(kinds, given, strict=True)]
    g_sensitivity = np.zeros(len(unit.gyros))
    if len(more) >= len(unit.gyros):
        g_sensitivity = more[: len(unit.gyros)]
    return Estimate(
        gyros=found[0],
        accelerometers=found[1],
        C_b_n=C_b_n,
        base_sigma=sigma[-BASE:-1],
        epsilon=epsilon,
        epsilon_sigma=float(sigma[-1]),
        seconds=seconds,
        covariance=whole,
        information=np.asarray(np.linalg.inv(covariance[unknowns, unknowns]), dtype=np.float64),
        g_sensitivity=g_sensitivity,
    )


def _sensors(kind: _Kind, given: Inputs, seconds: Seconds, sigma: Floats) -> SensorsEstimate:
    T = seconds.duration_s
    after = np.where(kind.usable, kind.residuals(given, T), np.nan) / T[:, None]
    design = predicted(kind.axes, np.zeros_like(kind.constants), given, T)
    before = np.where(kind.usable, kind.sums - design, np.nan) / T[:, None]
    size = kind.constants.size
    own = sigma[kind.first : kind.first + size].reshape(kind.constants.shape)
    return SensorsEstimate(kind.constants, own, before, after, kind.noise, kind.instability)


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
