"""A linear system that error sources drive, interval by interval: their moments at its outputs.

``x' = Φ x + B e`` with errors e that are constant, white, or first-order Markov processes; each
kind is propagated by itself (Maybeck, *Stochastic Models, Estimation, and Control*, vol. 1, 1979,
section 6.8: of a closed loop, Φ is that of the loop with the gains as they are used).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rrins.compiled.record import Floats

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
"""Outputs: errors to the east, north and up, m and m/s; and of the attitude about them, rad."""

OUTPUTS = 9
HORIZONTAL = slice(0, 2)


class Moments(NamedTuple):
    """The effect of an error source on the outputs over time, at n + 1 instants."""

    mean: Floats
    """Shape (n + 1, 9)."""
    horizontal: Floats
    """Covariance of the position to the east and north, shape (n + 1, 2, 2), m²."""
    variance: Floats
    """Of each output, shape (n + 1, 9)."""


@dataclass(frozen=True)
class System:
    """A linear system over n intervals, of s states."""

    phi: Floats  #: shape (n, s, s)
    outputs: Floats  #: shape (n + 1, 9, s); from the states, at the ends of the intervals

    def sensitivities(self, begin: Floats, inputs: Floats) -> Floats:
        """Return the outputs for a unit of each of m constants, shape (n + 1, 9, m).

        Parameters
        ----------
        begin : array, shape (s, m)
            The states at the beginning.
        inputs : array, shape (n, s, m)
        """
        S = begin
        track = np.empty((len(self.phi) + 1, OUTPUTS, S.shape[1]))
        track[0] = self.outputs[0] @ S
        for k, phi in enumerate(self.phi):
            S = phi @ S + inputs[k]
            track[k + 1] = self.outputs[k + 1] @ S
        return track

    def of_noise(self, begin: Floats, added: Floats) -> Moments:
        """Return the moments of white noise, and of errors at the beginning.

        Parameters
        ----------
        begin : array, shape (s, s)
            Covariance of the states at the beginning.
        added : array, shape (n, s, s)
            By the noise of each interval, at its end.
        """
        return self._spread(begin, self.phi, added)

    def of_processes(self, begin: Floats, inputs: Floats, decay: float, added: Floats) -> Moments:
        """Return the moments of m independent processes ``e' = decay e + w``.

        Parameters
        ----------
        begin : array, shape (s + m, s + m)
            Covariance of states and processes at the beginning.
        inputs : array, shape (n, s, m)
        decay : float
            Of a process over an interval.
        added : array, shape (m,)
            Variance of w.
        """
        n, s, m = inputs.shape
        phi = np.zeros((n, s + m, s + m))
        phi[:, :s, :s], phi[:, :s, s:] = self.phi, inputs
        phi[:, s:, s:] = decay * np.eye(m)
        Q = np.diag(np.concatenate([np.zeros(s), added]))
        return self._spread(begin, phi, np.broadcast_to(Q, phi.shape))

    def _spread(self, P: Floats, phi: Floats, added: Floats) -> Moments:
        """Return the moments at the outputs, of which the first s columns are of the states."""
        count, states = len(phi), self.phi.shape[-1]
        horizontal, variance = np.empty((count + 1, 2, 2)), np.empty((count + 1, OUTPUTS))
        for k in range(count + 1):
            if k:
                P = phi[k - 1] @ P @ phi[k - 1].T + added[k - 1]
            C = self.outputs[k]
            CP = C @ P[:states, :states]
            variance[k] = np.einsum("ij,ij->i", CP, C)
            horizontal[k] = CP[HORIZONTAL] @ C[HORIZONTAL].T
        return Moments(np.zeros((count + 1, OUTPUTS)), horizontal, variance)


def moments_of(track: Floats, mean: Floats, covariance: Floats) -> Moments:
    """Return the moments of constants with a mean (m,) and a covariance (m, m)."""
    level = track[:, HORIZONTAL]
    return Moments(
        track @ mean,
        level @ covariance @ np.swapaxes(level, 1, 2),
        np.einsum("nim,mk,nik->ni", track, covariance, track, optimize=True),
    )


def moments_together(one: Floats, other: Floats, cross: Floats) -> Moments:
    """Return what the correlation of two constants adds, of a cross-covariance (m, k).

    `one` and `other` are their tracks, shape (n + 1, 9, m) and (n + 1, 9, k).
    """
    both = one @ cross @ np.swapaxes(other, 1, 2)
    level = both[:, HORIZONTAL, HORIZONTAL]
    return Moments(
        np.zeros(both.shape[:2]),
        level + np.swapaxes(level, 1, 2),
        2.0 * np.diagonal(both, axis1=1, axis2=2),
    )


def after_rest(decay: float, added: float, intervals: int) -> Floats:
    """Return the covariance of a process' mean over its first intervals, and of it then, (2, 2).

    It is at zero when it begins, as the sensors are switched on; `added` is the variance that an
    interval adds.
    """
    count = max(1, intervals)
    phi = np.array([[1.0, 0.5 * (1.0 + decay) / count], [0.0, decay]])
    noise = np.array([0.5 / count, 1.0])
    P = np.zeros((2, 2))
    for _ in range(count):
        P = phi @ P @ phi.T + added * np.outer(noise, noise)
    return P
