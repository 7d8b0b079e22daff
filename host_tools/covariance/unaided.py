"""The linear error model of a navigation without aids.

An analysis of its own, beside the runs and without their code: errors of position (m) and velocity
(m/s) to the east and north and the turn φ about east, north and up from the true to the navigated
attitude, with the height held. To first order, in the navigation frame, with f the specific force,
ω_ie and ω_en the rates of the Earth and of the transport, δf and δω the errors of the fused sensors
(Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed.,
2013, section 14.2; Savage, *Strapdown Analytics*, 2000, chapter 12)::

    δr' = δv - ω_en × δr
    δv' = φ × f + C δf - (2 ω_ie + ω_en) × δv - (2 δω_ie + δω_en) × v
    φ'  = -ω_in × φ + C δω - δω_in
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.covariance.kinds import Effect
from rrins.host_tools.covariance.linear import ATTITUDE, OUTPUTS, POSITION, VELOCITY, System
from rrins.host_tools.covariance.model import Model
from rrins.host_tools.covariance.path import INTERVAL_S, Path, cross_matrices
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.scenario import Scenario

STATES: Final = 7
_R, _V, _PHI = slice(0, 2), slice(2, 4), slice(4, 7)


class Unaided(Model):
    """The linear error model of a navigation without aids; parameters as of `Model`."""

    interval_s = INTERVAL_S

    def __init__(
        self, scenario: Scenario, path: Path, axes: dict[str, AxesDeg] | None = None
    ) -> None:
        super().__init__(scenario, path, axes)
        F = _dynamics(path)
        step = F * INTERVAL_S
        C = np.zeros((OUTPUTS, STATES))
        C[POSITION, _R], C[VELOCITY, _V], C[ATTITUDE, _PHI] = np.eye(3, 2), np.eye(3, 2), np.eye(3)
        count = len(F)
        self.system = System(
            np.eye(STATES) + step + 0.5 * step @ step,
            np.broadcast_to(C, (count + 1, OUTPUTS, STATES)),
        )
        self._half = INTERVAL_S * (np.eye(STATES) + 0.5 * step)  # integral of an input

    @property
    def times_s(self) -> Floats:
        """The ends of the path's intervals."""
        return self.path.times_s

    def begun(self, errors: Floats) -> Floats:
        """Return the states that begin with errors of the outputs, (9, m): shape (7, m)."""
        return np.asarray(self.system.outputs[0].T @ errors)

    def driven(self, kind: str, effect: Effect) -> Floats:
        """Return what a unit of an effect on each sensor does in an interval, (n, 7, m)."""
        errors = self.errors(kind, effect)
        return np.asarray(self._half @ (self._input(kind) * errors[:, None, :]))

    def jolted(self, kind: str, density: Floats) -> Floats:
        """Return the covariance that white noise of the sensors adds in an interval, (n, 7, 7)."""
        G, phi = self._input(kind) * density, self.system.phi
        half = 0.5 * INTERVAL_S * G @ np.swapaxes(G, 1, 2)
        return np.asarray(phi @ half @ np.swapaxes(phi, 1, 2) + half)

    def _input(self, kind: str) -> Floats:
        """Return what the error of each sensor adds to the states, per second, (n, 7, m)."""
        mixed = self.path.C_s_n @ self.sensors[kind].fused  # (n, 3, m)
        B = np.zeros((len(mixed), STATES, mixed.shape[2]))
        if kind == "gyros":
            B[:, _PHI] = mixed
        else:
            B[:, _V] = mixed[:, :2]
        return B


def _dynamics(path: Path) -> Floats:
    """Return the matrix of the error equations in each interval, shape (n, 7, 7)."""
    count = len(path.latitude)
    meridian, prime = path.curvatures.T
    sine, cosine = np.sin(path.latitude), np.cos(path.latitude)
    rate = path.earth_n[:, 1] / cosine
    transport = path.rate_n - path.earth_n
    of_latitude = np.zeros((count, 3))  # of ω_ie, by north in m
    of_latitude[:, 1], of_latitude[:, 2] = -rate * sine / meridian, rate * cosine / meridian
    by_position = np.zeros((count, 3, 2))  # of ω_en
    by_position[:, 2, 1] = path.velocity_n[:, 0] / (prime * cosine**2 * meridian)
    by_velocity = np.zeros((count, 3, 2))
    by_velocity[:, 0, 1] = -1.0 / meridian
    by_velocity[:, 1, 0] = 1.0 / prime
    by_velocity[:, 2, 0] = np.tan(path.latitude) / prime
    earth_by_position = np.zeros((count, 3, 2))
    earth_by_position[:, :, 1] = of_latitude
    F = np.zeros((count, STATES, STATES))
    F[:, _R, _R] = -cross_matrices(transport)[:, :2, :2]
    F[:, _R, _V] = np.eye(2)
    coriolis = cross_matrices(path.earth_n + path.rate_n)
    speed = cross_matrices(path.velocity_n)
    F[:, _V, _R] = (speed @ (2.0 * earth_by_position + by_position))[:, :2]
    F[:, _V, _V] = -coriolis[:, :2, :2] + (speed @ by_velocity)[:, :2]
    F[:, _V, _PHI] = -cross_matrices(path.force_n)[:, :2]
    F[:, _PHI, _R] = -(earth_by_position + by_position)
    F[:, _PHI, _V] = -by_velocity
    F[:, _PHI, _PHI] = -cross_matrices(path.rate_n)
    return F
