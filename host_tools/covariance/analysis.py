"""Linear covariance analysis: σ of the navigation errors over time, and each source's share.

An analysis of its own, beside the runs and without their code: errors of position (m) and velocity
(m/s) to the east and north and the turn φ about east, north and up from the true to the navigated
attitude, with the height held. To first order, in the navigation frame, with f the specific force,
ω_ie and ω_en the rates of the Earth and of the transport, δf and δω the errors of the fused sensors
(Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed.,
2013, section 14.2; Savage, *Strapdown Analytics*, 2000, chapter 12)::

    δr' = δv - ω_en × δr
    δv' = φ × f + C δf - (2 ω_ie + ω_en) × δv - (2 δω_ie + δω_en) × v
    φ'  = -ω_in × φ + C δω - δω_in

Every source is propagated by itself: constants as sensitivities, white noise and Markov processes
as covariances; the sources are independent, so their variances add up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.covariance.path import INTERVAL_S, Path, cross_matrices, path_of
from rrins.host_tools.covariance.sources import Constant, Process, Varied, White, sources_of
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.sensors import input_axis, transverse_axes
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each

STATES: Final = 7
_R, _V, _PHI = slice(0, 2), slice(2, 4), slice(4, 7)
_HORIZONTAL = slice(0, 2)


@dataclass(frozen=True)
class SourceResult:
    """The effect of an error source."""

    name: str
    covariance: Floats  #: shape (n, 2, 2); of the position to the east and north, m², over time

    @property
    def sigma(self) -> Floats:
        """σ of the position to the east and north, m, at `Analysis.times_s`, shape (n, 2)."""
        variance = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    @property
    def end(self) -> tuple[float, float]:
        """σ at the end, east and north, m."""
        return float(self.sigma[-1, 0]), float(self.sigma[-1, 1])

    @property
    def largest(self) -> float:
        """The largest σ on the way, of either direction, m."""
        return float(self.sigma.max())


@dataclass(frozen=True)
class Analysis:
    """A linear covariance analysis."""

    times_s: Floats  #: shape (n,); since navigation began
    #: shape (n, 2); what the constants of the scenario give that do not vary, m, east and north
    mean: Floats
    sigma: Floats  #: shape (n, 2)
    sources: list[SourceResult]  #: the largest at the end first
    left_out: list[str]  #: what errs and is not considered
    fixed: list[str]  #: constants of one value: they give the mean and no σ

    def share(self, source: SourceResult) -> float:
        """Return the share of a source in the horizontal variance at the end."""
        whole = float((self.sigma[-1] ** 2).sum())
        return float((source.sigma[-1] ** 2).sum()) / whole if whole > 0 else 0.0

    def values(self) -> JsonObject:
        """Return it as plain values."""
        return {
            "duration_s": float(self.times_s[-1]),
            "sigma_m": {"east": float(self.sigma[-1, 0]), "north": float(self.sigma[-1, 1])},
            "mean_m": {"east": float(self.mean[-1, 0]), "north": float(self.mean[-1, 1])},
            "sources": [
                {
                    "name": one.name,
                    "east_m": one.end[0],
                    "north_m": one.end[1],
                    "largest_m": one.largest,
                    "share": self.share(one),
                }
                for one in self.sources
            ],
            "left_out": self.left_out,
            "fixed": self.fixed,
        }


def analyse(scenario: Scenario, varied: Sequence[Varied] = ()) -> Analysis:
    """Return the covariance analysis of a scenario.

    Parameters
    ----------
    scenario : Scenario
        With what it draws itself.
    varied : sequence of Varied, optional
        The inputs of a campaign.

    Raises
    ------
    RehearsalError
        When the analysis does not cover the scenario, or it does not navigate.
    """
    if scenario.estimator.enabled:
        raise RehearsalError("covariance: is for navigation without the estimator")
    if scenario.firmware.height_channel == "free":
        raise RehearsalError('covariance: is for a height_channel that is "held" or "damped"')
    sources = sources_of(scenario, varied)
    model = Model(scenario, path_of(scenario))
    mean = np.zeros((model.count + 1, 2))
    results = []
    for one in sources.constants:
        track, spread = model.of_constant(one)
        mean += track
        results.append(SourceResult(one.name, spread))
    for name, (turn, covariance) in sources.attitude.items():
        track, spread = model.of_attitude(turn, covariance)
        mean += track
        results.append(SourceResult(name, spread))
    results += [SourceResult(one.name, model.of_white(one)) for one in sources.whites]
    results += [SourceResult(one.name, model.of_process(one)) for one in sources.processes]
    fixed = [one.name for one in results if not one.covariance.any()]
    results = [one for one in results if one.covariance.any()]
    whole = SourceResult(
        "all", sum((one.covariance for one in results), np.zeros((len(mean), 2, 2)))
    )
    results.sort(key=lambda one: -float(np.trace(one.covariance[-1])))
    left_out = sorted(set(sources.left_out))
    return Analysis(model.path.times_s, mean, whole.sigma, results, left_out, fixed)


class _Sensors:
    """The sensors of a kind: directions, and how they are fused."""

    def __init__(self, axes_deg: AxesDeg, weights: Floats) -> None:
        angles = [(math.radians(a), math.radians(b)) for a, b in axes_deg]
        self.H = np.array([input_axis(*pair) for pair in angles])
        self.u, self.v = (np.array([transverse_axes(*pair)[k] for pair in angles]) for k in (0, 1))
        W = np.diag(weights)
        self.fused = np.linalg.solve(self.H.T @ W @ self.H, self.H.T @ W)  # (3, m)

    def outputs(self, effect: str, true_s: Floats, force_s: Floats) -> Floats:
        """Return the error of each sensor for a unit of an effect, shape (n, m)."""
        x = true_s @ self.H.T
        return {
            "bias": lambda: np.ones_like(x),
            "scale": lambda: x,
            "asymmetry": lambda: np.abs(x),
            "delta_u": lambda: -true_s @ self.v.T,
            "delta_v": lambda: -true_s @ self.u.T,
            "force": lambda: force_s @ self.H.T,
        }[effect]()


class Model:
    """The linear error model of a path.

    Parameters
    ----------
    scenario : Scenario
    path : Path
    axes : dict, optional
        Input axes of `gyros` and `accelerometers`, other than the scenario's; of equal weight.
    """

    def __init__(
        self, scenario: Scenario, path: Path, axes: dict[str, AxesDeg] | None = None
    ) -> None:
        self.path = path
        self.count = len(path.latitude)
        self._scenario = scenario
        rimu, firmware = scenario.rimu, scenario.firmware
        self._sensors = {
            kind: _Sensors(of, np.ones(len(of))) for kind, of in (axes or {}).items()
        } or {
            "gyros": _Sensors(rimu.gyros, _weights(firmware.gyro_weights, rimu.gyros)),
            "accelerometers": _Sensors(
                rimu.accelerometers,
                _weights(firmware.accelerometer_weights, rimu.accelerometers),
            ),
        }
        F = _dynamics(path)
        step = F * INTERVAL_S
        self._phi = np.eye(STATES) + step + 0.5 * step @ step  # (n, 7, 7)
        self._half = INTERVAL_S * (np.eye(STATES) + 0.5 * step)  # integral of an input

    def _input(self, kind: str) -> Floats:
        """Return what the error of each sensor does to the states in an interval, (n, 7, m)."""
        mixed = self.path.C_s_n @ self._sensors[kind].fused  # (n, 3, m)
        B = np.zeros((self.count, STATES, mixed.shape[2]))
        if kind == "gyros":
            B[:, _PHI] = mixed
        else:
            B[:, _V] = mixed[:, :2]
        return B

    def _initial(self, kind: str) -> Floats:
        """Return what the error of each sensor did to the states by alignment, shape (7, m).

        Coarse alignment levels by the specific force and finds north by the rate of the Earth.
        """
        mixed = self.path.C_begin @ self._sensors[kind].fused
        S = np.zeros((STATES, mixed.shape[1]))
        if self._scenario.firmware.initial_attitude == "given":
            return S
        gravity = float(self.path.force_n[0, 2])
        _, north, up = self.path.earth_n[0]
        if kind == "accelerometers":
            S[4], S[5] = mixed[1] / gravity, -mixed[0] / gravity
            S[6] = S[5] * up / north
        else:
            S[6] = mixed[0] / north
        return S

    def of_constant(self, one: Constant) -> tuple[Floats, Floats]:
        """Return the mean error that a constant gives, shape (n + 1, 2), and its covariance."""
        path, sensors = self.path, self._sensors[one.kind]
        true_s = path.rate_s if one.kind == "gyros" else path.force_s
        out = sensors.outputs(one.effect, true_s, path.force_s)
        B = self._half @ (self._input(one.kind) * out[:, None, :])
        earth_s = path.C_begin.T @ path.earth_n[:1].T
        up_s = path.C_begin.T @ [[0.0], [0.0], [path.force_n[0, 2]]]
        at_rest = sensors.outputs(one.effect, (earth_s if one.kind == "gyros" else up_s).T, up_s.T)
        return _moments(self._run(self._initial(one.kind) * at_rest, B), one.mean, one.covariance)

    def of_attitude(self, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Return the same for errors of the given roll, pitch and heading, rad.

        Of a vehicle that stands level: pitch turns about its x axis, roll about its y axis.
        """
        heading = math.radians(self._scenario.body.heading_deg)
        cosine, sine = math.cos(heading), math.sin(heading)
        S = np.zeros((STATES, 3))
        S[_PHI] = np.array([[sine, cosine, 0.0], [cosine, -sine, 0.0], [0.0, 0.0, -1.0]])
        return _moments(self._run(S, np.zeros((self.count, STATES, 3))), mean, covariance)

    def _run(self, S: Floats, B: Floats) -> Floats:
        """Return the sensitivities of the position over time, shape (n + 1, 2, m)."""
        track = np.empty((self.count + 1, 2, S.shape[1]))
        track[0] = S[_HORIZONTAL]
        for k in range(self.count):
            S = self._phi[k] @ S + B[k]
            track[k + 1] = S[_HORIZONTAL]
        return track

    def of_white(self, one: White) -> Floats:
        """Return the covariance that white noise gives, shape (n + 1, 2, 2)."""
        G = self._input(one.kind) * one.density
        Q = INTERVAL_S * G @ np.swapaxes(G, 1, 2)
        S = self._initial(one.kind) * one.density / math.sqrt(self._scenario.firmware.alignment_s)
        P = S @ S.T
        found = np.zeros((self.count + 1, 2, 2))
        for k in range(self.count):
            phi = self._phi[k]
            P = phi @ (P + 0.5 * Q[k]) @ phi.T + 0.5 * Q[k]
            found[k + 1] = P[_HORIZONTAL, _HORIZONTAL]
        return found

    def of_process(self, one: Process) -> Floats:
        """Return the covariance that Markov processes of each sensor give, (n + 1, 2, 2)."""
        B = self._half @ self._input(one.kind)
        S = self._initial(one.kind)
        processes = zip(one.decay_s, one.drive, strict=True)
        return np.asarray(
            sum(self._of_process(B, S, decay_s, drive) for decay_s, drive in processes)
        )

    def _of_process(self, B: Floats, S: Floats, decay_s: float, drive: Floats) -> Floats:
        sensors = len(drive)
        size = STATES + sensors
        decay = math.exp(-INTERVAL_S / decay_s)
        share = 0.5 * decay_s * (1.0 - decay**2) if math.isfinite(decay_s) else INTERVAL_S
        phi, Q = np.zeros((size, size)), np.zeros((size, size))
        phi[STATES:, STATES:] = decay * np.eye(sensors)
        Q[STATES:, STATES:] = np.diag(drive**2 * share)
        begun = _after_alignment(decay, share, self._scenario.firmware.alignment_s)
        both = np.block([[S, np.zeros_like(S)], [np.zeros((sensors, sensors)), np.eye(sensors)]])
        P = np.asarray(both @ np.kron(begun, np.diag(drive**2)) @ both.T, dtype=np.float64)
        found = np.zeros((self.count + 1, 2, 2))
        found[0] = P[_HORIZONTAL, _HORIZONTAL]
        for k in range(self.count):
            phi[:STATES, :STATES] = self._phi[k]
            phi[:STATES, STATES:] = B[k]
            P = phi @ P @ phi.T + Q
            found[k + 1] = P[_HORIZONTAL, _HORIZONTAL]
        return found


def _after_alignment(decay: float, share: float, alignment_s: float) -> Floats:
    """Return the covariance of a process' mean over the alignment, and of it at the end, (2, 2).

    It is at zero when the alignment begins, as the sensors are switched on.
    """
    count = max(1, round(alignment_s / INTERVAL_S))
    phi = np.array([[1.0, 0.5 * (1.0 + decay) / count], [0.0, decay]])
    noise = np.array([0.5 / count, 1.0])
    P = np.zeros((2, 2))
    for _ in range(count):
        P = phi @ P @ phi.T + share * np.outer(noise, noise)
    return P


def _weights(given: float | tuple[float, ...], axes: AxesDeg) -> Floats:
    return np.array(each(given, len(axes)), float)


def _moments(track: Floats, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return mean and covariance of the position for constants with a mean and a covariance."""
    return track @ mean, track @ covariance @ np.swapaxes(track, 1, 2)


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
