"""The linear error model of a navigation that the firmware's filter aids.

The filter's own analysis with the true errors in the place of those that it assumes: the states are
its errors e, what is left to be added to navigation and estimates. Over a second::

    e' = Φ [(I - K h) e - K ν] + w

with Φ, rows h and gains K as the filter used them along a run without errors, ν and w as the
scenario has them (Gelb, *Applied Optimal Estimation*, 1974, section 7.2; Maybeck, *Stochastic
Models, Estimation, and Control*, vol. 1, 1979, section 6.8). An error b of which the filter has a
state is taken out of it, e = T b + e°, so that the system is driven: for the constant one,
``e°' = A e° + (A T - T) b`` with ``A = Φ (I - K h)``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.firmware_py.core.estimator.transition import ATTITUDE as TURN_E
from rrins.firmware_py.core.records.estimator_records import (
    ACROSS_U,
    ACROSS_V,
    ASYMMETRY,
    BIASES,
    COMPONENTS,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    SCALE_FACTOR,
)
from rrins.firmware_py.core.records.estimator_records import VELOCITY as VELOCITY_E
from rrins.host_tools.covariance.kinds import AidConstant, AidNoise, AidProcess, Drawn, Effect
from rrins.host_tools.covariance.linear import (
    ATTITUDE,
    OUTPUTS,
    VELOCITY,
    Moments,
    System,
)
from rrins.host_tools.covariance.model import Model
from rrins.host_tools.covariance.path import INTERVAL_S, path_through
from rrins.host_tools.covariance.trace import Second, Trace
from rrins.host_tools.scenario.scenario import Scenario

_STATES_OF: Final[dict[Effect, int]] = {
    "scale": SCALE_FACTOR,
    "asymmetry": ASYMMETRY,
    "delta_u": ACROSS_U,
    "delta_v": ACROSS_V,
}
"""Effects that are states of the filter where it estimates the sensors' constants."""

_HALVES: Final = round(1.0 / INTERVAL_S)
"""Intervals of a path in a second of the filter."""


def closed(second: Second) -> tuple[Floats, Floats]:
    """Return the closed loop of a second.

    Returns
    -------
    A : array, shape (s, s)
        ``Φ Π (I - K h)``.
    noise : array, shape (s, measurements)
        What a unit of the error of each measurement does to the states at the second's end.
    """
    U = np.eye(len(second.phi))
    into = np.zeros((len(U), len(second.takes)))
    for k, one in enumerate(second.takes):
        loop = np.eye(len(U)) - np.outer(one.gain, one.row)
        U = loop @ U
        into = loop @ into
        into[:, k] = -one.gain
    return second.phi @ U, second.phi @ into


class Aided(Model):
    """The linear error model of an aided navigation.

    Parameters
    ----------
    scenario : Scenario
        Of the true errors.
    trace : Trace
        Of the filter.
    """

    interval_s = 1.0

    def __init__(self, scenario: Scenario, trace: Trace) -> None:
        super().__init__(scenario, path_through(trace.truth, trace.begins_s))
        self.trace = trace
        loops = [closed(second) for second in trace.seconds]
        self._into = [into for _, into in loops]
        self.system = System(np.array([A for A, _ in loops]), self._outputs())

    def _outputs(self) -> Floats:
        """Return the errors of the navigation, navigated less true, from those of the filter."""
        states = len(self.trace.P[0])
        C = np.zeros((len(self.trace.radii), OUTPUTS, states))
        north, east = self.trace.radii.T
        C[:, 0, LONGITUDE], C[:, 1, LATITUDE], C[:, 2, HEIGHT] = -east, -north, -1.0
        C[:, VELOCITY, VELOCITY_E : VELOCITY_E + 3] = -np.eye(3)
        C[:, ATTITUDE, TURN_E : TURN_E + 3] = -np.eye(3)
        return C

    @property
    def times_s(self) -> Floats:
        """The filter's seconds."""
        return self.trace.begins_s + np.arange(len(self.trace.radii), dtype=np.float64)

    def filter_sigma(self) -> Floats:
        """Return σ of the outputs as the filter has it, shape (n + 1, 9)."""
        pairs = zip(self.system.outputs, self.trace.P, strict=True)
        return np.array([np.sqrt(np.einsum("ij,jk,ik->i", C, P, C)) for C, P in pairs])

    def begun(self, errors: Floats) -> Floats:
        """Return the states that begin with errors of the navigation, (9, m): shape (s, m)."""
        return np.asarray(np.linalg.pinv(self.system.outputs[0]) @ errors)

    def driven(self, kind: str, effect: Effect) -> Floats:
        """Return what a unit of an effect on each sensor does in a second, (n, s, m)."""
        error = _STATES_OF.get(effect)
        if self.trace.layout.constants is not None and error is not None:
            return self._driven_by(self._constants(kind, error))
        count = len(self.system.phi)
        halves = self.errors(kind, effect)[: count * _HALVES]
        errors = halves.reshape(count, _HALVES, -1).mean(axis=1)
        return np.asarray(self._driven_by(self._biases(kind)) * errors[:, None, :])

    def track(self, one: Drawn) -> Floats:
        """Return the outputs over time for a unit of each of what a run draws, (n + 1, 9, m)."""
        if not isinstance(one, AidConstant):
            return super().track(one)
        layout = self.trace.layout
        first = layout.odometer if one.part == "odometer" else layout.altimeter
        if first is None:
            return np.zeros((len(self.times_s), OUTPUTS, 1))
        begin = np.zeros((self.system.phi.shape[-1], 1))
        inputs = self._driven_by(np.array([first + one.state]))
        return self.system.sensitivities(begin, inputs)

    def jolted(self, kind: str, density: Floats) -> Floats:
        """Return the covariance that white noise of the sensors adds in a second, (n, s, s)."""
        rows = slice(TURN_E, TURN_E + 3) if kind == "gyros" else slice(VELOCITY_E, VELOCITY_E + 3)
        found = np.zeros_like(self.system.phi)
        at = self._biases(kind)
        for k, second in enumerate(self.trace.seconds):
            G = second.phi[rows, at] * density / math.sqrt(second.length_s)
            found[k, rows, rows] = G @ G.T
        return found

    def of_filter_start(self) -> Moments:
        """Return the moments of the errors at the beginning, as the filter has them."""
        P = self.trace.P[0].copy()
        P[BIASES:], P[:, BIASES:] = 0.0, 0.0
        return self.system.of_noise(P, np.zeros_like(self.system.phi))

    def of_aid_noise(self, one: AidNoise) -> Moments:
        """Return the moments of white noise of measurements."""
        added = np.zeros_like(self.system.phi)
        for k, second in enumerate(self.trace.seconds):
            used = [
                (j, one.variance(take))
                for j, take in enumerate(second.takes)
                if take.aid is one.aid
            ]
            for j, variance in used:
                column = self._into[k][:, j]
                added[k] += variance * np.outer(column, column)
        return self.system.of_noise(np.zeros_like(added[0]), added)

    def of_aid_process(self, one: AidProcess) -> Moments:
        """Return the moments of Markov processes in the components of a measurement."""
        states = self.system.phi.shape[-1]
        inputs = np.zeros((len(self.system.phi), states, COMPONENTS))
        for k, second in enumerate(self.trace.seconds):
            for j, take in enumerate(second.takes):
                if take.aid is one.aid:
                    inputs[k, :, take.component] += self._into[k][:, j]
        decay = math.exp(-1.0 / one.decay_s)
        begin = np.zeros((states + COMPONENTS,) * 2)
        begin[states:, states:] = one.sigma**2 * np.eye(COMPONENTS)
        added = np.full(COMPONENTS, one.sigma**2 * (1.0 - decay**2) + one.walk**2)
        return self.system.of_processes(begin, inputs, decay, added)

    def _driven_by(self, states: Integers) -> Floats:
        """Return what constants do that are states of the filter: ``A T - T``, shape (n, s, m)."""
        T = np.eye(self.system.phi.shape[-1])[:, states]
        return np.asarray(self.system.phi @ T - T)

    def _biases(self, kind: str) -> Integers:
        layout = self.trace.layout
        if kind == "gyros":
            return BIASES + np.arange(layout.gyros)
        return BIASES + layout.gyros + np.arange(layout.accelerometers)

    def _constants(self, kind: str, error: int) -> Integers:
        """Return the states of an error of the sensors of a kind."""
        layout = self.trace.layout
        assert layout.constants is not None
        first = layout.constants + error * (layout.gyros + layout.accelerometers)
        if kind == "gyros":
            return first + np.arange(layout.gyros)
        return first + layout.gyros + np.arange(layout.accelerometers)
