"""Finds the best half-turn schemes within limits and compares them with a known one.

Schemes are ranked by the number of residuals after a cycle, then by the rms of the horizontal
velocity error over the cycle (`rotation.merit`), then by the ranges of both axes, then by their
reversals; less is better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.rotation.analysis import analyse
from rrins.host_tools.rotation.enumeration import MIRRORS, Limits, candidates
from rrins.host_tools.rotation.half_turns import HalfTurns
from rrins.host_tools.rotation.merit import SensorSet, velocity_error
from rrins.host_tools.rotation.travel import Travel, travel_of

_CHUNK = 4096
_DIGITS = 9
"""Velocity errors that agree to this many digits count as equal, as in mirrored schemes."""


@dataclass(frozen=True)
class Candidate:
    """A scheme and its figures of merit."""

    scheme: Scheme
    mirror: str | None  #: one of `MIRRORS`: how the second half follows from the first
    #: how many of the 24 residuals (4 gyro and 4 accelerometer errors, 3 axes) do not vanish for
    #: every sensor
    remaining: int
    velocity_rms_mps: float  #: see `rrins.host_tools.rotation.merit.VelocityError`.
    travel: Travel

    @property
    def order(self) -> tuple[float, ...]:
        """Sort key; better schemes come first."""
        inner, outer = self.travel.inner, self.travel.outer
        return (
            self.remaining,
            float(_rounded(np.array(self.velocity_rms_mps))),
            inner.range_deg + outer.range_deg,
            inner.reversals + outer.reversals,
        )


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search.

    Attributes
    ----------
    better, equal : int or None
        How many of the `count` beat the reference in residuals or velocity error, and how many
        equal it in both. None if the cycle times differ, because the rms over cycles of different
        length is not comparable.
    """

    count: int  #: schemes that follow the principles and the limits
    best: tuple[Candidate, ...]  #: best first
    reference: Candidate  #: the scheme to compare with
    better: int | None
    equal: int | None


def search(
    limits: Limits,
    rimu: SensorSet,
    reference: Scheme,
    top: int = 5,
    on_progress: Callable[[int, int], None] | None = None,
) -> SearchResult:
    """Return the best schemes within limits.

    Parameters
    ----------
    limits : Limits
    rimu : SensorSet
        Sensors and their errors.
    reference : Scheme
        For comparison.
    top : int
        How many to return.
    on_progress : callable, optional
        Receives the number of schemes done and the total.

    Raises
    ------
    SearchError
        If no scheme is within the limits, or too many would have to be tried.
    """
    moves, mirrors = candidates(limits)
    half_turns = HalfTurns(rimu, limits.turn_rate_dps, limits.stand_s)
    remaining = np.empty(len(moves), dtype=int)
    rms_mps = np.empty(len(moves))
    for start in range(0, len(moves), _CHUNK):
        part = slice(start, start + _CHUNK)
        remaining[part], rms_mps[part] = half_turns.judge(moves[part])
        if on_progress:
            on_progress(min(start + _CHUNK, len(moves)), len(moves))
    rounded = _rounded(rms_mps)
    leading = [
        _candidate(half_turns.scheme(moves[i]), MIRRORS[mirrors[i]], remaining[i], rms_mps[i])
        for i in _leading(remaining, rounded, top)
    ]
    best = sorted(leading, key=lambda candidate: candidate.order)[:top]
    beside = candidate_of(reference, rimu)
    less, theirs = beside.order[:2]
    is_better = (remaining < less) | ((remaining == less) & (rounded < theirs))
    is_equal = (remaining == less) & (rounded == theirs)
    is_as_long = abs(best[0].scheme.cycle_s - reference.cycle_s) < 1e-6
    return SearchResult(
        count=len(moves),
        best=tuple(best),
        reference=beside,
        better=int(is_better.sum()) if is_as_long else None,
        equal=int(is_equal.sum()) if is_as_long else None,
    )


def candidate_of(scheme: Scheme, rimu: SensorSet) -> Candidate:
    """Evaluate any scheme."""
    variation = analyse(
        scheme, rimu.gyros, rimu.accelerometers, earth_latitude_deg=rimu.earth_latitude_deg
    )
    remaining = sum(
        int((~integrals.vanishes).any(axis=0).sum())
        for integrals in (variation.gyros, variation.accelerometers)
    )
    return _candidate(scheme, None, remaining, velocity_error(scheme, rimu).rms_mps)


def _candidate(scheme: Scheme, mirror: str | None, remaining: int, rms_mps: float) -> Candidate:
    return Candidate(scheme, mirror, int(remaining), float(rms_mps), travel_of(scheme))


def _rounded(rms_mps: Floats) -> Floats:
    scale = 10.0 ** (np.floor(np.log10(np.maximum(rms_mps, 1e-300))) - (_DIGITS - 1))
    rounded: Floats = np.round(rms_mps / scale) * scale
    return rounded


def _leading(remaining: NDArray[np.int_], rms_mps: Floats, top: int) -> NDArray[np.intp]:
    """Return the leading schemes, and all that tie with the last of them."""
    order = np.lexsort((rms_mps, remaining))
    last = order[min(top, len(order)) - 1]
    ties = (remaining == remaining[last]) & (rms_mps <= rms_mps[last])
    return np.flatnonzero((remaining < remaining[last]) | ties)
