"""A vehicle that sways about a known place: its way from there, as states of the filter.

Waves move a ship to and fro, but not away: of its way s, the integral u stays small, too. Each of
east and north is an oscillator that noise drives, ``ü + 2 ζ ω u̇ + ω² u = w`` with ``s = u̇``, whose
spectrum falls to zero for long periods. So the mean over minutes is the place, although each second
is off by tens of centimetres. Gelb, *Applied Optimal Estimation* (1974), section 4.5, for
shaping filters.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.estimator_records import (
    LATITUDE,
    LONGITUDE,
    SWAY_EAST,
    SWAY_NORTH,
    Estimator,
)

_PERIOD_S, _DAMPING = 12.0, 0.1
"""Of the oscillator. Waves of 5 to 16 s fit it as they are: the place, which counts, is the mean
over minutes, and the variance of the way is taken too large (`_SWAY_S` of the alignment).
"""

_LEAST_WAY = 0.01
"""m"""

FREQUENCY = 2.0 * math.pi / _PERIOD_S
"""rad/s"""


def set_up(estimator: Estimator) -> None:
    """Write how the pairs of states go over a second, and what that adds to a pair's covariance.

    The covariance of a pair that has swayed for long is ``diag(1 / ω², 1)`` for a way of 1 m.
    """
    damped = FREQUENCY * math.sqrt(1.0 - _DAMPING**2)
    cosine, sine = math.cos(damped), math.sin(damped) / damped
    fade, half = math.exp(-_DAMPING * FREQUENCY), _DAMPING * FREQUENCY
    transition = fade * np.array(
        [[cosine + half * sine, sine], [-(FREQUENCY**2) * sine, cosine - half * sine]]
    )
    lasting = np.diag([FREQUENCY**-2, 1.0])
    estimator.sway_transition[:] = transition
    estimator.sway_spread[:] = lasting - transition @ lasting @ transition.T


@compiled
def begin(estimator: Estimator, position_sigma: float) -> None:
    """Begin with the navigation at the place: what it is off by is the way itself."""
    P, variance = estimator.P, max(position_sigma, _LEAST_WAY) ** 2
    estimator.sway_way[:] = 0.0
    for first in (SWAY_EAST, SWAY_NORTH):
        at = estimator.sway_state + first
        P[at, at] = variance / (FREQUENCY * FREQUENCY)
        P[at + 1, at + 1] = variance
        state, radius = LONGITUDE, estimator.east_radius
        if first == SWAY_NORTH:
            state, radius = LATITUDE, estimator.north_radius
        P[state, state] = max(P[state, state], variance / (radius * radius))
        P[state, at + 1] = variance / radius
        P[at + 1, state] = variance / radius


@compiled
def carry(estimator: Estimator) -> None:
    """Take what the filter found, and carry the ways over a second."""
    way, x, phi = estimator.sway_way, estimator.x, estimator.sway_transition
    for first in (SWAY_EAST, SWAY_NORTH):
        one = way[first] + x[estimator.sway_state + first]
        two = way[first + 1] + x[estimator.sway_state + first + 1]
        way[first] = phi[0, 0] * one + phi[0, 1] * two
        way[first + 1] = phi[1, 0] * one + phi[1, 1] * two


@compiled
def propagate(estimator: Estimator, position_sigma: float) -> None:
    """Carry the covariance of the ways over a second; the other states are carried already."""
    P, n = estimator.P, estimator.states
    for first in (SWAY_EAST, SWAY_NORTH):
        _turn_pair(P, n, estimator.sway_state + first, estimator.sway_transition)
    variance = max(position_sigma, _LEAST_WAY) ** 2
    for first in (SWAY_EAST, SWAY_NORTH):
        at = estimator.sway_state + first
        for i in range(2):
            for k in range(2):
                P[at + i, at + k] += variance * estimator.sway_spread[i, k]


@compiled
def _turn_pair(P: Floats, n: int, at: int, phi: Floats) -> None:
    for k in range(n):
        one, two = P[at, k], P[at + 1, k]
        P[at, k] = phi[0, 0] * one + phi[0, 1] * two
        P[at + 1, k] = phi[1, 0] * one + phi[1, 1] * two
    for k in range(n):
        one, two = P[k, at], P[k, at + 1]
        P[k, at] = phi[0, 0] * one + phi[0, 1] * two
        P[k, at + 1] = phi[1, 0] * one + phi[1, 1] * two
