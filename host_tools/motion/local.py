"""Local metric coordinates around an origin, used for fitting.

East and north are longitude and latitude times *fixed* radii, those at the origin. They are
coordinates, not distances: away from the origin one metre differs slightly from one metre over
ground, and `stretch` returns the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware import earth


@dataclass(frozen=True)
class Local:
    """An origin: latitude, longitude in rad, height in m."""

    latitude: float
    longitude: float
    height: float

    @property
    def metres_per_radian(self) -> Floats:
        """Metres per rad of longitude, of latitude, and 1 for height; shape (3,)."""
        return self._scales(np.array([self.latitude]), np.array([self.height]))[0]

    @staticmethod
    def _scales(latitude: Floats, height: Floats) -> Floats:
        meridian, prime = earth.curvature_radii(latitude)
        east = (prime + height) * np.cos(latitude)
        return np.stack([east, meridian + height, np.ones_like(height)], axis=-1)

    def offsets(self, place: Floats) -> Floats:
        """Return east, north, up in m of places (latitude, longitude, height), shape (m, 3)."""
        origin = np.array([self.longitude, self.latitude, self.height])
        return (place[:, [1, 0, 2]] - origin) * self.metres_per_radian

    def places(self, offsets: Floats) -> Floats:
        """Return the change of latitude, longitude, height for offsets in m, shape (m, 3)."""
        return (offsets / self.metres_per_radian)[:, [1, 0, 2]]

    def stretch(self, offsets: Floats) -> Floats:
        """Return metres over ground per metre of offset there, east, north, up; shape (m, 3)."""
        added = self.places(offsets)
        scales = self._scales(self.latitude + added[:, 0], self.height + added[:, 2])
        return scales / self.metres_per_radian
