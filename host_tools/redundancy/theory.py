"""Faults that a set of sensors can find, computed: no run, no random numbers.

The mean of each test is that of `mean_path`; its noise has a standard deviation of one. A fault is
taken as found with the probability of the one test that finds it best. Where a window begins, of
those that do not overlap, is even in time: the average is taken. The vehicle stands, and is known
to stand: where navigation drifts so that it seems to move, runs find less.

Which sensor: the firmware decides by a likelihood ratio. For correlated unit normals T_j and T_k of
means m and ρ m, ``T_j² - T_k²`` has the mean ``s² = m² (1 - ρ²)`` and the variance
``4 s² + 4 (1 - ρ²)``; it is taken as normal, for the rival of the largest ρ.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.redundancy_records import (
    FINE_LEVELS,
    SECOND_LEVELS,
    WINDOWS_S,
    Parity,
)
from rrins.firmware_py.core.redundancy import isolation
from rrins.firmware_py.core.redundancy import parity as parities
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.redundancy.mean_path import follow
from rrins.host_tools.redundancy.sensor_kinds import Kind
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario.scenario import Scenario

LEARNED_S = 2000
"""For how long the parity has been learned when the fault comes, s: over a cycle of a scheme."""

_PLANE = 2
"""Dimensions of a parity that any two sensors explain."""

HORIZON_S = 1200
"""Longest delay that is looked for, s."""

_PARTS = 4
"""Times of a second at which chances are computed, after the first."""

_MINUTE = WINDOWS_S.index(64)  # level

HALF, MOST = 0.5, 0.95
"""Probabilities for which delays and smallest faults are given."""

WAYS: Final = ("alarm", "standing", "parity")
"""Knowledge about a fault: that there is one; of which sensor, standing; by the parity alone.

The first and the last need no reference: they hold in motion, too.
"""


@dataclass(frozen=True)
class Chances:
    """Probabilities that a fault is found by a time, of each of `WAYS`."""

    time_s: Floats  #: shape (n,); since the fault
    found: dict[str, Floats]  #: of each way, increasing

    def delay_s(self, way: str, probability: float) -> float:
        """Return after how long the fault is found with a probability; infinity: not in time."""
        beyond = np.flatnonzero(self.found[way] >= probability)
        return float(self.time_s[beyond[0]]) if beyond.size else math.inf


class Finder:
    """The tests of one kind of sensors of a scenario, the parity learned.

    Parameters
    ----------
    scenario : Scenario
    kind : Kind

    Attributes
    ----------
    count : int
        Sensors.
    share : array, shape (count,)
        Of the square of a fault that reaches the parity; 0: the sensor is not checked.
    second_factor, epoch_factor, noise_limit : float
        The firmware's thresholds.
    """

    def __init__(self, scenario: Scenario, kind: Kind) -> None:
        ram = Firmware(firmware_settings(scenario)).ram
        state = ram[0]
        self.kind, self._ram = kind, ram
        self._fusion, self._learned = kind.fusion(state), kind.parity(state)
        self.count = int(self._fusion.count)
        self._rate_hz = scenario.rate_hz
        everything = (1 << self.count) - 1
        work = np.empty((3, 3))
        parities.compare(self._learned, self._fusion, everything, scenario.rate_hz, work)
        follow(self._learned, self._fusion, 0, 0.0, LEARNED_S, *_room(LEARNED_S))
        self.share = np.diag(self._learned.projector)[: self.count].copy()
        self.second_factor = float(self._learned.second_factor)
        self.epoch_factor = float(self._learned.epoch_factor)
        self.noise_limit = float(self._learned.noise_limit)
        self._at_the_end: dict[tuple[int, float, int], dict[str, float]] = {}

    def is_checked(self, sensor: int) -> bool:
        """Return whether a fault of a sensor, from 0, reaches the parity."""
        return bool(self.share[sensor] > parities.CHECKED_FROM)

    def significance(self, sensor: int) -> Floats:
        """Return what a step of one unit puts into each window, in standard deviations."""
        deviation = np.sqrt(self._learned.variance[sensor])
        signal = self.share[sensor] * self.kind.si * np.array(WINDOWS_S)
        return np.asarray(
            np.divide(signal, deviation, where=deviation > 0, out=np.zeros_like(signal))
        )

    def own_noise(self, sensor: int) -> float:
        """Return the variance of a sensor's own sum over a minute."""
        drift = float(self._learned.drift_variance[sensor, _MINUTE])
        return float(self._learned.white_variance[sensor]) * WINDOWS_S[_MINUTE] + drift

    @functools.cached_property
    def rivals(self) -> Floats:
        """The largest correlation of each sensor's parity with what a rival makes: 1 means alike.

        Rivals are another sensor, two others where the parity has three dimensions, and all alike.
        """
        projector = self._learned.projector[: self.count, : self.count]
        deviation = np.sqrt(np.diag(projector))
        checked = deviation > math.sqrt(parities.CHECKED_FROM)
        scale = np.where(checked, deviation, np.inf)
        correlation = projector / np.outer(scale, scale)
        whole, rank = float(correlation.sum()), round(float(np.trace(projector)))
        alike = whole > parities.CHECKED_FROM
        largest = np.square(correlation.sum(axis=1)) / whole if alike else np.zeros(self.count)
        for size in (1, 2) if rank > _PLANE else (1,):
            for others in itertools.combinations(np.flatnonzero(checked), size):
                along = correlation[:, others]
                both = correlation[np.ix_(others, others)]
                shares = np.einsum("ij,jk,ik->i", along, np.linalg.pinv(both), along)
                shares[list(others)] = 0.0
                largest = np.maximum(largest, shares)
        return np.asarray(np.sqrt(np.minimum(largest, 1.0)))

    def chances(self, sensor: int, fault: float, horizon_s: int = HORIZON_S) -> Chances:
        """Return the probabilities that a step is found.

        Parameters
        ----------
        sensor : int
            From 0.
        fault : float
            In the unit of the kind.
        horizon_s : int
        """
        step = fault * self.kind.si
        alone, at_rest = _room(horizon_s)
        if horizon_s:
            parity = Parity.zeros(1)
            parity[0] = self._learned
            follow(parity[0], self._fusion, sensor, step, horizon_s, alone, at_rest)
        checked = self.is_checked(sensor)
        short_s = np.arange(1, self._rate_hz) / self._rate_hz
        long_s = np.arange(_PARTS, horizon_s * _PARTS + 1) / _PARTS
        time_s = np.concatenate([short_s, long_s])
        found = {"standing": _by_rest(at_rest, self.second_factor, checked, self.count)}
        found |= self._by_seconds(alone, sensor) if checked else {}
        parts_s = np.arange(horizon_s * _PARTS + 1) / _PARTS
        chances = {
            way: np.interp(time_s, parts_s, found[way]) if way in found else np.zeros(len(time_s))
            for way in WAYS
        }
        if checked:
            by_epochs = self._by_epochs(sensor, step, time_s)
            chances["alarm"] = np.maximum(chances["alarm"], by_epochs)
        return Chances(
            time_s, {way: np.maximum.accumulate(values) for way, values in chances.items()}
        )

    def _by_seconds(self, alone: Floats, sensor: int) -> dict[str, Floats]:
        """Return, part by part, the probability of the best window of whole seconds."""
        mean = _in_parts(np.abs(alone))
        alarm = ndtr(mean - self.second_factor)
        named = np.minimum(alarm, _clear(mean, self.rivals[sensor]))
        return {"alarm": _over_a_second(alarm), "parity": _over_a_second(named)}

    def _by_epochs(self, sensor: int, step: float, time_s: Floats) -> Floats:
        """Return the probability of the best window shorter than a second, at some times."""
        parity, best = self._learned, np.zeros(len(time_s))
        signal = abs(parity.projector[sensor, sensor] * step)
        for level in range(parity.levels):
            deviation = math.sqrt(parity.epoch_variance[sensor, level])
            if deviation == 0.0:
                continue
            window_s = (1 << level) / self._rate_hz
            slope = max(signal / deviation, 1e-9)
            full = slope * window_s - self.epoch_factor
            end_s = np.minimum(time_s, window_s)
            begin_s = np.clip(time_s - window_s, 0.0, window_s)
            partial = _integral(slope * end_s - self.epoch_factor)
            partial = partial - _integral(slope * begin_s - self.epoch_factor)
            whole_s = np.clip(time_s - window_s, 0.0, window_s)
            chance = (partial / slope + whole_s * ndtr(full)) / window_s
            best = np.maximum(best, chance)
        return best

    def smallest(self, sensor: int, within_s: int, way: str, probability: float) -> float:
        """Return the smallest step that is found within a time with a probability.

        In the unit of the kind; infinity where none is.
        """

        def is_found(fault: float) -> bool:
            key = (sensor, fault, within_s)
            if key not in self._at_the_end:  # other ways and probabilities try many of these, too
                found = self.chances(*key).found
                self._at_the_end[key] = {one: float(found[one][-1]) for one in WAYS}
            return self._at_the_end[key][way] >= probability

        low, high = -6.0, 8.0  # decades
        if not is_found(10.0**high):
            return math.inf
        while high - low > 0.002:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if is_found(10.0**middle) else (middle, high)
        return float(10.0**high)


def _room(seconds: int) -> tuple[Floats, Floats]:
    return np.zeros((seconds, SECOND_LEVELS)), np.zeros((seconds, FINE_LEVELS, 3))


def _in_parts(values: Floats) -> Floats:
    """Return values at whole seconds, and nothing at zero, in parts of a second."""
    seconds = np.arange(len(values) + 1)
    parts = np.arange(len(values) * _PARTS + 1) / _PARTS
    known = np.vstack([np.zeros((1, values.shape[1])), values])
    return np.stack([np.interp(parts, seconds, column) for column in known.T], axis=1)


def _over_a_second(chance: Floats) -> Floats:
    """Return the best column of means over the second before, for a fault begins anywhere in it."""
    sums = np.cumsum(0.5 * (chance[1:] + chance[:-1]), axis=0)
    sums = np.vstack([np.zeros((1, chance.shape[1])), sums])
    before = np.vstack([np.zeros((_PARTS, chance.shape[1])), sums[:-_PARTS]])
    return np.asarray(((sums - before) / _PARTS).max(axis=1))


def _clear(mean: Floats, rival: Floats | float) -> Floats:
    """Return the probability that the likelihood ratio to the closest rival decides."""
    apart = np.maximum(1.0 - np.square(rival), 0.0)
    square = np.square(mean) * apart
    deviation = np.sqrt(4.0 * square + 4.0 * apart)
    known = apart > 1e-6
    return np.where(known, ndtr((square - isolation.RATIO) / np.where(known, deviation, 1.0)), 0.0)


def _by_rest(at_rest: Floats, factor: float, checked: bool, count: int) -> Floats:
    """Return the probability of the best window of the test at standstill, part by part."""
    if not checked or not len(at_rest):
        return np.zeros(len(at_rest) * _PARTS + 1)
    mean, rival, left = (_in_parts(np.abs(at_rest[..., k])) for k in range(3))
    named = np.minimum(ndtr(mean - factor), _clear(mean, rival))
    # Against a motion: the chi-square of the parity, and that of what the fault leaves.
    margin = left - 2.0 - isolation.MOTION * max(1, count - 3)
    deviation = np.sqrt(4.0 * left + 2.0 * (count - 3) + 2.0 * (count - 1))
    return _over_a_second(np.minimum(named, ndtr(margin / deviation)))


def _integral(x: Floats) -> Floats:
    """Return the integral of the normal distribution up to x."""
    return np.asarray(x * ndtr(x) + np.exp(-0.5 * np.square(x)) / math.sqrt(2.0 * math.pi))
