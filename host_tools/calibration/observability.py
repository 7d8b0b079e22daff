"""Observability of the constants with a scheme: standard deviations, and unseen directions.

Linear covariance analysis: the information of a cycle about all unknowns, with the sensors' white
noise. A direction of which nothing is known yet has a standard deviation from before, `PRIOR`:
1000 °/h, 100 mg, 1 %, 1° are as good as nothing, and keep the matrix regular.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import UG
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import Unit, normal_equations, scales
from rrins.host_tools.calibration.ideal import seconds_of
from rrins.host_tools.calibration.model import BASE, CONSTANTS

PRIOR = np.array([1000.0, 1e4, 1e4, 3600.0, 3600.0])
"""Of the constants, in their units: °/h (accelerometers 100 mg), ppm, ppm, ″, ″."""

_PRIOR_UG = 1e5
_PRIOR_BASE_ARCSEC = 10 * 3600.0

UNCALIBRATED = np.array([10.0, 50.0, 50.0, 30.0, 30.0])
"""Errors of sensors before a calibration, in the units of `PRIOR`; accelerometers 3 mg."""

_UNCALIBRATED_UG = 3000.0
_UNCALIBRATED_BASE_ARCSEC = 3600.0
_UNSEEN = 0.5
"""A direction is not seen if a scheme leaves this share of what uncalibrated sensors have."""

LIMITS = (np.array([0.012, 2.2, 4.5, 0.6, 0.6]), np.array([0.8, 0.8, 1.2, 0.25, 0.2]))
"""To be reached by a calibration of half an hour with the prototype's noise; °/h or µg, ppm, ppm,
″, ″; root mean squares over the sensors."""

MARK = " !"
"""Behind what is beyond its limit."""

DEG_PER_SQRT_H = math.radians(1.0) / 60.0
"""rad/√s of a °/√h: the noise of a second."""


@dataclass(frozen=True)
class Direction:
    """A combination of unknowns that a scheme does not show."""

    #: share of what uncalibrated sensors have in it that is left; 1: nothing is gained
    sigma: float
    #: the unknowns with the largest shares: name, share of the direction's square
    parts: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Observability:
    """Observability with a scheme.

    Attributes
    ----------
    gyro_sigma, accelerometer_sigma : array, shapes (m, 5), (k, 5)
        °/h or µg, ppm, ppm, ″, ″; as `CONSTANTS` are ordered.
    """

    gyro_sigma: Floats
    accelerometer_sigma: Floats
    base_sigma: Floats  #: shape (4,); base about x, y, z of b and the axes' squareness, ″
    unseen: tuple[Direction, ...]
    duration_s: float

    @property
    def rms(self) -> tuple[Floats, Floats]:
        """Root mean squares over gyros and over accelerometers, shape (5,) each."""
        both = (self.gyro_sigma, self.accelerometer_sigma)
        gyros, accelerometers = (np.sqrt((sigma**2).mean(axis=0)) for sigma in both)
        return gyros, accelerometers


def names_of(unit: Unit) -> list[str]:
    """Return the names of all unknowns, in order."""
    words = ("bias", "λ", "μ", "δu", "δv")
    assert len(words) == len(CONSTANTS)
    found = [
        f"{word} of {kind} {k + 1}"
        for kind, axes in (("gyro", unit.gyros), ("accelerometer", unit.accelerometers))
        for k in range(len(axes))
        for word in words
    ]
    return [*found, "base about x", "base about y", "base about z", "axes' squareness"]


def noise_of(unit: Unit, gyro: float, accelerometer: float) -> tuple[Floats, Floats]:
    """Return the noise of a second for °/√h and µg/√Hz; rad and m/s."""
    return (
        np.full(len(unit.gyros), gyro * DEG_PER_SQRT_H),
        np.full(len(unit.accelerometers), accelerometer * UG),
    )


def prior_of(unit: Unit) -> Floats:
    """Return what is known from before, as standard deviations in units of `scales`."""
    return _of_all(unit, PRIOR, _PRIOR_UG, _PRIOR_BASE_ARCSEC)


def _of_all(unit: Unit, constants: Floats, ug: float, base_arcsec: float) -> Floats:
    accelerometers = constants.copy()
    accelerometers[0] = ug
    return np.concatenate(
        [
            np.tile(constants, len(unit.gyros)),
            np.tile(accelerometers, len(unit.accelerometers)),
            np.full(BASE, base_arcsec),
        ]
    )


def of_information(unit: Unit, N: Floats, duration_s: float) -> Observability:
    """Return what information shows, shape (p, p), SI units."""
    scale, prior = scales(unit), prior_of(unit)
    left = np.linalg.inv(N * np.outer(scale * prior, scale * prior) + np.eye(len(scale)))
    sigma = np.sqrt(np.diag(left)) * prior
    gyros = len(CONSTANTS) * len(unit.gyros)
    return Observability(
        gyro_sigma=sigma[:gyros].reshape(-1, len(CONSTANTS)),
        accelerometer_sigma=sigma[gyros:-BASE].reshape(-1, len(CONSTANTS)),
        base_sigma=sigma[-BASE:],
        unseen=unseen(unit, N),
        duration_s=duration_s,
    )


def unseen(unit: Unit, N: Floats) -> tuple[Direction, ...]:
    """Return the directions of which information shows little, shape (p, p), SI units."""
    before = _of_all(unit, UNCALIBRATED, _UNCALIBRATED_UG, _UNCALIBRATED_BASE_ARCSEC)
    weight = scales(unit) * before
    values, vectors = np.linalg.eigh(N * np.outer(weight, weight) + np.eye(len(weight)))
    return tuple(
        _direction(unit, 1.0 / math.sqrt(value), vector)
        for value, vector in zip(values, vectors.T, strict=True)
        if value < 1.0 / _UNSEEN**2
    )


def _direction(unit: Unit, sigma: float, vector: Floats) -> Direction:
    names = names_of(unit)
    order = np.argsort(-(vector**2))[:4]
    parts = tuple((names[k], float(vector[k] ** 2)) for k in order if vector[k] ** 2 > 0.03)
    return Direction(sigma, parts)


def observe(
    scheme: Scheme, unit: Unit, gyro_noise: float = 0.005, accelerometer_noise: float = 10.0
) -> Observability:
    """Return what one cycle of a scheme shows of the constants of a unit at rest.

    Parameters
    ----------
    gyro_noise, accelerometer_noise : float
        White noise, °/√h and µg/√Hz; the prototype's by default.
    """
    seconds = seconds_of(scheme, len(unit.gyros), len(unit.accelerometers))
    noise = noise_of(unit, gyro_noise, accelerometer_noise)
    return of_information(unit, normal_equations(unit, seconds, *noise), seconds.total_s)
