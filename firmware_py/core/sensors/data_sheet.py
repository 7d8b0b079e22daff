"""Data sheet of the sensors, for the redundancy and for the estimator."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict

from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.sensors.calibration import ARCSEC, PPM

FLICKER_S = 1000.0
"""Time in which bias instability is taken to walk by its own size."""

SCALE_TURN = 0.5 * math.pi
"""Turn, rad, over which a wrong scale factor adds up before another sensor takes over."""


class DataSheet(BaseModel):
    """Data sheet of the sensors of a kind, in SI units, per sensor or for all.

    Attributes
    ----------
    white_noise : tuple of float
        rad/√s or m/s/√s.
    bias_instability, temperature_drift : tuple of float
        rad/s or m/s²; the second is the drift over all temperatures to expect.
    rate_random_walk : tuple of float
        rad/s/√s or m/s²/√s.
    bias_limit : float
        rad/s or m/s².
    scale_limit, installation_limit, asymmetry_limit : float
        1, rad, 1.
    force_limit : float
        rad/s per m/s², of gyros.
    temperature_s : float
        Time constant of the temperature.
    bias_sigma : float, optional
        rad/s or m/s², standard deviation of what the bias of a sound sensor is at any time; a third
        of the limit by default.
    slope_sigma : float
        Standard deviation of scale factor and installation errors together.
    scale_sigma, asymmetry_sigma, installation_sigma : float
        1, 1, rad: standard deviation of each.
    force_sigma : float
        rad/s per m/s², of gyros: standard deviation.
    resolution : float
        rad or m/s: the sensor's own step, if it is coarser than that of the frames.
    scale_stability : float
        1, standard deviation of what a scale factor changes by from one power-up to the next, and
        over 10 K.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    white_noise: tuple[float, ...]
    bias_instability: tuple[float, ...]
    rate_random_walk: tuple[float, ...]
    temperature_drift: tuple[float, ...]
    temperature_s: float = 600.0
    bias_limit: float
    scale_limit: float = 100 * PPM
    installation_limit: float = 30 * ARCSEC
    asymmetry_limit: float = 50 * PPM
    force_limit: float = 0.0
    bias_sigma: float | None = None
    slope_sigma: float = 3 * PPM
    scale_sigma: float = 30 * PPM
    asymmetry_sigma: float = 15 * PPM
    installation_sigma: float = 10 * ARCSEC
    force_sigma: float = 0.0
    resolution: float = 0.0
    scale_stability: float = 0.0

    @property
    def walk_variance(self) -> tuple[float, ...]:
        """By how much the variance of each sensor's bias grows in a second."""
        return tuple(
            unstable**2 / FLICKER_S + walk**2 + warm**2 / self.temperature_s
            for unstable, walk, warm in zip(
                self.bias_instability, self.rate_random_walk, self.temperature_drift, strict=True
            )
        )

    def turn_variance(self, is_gyro: bool) -> float:
        """Return by how much a bias's variance grows as the sensors turn by a radian.

        Gravity along a sensor makes a bias of sensitivity, scale and installation, another one in
        each position.
        """
        through = self.force_sigma if is_gyro else self.slope_sigma
        return through**2 * earth.GRAVITY_EQUATOR**2
