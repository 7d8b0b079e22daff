"""The linear error model of a navigation: what the errors of its sensors do to it over time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.covariance.kinds import Constant, Crooked, Drawn, Effect, Process, White
from rrins.host_tools.covariance.linear import (
    ATTITUDE,
    OUTPUTS,
    Moments,
    System,
    after_rest,
    moments_of,
)
from rrins.host_tools.covariance.path import Path, rotation_about_z
from rrins.host_tools.hardware.sensors import input_axis, transverse_axes
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each


class _Sensors:
    """The sensors of a kind: directions, and how they are fused."""

    def __init__(self, axes_deg: AxesDeg, weights: Floats) -> None:
        angles = [(math.radians(a), math.radians(b)) for a, b in axes_deg]
        self.H = np.array([input_axis(*pair) for pair in angles])
        self.u, self.v = (np.array([transverse_axes(*pair)[k] for pair in angles]) for k in (0, 1))
        W = np.diag(weights)
        self.fused = np.linalg.solve(self.H.T @ W @ self.H, self.H.T @ W)  # (3, m)

    def outputs(self, effect: Effect, true_s: Floats, force_s: Floats, warmer: Floats) -> Floats:
        """Return the error of each sensor for a unit of an effect, shape (n, m)."""
        x = true_s @ self.H.T
        return {
            "bias": lambda: np.ones_like(x),
            "scale": lambda: x,
            "asymmetry": lambda: np.abs(x),
            "delta_u": lambda: -true_s @ self.v.T,
            "delta_v": lambda: -true_s @ self.u.T,
            "force": lambda: force_s @ self.H.T,
            "warm_bias": lambda: np.ones_like(x) * warmer[:, None],
            "warm_scale": lambda: x * warmer[:, None],
        }[effect]()


class Model(ABC):
    """The linear error model of a path.

    Parameters
    ----------
    scenario : Scenario
    path : Path
    axes : dict, optional
        Input axes of `gyros` and `accelerometers`, other than the scenario's; of equal weight.
    """

    system: System
    interval_s: ClassVar[float]
    """Of the system."""

    def __init__(
        self, scenario: Scenario, path: Path, axes: dict[str, AxesDeg] | None = None
    ) -> None:
        self.path = path
        self.scenario = scenario
        rimu, firmware = scenario.rimu, scenario.firmware
        self.sensors = {
            kind: _Sensors(of, np.ones(len(of))) for kind, of in (axes or {}).items()
        } or {
            "gyros": _Sensors(rimu.gyros, _weights(firmware.gyro_weights, rimu.gyros)),
            "accelerometers": _Sensors(
                rimu.accelerometers,
                _weights(firmware.accelerometer_weights, rimu.accelerometers),
            ),
        }

    @property
    @abstractmethod
    def times_s(self) -> Floats:
        """The instants of all results, since navigation began, shape (n + 1,)."""

    @abstractmethod
    def begun(self, errors: Floats) -> Floats:
        """Return the states that begin with errors of the outputs, (9, m): shape (s, m)."""

    @abstractmethod
    def driven(self, kind: str, effect: Effect) -> Floats:
        """Return what a unit of an effect on each sensor does in an interval, (n, s, m)."""

    @abstractmethod
    def jolted(self, kind: str, density: Floats) -> Floats:
        """Return the covariance that white noise of the sensors adds in an interval, (n, s, s)."""

    def errors(self, kind: str, effect: Effect) -> Floats:
        """Return the error of each sensor for a unit of an effect along the path, (n, m)."""
        path = self.path
        true_s = path.rate_s if kind == "gyros" else path.force_s
        return self.sensors[kind].outputs(
            effect, true_s, path.force_s, self._warmer(0.5 * (path.times_s[1:] + path.times_s[:-1]))
        )

    def _warmer(self, times_s: Floats) -> Floats:
        """Return the sensors' temperature above that of their calibration, K."""
        thermal, scenario = self.scenario.thermal, self.scenario
        on_s = np.maximum(0.0, times_s + scenario.navigation_epoch / scenario.rate_hz)
        warmed = thermal.warm_up_k * (1.0 - np.exp(-on_s / thermal.time_constant_s))
        return np.asarray(thermal.ambient_offset_k + warmed)

    def _aligned(self, kind: str) -> Floats:
        """Return what the error of each sensor did to the outputs by alignment, shape (9, m).

        Coarse alignment levels by the specific force and finds north by the rate of the Earth.
        """
        mixed = self.path.C_begin @ self.sensors[kind].fused
        begun = np.zeros((OUTPUTS, mixed.shape[1]))
        if self.scenario.firmware.initial_attitude != "self-aligned":
            return begun
        turn = begun[ATTITUDE]
        gravity = float(self.path.force_n[0, 2])
        _, north, up = self.path.earth_n[0]
        if kind == "accelerometers":
            turn[0], turn[1] = mixed[1] / gravity, -mixed[0] / gravity
            turn[2] = turn[1] * up / north
        else:
            turn[2] = mixed[0] / north
        return begun

    def _at_rest(self, kind: str, effect: Effect) -> Floats:
        """Return the mean error of each sensor over the alignment for a unit of an effect, (m,)."""
        path, seconds = self.path, self.scenario.firmware.alignment_s
        up_s = (path.C_begin.T @ [[0.0], [0.0], [path.force_n[0, 2]]]).T
        true_s = (path.C_begin.T @ path.earth_n[:1].T).T if kind == "gyros" else up_s
        times_s = path.times_s[0] - seconds * (np.arange(60) + 0.5) / 60
        warmer = np.array([self._warmer(times_s).mean()])
        return self.sensors[kind].outputs(effect, true_s, up_s, warmer)[0]

    def track(self, one: Drawn) -> Floats:
        """Return the outputs over time for a unit of each of what a run draws, (n + 1, 9, m)."""
        if isinstance(one, Constant):
            begin = self.begun(self._aligned(one.kind) * self._at_rest(one.kind, one.effect))
            return self.system.sensitivities(begin, self.driven(one.kind, one.effect))
        errors = self._crookedness(one) if isinstance(one, Crooked) else self._given()
        begin = self.begun(errors)
        none = np.zeros((len(self.system.phi), *begin.shape))
        return self.system.sensitivities(begin, none)

    def of_drawn(self, one: Drawn) -> Moments:
        """Return the moments of what a run draws once."""
        return moments_of(self.track(one), one.mean, one.covariance)

    def _given(self) -> Floats:
        """Return the errors that a unit of each of a start's makes, shape (9, 9).

        Of a vehicle that stands level: pitch turns about its x axis, roll about its y axis.
        """
        heading = self.path.heading
        cosine, sine = math.cos(heading), math.sin(heading)
        errors = np.eye(OUTPUTS)
        errors[ATTITUDE, ATTITUDE] = [[sine, cosine, 0.0], [cosine, -sine, 0.0], [0.0, 0.0, -1.0]]
        return errors

    def _crookedness(self, one: Crooked) -> Floats:
        """Return the errors that a unit of an imperfection of the table makes, shape (9, 1).

        The firmware takes ``Rx(outer) Rz(inner)`` for ``C_s_b``; the table tilts its inner axis in
        between, and the encoders add what they are off by.
        """
        inner = self.path.inner
        C_n = self.path.C_begin @ rotation_about_z(-inner)
        angle = one.periods * inner
        turn = {
            "turntable.non_orthogonality_arcsec": [0.0, -1.0, 0.0],
            "turntable.wobble_arcsec": [-math.cos(angle), -math.sin(angle), 0.0],
            "turntable.inner.encoder_offset_deg": [0.0, 0.0, 1.0],
            "turntable.outer.encoder_offset_deg": [1.0, 0.0, 0.0],
        }[one.name]
        errors = np.zeros((OUTPUTS, 1))
        errors[ATTITUDE, 0] = C_n @ turn
        return errors

    def of_white(self, one: White) -> Moments:
        """Return the moments of white noise of the sensors."""
        added = self.jolted(one.kind, one.density)
        S = self.begun(self._aligned(one.kind) * one.density)
        return self.system.of_noise(S @ S.T / self.scenario.firmware.alignment_s, added)

    def of_process(self, one: Process) -> Moments:
        """Return the moments of Markov processes of each sensor."""
        inputs, S = self.driven(one.kind, "bias"), self.begun(self._aligned(one.kind))
        sensors, dt = inputs.shape[2], self.interval_s
        both = np.block([[S, np.zeros_like(S)], [np.zeros((sensors, sensors)), np.eye(sensors)]])
        found = []
        for decay_s, drive in zip(one.decay_s, one.drive, strict=True):
            decay = math.exp(-dt / decay_s)
            share = 0.5 * decay_s * (1.0 - decay**2) if math.isfinite(decay_s) else dt
            intervals = round(self.scenario.firmware.alignment_s / dt)
            begun = np.kron(after_rest(decay, share, intervals), np.diag(drive**2))
            begin = np.asarray(both @ begun @ both.T, dtype=np.float64)
            found.append(self.system.of_processes(begin, inputs, decay, drive**2 * share))
        return Moments(*(np.sum(part, axis=0) for part in zip(*found, strict=True)))


def _weights(given: float | tuple[float, ...], axes: AxesDeg) -> Floats:
    return np.array(each(given, len(axes)), float)
