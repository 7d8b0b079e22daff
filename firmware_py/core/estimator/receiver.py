"""The part of a receiver's position error that lasts: a first-order Gauss-Markov process each.

Multipath and the ionosphere leave it. It is a state for latitude, longitude and height, m; without
it the filter would take errors of a minute for noise of a second. Groves (2nd ed., 2013), 14.2.6.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.estimator_records import COMPONENTS, Estimator


def set_up(estimator: Estimator, sigma: float, seconds: float) -> None:
    """Make the errors states of this standard deviation (m) and time constant."""
    estimator.receiver = True
    estimator.receiver_state = estimator.states
    estimator.states += COMPONENTS
    estimator.receiver_variance = sigma**2
    estimator.receiver_share = math.exp(-1.0 / seconds)


@compiled
def begin(estimator: Estimator) -> None:
    """Begin with unknown errors."""
    for i in range(COMPONENTS):
        at = estimator.receiver_state + i
        estimator.receiver_error[i] = 0.0
        estimator.P[at, at] = estimator.receiver_variance


@compiled
def carry(estimator: Estimator) -> None:
    """Take what the filter found, and carry the errors over a second."""
    for i in range(COMPONENTS):
        estimator.receiver_error[i] += estimator.x[estimator.receiver_state + i]
        estimator.receiver_error[i] *= estimator.receiver_share


@compiled
def propagate(estimator: Estimator) -> None:
    """Carry their covariance over a second; the other states are carried already."""
    P, share = estimator.P, estimator.receiver_share
    for i in range(COMPONENTS):
        at = estimator.receiver_state + i
        for k in range(estimator.states):
            P[at, k] *= share
            P[k, at] *= share
        P[at, at] += (1.0 - share * share) * estimator.receiver_variance


@compiled
def white_sigma(estimator: Estimator, sigma: float, least: float) -> float:
    """Return what of a position's sigma, as the receiver tells it, is noise."""
    if not estimator.receiver:
        return sigma
    return math.sqrt(max(sigma * sigma - estimator.receiver_variance, least * least))
