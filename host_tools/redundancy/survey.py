"""Sets of sensors side by side: figures for tables, pictures, `--json`."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from scipy.special import bdtr

from rrins.compiled.record import Floats
from rrins.host_tools.files import JsonObject
from rrins.host_tools.redundancy.candidates import Candidate
from rrins.host_tools.redundancy.monte_carlo import PATIENCE_S, Delays, Fault, Trials, run_trials
from rrins.host_tools.redundancy.sensor_kinds import KINDS, Kind
from rrins.host_tools.redundancy.theory import HALF, LEARNED_S, MOST, WAYS, Finder
from rrins.host_tools.rounding import kept

WITHIN_S = (10, 60, 600)
"""Times in which the smallest fault is asked for, s."""

SIZES = 6
"""Faults of a kind for which delays are given, where none are named."""

_CURVE_POINTS = 16
_CHANCE = 1e-3
_LATER, _LATER_S = 1.2, 0.05
"""How far theory may be off: times, and s."""

_ROUND = (1.0, 2.0, 5.0)

Pair = tuple[float, float]
"""A figure that half of the faults reach, and that 95 % reach."""


@dataclass(frozen=True)
class Group:
    """Sensors of a kind whose faults reach the parity alike."""

    sensors: tuple[int, ...]  #: from 0
    share: float  #: of the square of a fault that reaches the parity
    #: of each way, of each of `WITHIN_S`: the smallest step found, of the noisiest sensor
    smallest: dict[str, dict[int, Pair]]
    sizes: Floats  #: shape (n,)
    delays: dict[str, Floats]  #: shape (n, 2); of each way and size, by theory, s

    @property
    def words(self) -> str:
        """The numbers of the sensors, from 1."""
        first, last = self.sensors[0] + 1, self.sensors[-1] + 1
        if len(self.sensors) > 2 and last - first + 1 == len(self.sensors):
            return f"{first}-{last}"
        return ", ".join(str(sensor + 1) for sensor in self.sensors)


@dataclass(frozen=True)
class Set:
    """The sensors of one kind of a candidate."""

    kind: Kind
    finder: Finder
    groups: tuple[Group, ...]


@dataclass
class Survey:
    """Figures of a candidate."""

    candidate: Candidate
    sets: tuple[Set, ...]  #: of each of `KINDS`
    trials: Trials | None = field(default=None)  #: None without a Monte Carlo

    def tried(self, of: Set, group: Group, size: float) -> Delays | None:
        """Return what the runs gave for a size; None without runs."""
        if self.trials is None:
            return None
        delays = self.trials.delays.get(Fault(of.kind, group.sensors, size))
        return delays if delays and delays.alarm else None

    def smallest_tried(self, of: Set, group: Group, way: str, within_s: int) -> float:
        """Return the smallest step tried that half of the runs found in time; infinity: none."""
        faults = () if self.trials is None else self.trials.delays
        sizes = (one.size for one in faults if (one.kind, one.sensors) == (of.kind, group.sensors))
        return min(
            (size for size in sizes if (tried := self.tried(of, group, size)) is not None
             and tried.quantile(way, HALF) <= within_s),
            default=math.inf,
        )  # fmt: skip

    def doubted(self, of: Set, group: Group, size: float) -> tuple[str, ...]:
        """Return the ways of which theory says more than the runs show.

        So many runs are later than 95 % are by theory that chance makes it once in 1000.
        """
        tried = self.tried(of, group, size)
        if tried is None:
            return ()
        at = int(np.argmin(np.abs(group.sizes - size)))
        found = []
        for way in WAYS:
            delays, most_s = np.array(getattr(tried, way)), float(group.delays[way][at][1])
            in_time = int(np.sum(delays <= most_s * _LATER + _LATER_S))
            if most_s < PATIENCE_S and bdtr(in_time, len(delays), MOST) < _CHANCE:
                found.append(way)
        return tuple(found)


def _groups(finder: Finder) -> list[tuple[int, ...]]:
    """Return the sensors in groups that are alike, within 1 %, as are their rivals."""
    found: list[list[int]] = []
    features = [
        np.append(finder.significance(sensor), finder.rivals[sensor])
        for sensor in range(finder.count)
    ]
    for sensor, own in enumerate(features):
        for group in found:
            if np.allclose(own, features[group[0]], rtol=0.01, atol=0.0):
                group.append(sensor)
                break
        else:
            found.append([sensor])
    return [tuple(sensors) for sensors in found]


@dataclass(frozen=True)
class _Part:
    """A group of sensors before it is known which faults to try."""

    finder: Finder
    sensors: tuple[int, ...]

    @cached_property
    def noisiest(self) -> int:
        """The sensor for which a group's figures hold."""
        return max(self.sensors, key=self.finder.own_noise)

    @cached_property
    def smallest(self) -> dict[str, dict[int, Pair]]:
        """The smallest faults, as in `Group`."""
        find = partial(self.finder.smallest, self.noisiest)
        return {
            way: {
                within_s: (find(within_s, way, HALF), find(within_s, way, MOST))
                for within_s in WITHIN_S
            }
            for way in WAYS
        }

    def group(self, tried: Sequence[float]) -> Group:
        """Return the group with the delays of the faults to try, and of a curve about them."""
        curve = np.geomspace(tried[0] / 2, tried[-1] * 2, _CURVE_POINTS) if tried else np.zeros(0)
        sizes = np.union1d(curve, np.asarray(tried))
        chances = [self.finder.chances(self.noisiest, float(size)) for size in sizes]
        delays = {
            way: np.array([[one.delay_s(way, p) for p in (HALF, MOST)] for one in chances])
            for way in WAYS
        }
        share = float(self.finder.share[self.noisiest])
        return Group(self.sensors, share, self.smallest, sizes, delays)


def round_sizes(smallest: float) -> tuple[float, ...]:
    """Return `SIZES` round numbers, from the one below the smallest fault on."""
    decade = math.floor(math.log10(smallest))
    numbers = [float(f"{m}e{d}") for d in range(decade, decade + SIZES) for m in _ROUND]
    first = max(k for k, number in enumerate(numbers) if number <= smallest * 1.001)
    return tuple(numbers[first : first + SIZES])


def _sizes(parts: Iterable[_Part]) -> tuple[float, ...]:
    """Return the faults to try: from the smallest that any way finds in the longest time."""
    found = [part.smallest[way][WITHIN_S[-1]][0] for part in parts for way in WAYS]
    finite = [size for size in found if math.isfinite(size)]
    return round_sizes(min(finite)) if finite else ()


class Study:
    """A study of some candidates.

    Parameters
    ----------
    candidates : sequence of Candidate
    sizes : mapping of str to sequence of float
        Faults to try, of a kind's name; round ones where there are none.
    on_step : callable
        Called with what is being done, after each step of the work.
    """

    def __init__(
        self,
        candidates: Sequence[Candidate],
        sizes: Mapping[str, Sequence[float]],
        on_step: Callable[[str], None] = lambda what: None,
    ) -> None:
        self._on_step = on_step
        parts: dict[tuple[int, str], list[_Part]] = {}
        for number, candidate in enumerate(candidates):
            for kind in KINDS:
                finder = Finder(candidate.scenario, kind)
                parts[number, kind.name] = [_Part(finder, group) for group in _groups(finder)]
                on_step(f"theory of {candidate.name}")
        self.sizes = {
            kind.name: tuple(
                sizes.get(kind.name)
                or _sizes(p for (_, name), of in parts.items() if name == kind.name for p in of)
            )
            for kind in KINDS
        }
        self.surveys = []
        for number, candidate in enumerate(candidates):
            sets = []
            for kind in KINDS:
                of_kind = parts[number, kind.name]
                groups = tuple(part.group(self.sizes[kind.name]) for part in of_kind)
                sets.append(Set(kind, of_kind[0].finder, groups))
                on_step(f"theory of {candidate.name}")
            self.surveys.append(Survey(candidate, tuple(sets)))

    @staticmethod
    def steps(candidates: int, runs: int) -> int:
        """Return how often `on_step` is called for a study of so many candidates."""
        return candidates * (2 * len(KINDS) + runs)

    def run(self, runs: int, seed: int, stop: threading.Event) -> None:
        """Let a Monte Carlo try each fault."""
        for survey in self.surveys:
            tried = [
                Fault(one.kind, group.sensors, size)
                for one in survey.sets
                for group in one.groups
                for size in self.sizes[one.kind.name]
            ]

            def done(name: str = survey.candidate.name) -> None:
                self._on_step(f"runs of {name}")

            survey.trials = run_trials(survey.candidate.scenario, tried, runs, seed, done, stop)
            if stop.is_set():
                return

    def values(self) -> JsonObject:
        """Return all figures as plain values; None: not found, or never."""
        return {
            "learned_s": LEARNED_S,
            "candidates": [_survey_values(survey, self.sizes) for survey in self.surveys],
        }


def _pair(values: Sequence[float] | Floats) -> JsonObject:
    return {"half": kept(float(values[0])), "95_percent": kept(float(values[1]))}


def _survey_values(survey: Survey, sizes: Mapping[str, Sequence[float]]) -> JsonObject:
    scenario, trials = survey.candidate.scenario, survey.trials
    values: JsonObject = {
        "name": survey.candidate.name,
        "false_alarms_per_1000_h": scenario.redundancy.false_alarms_per_1000_h,
        "sound": None
        if trials is None
        else {"hours": round(trials.sound_h, 4), "runs_with_an_alarm": trials.alarms},
    }
    for one in survey.sets:
        finder = one.finder
        values[one.kind.name] = {
            "count": finder.count,
            "unit": one.kind.unit,
            "thresholds": {
                "windows_of_seconds": kept(finder.second_factor),
                "windows_of_epochs": kept(finder.epoch_factor),
                "mean_square": kept(finder.noise_limit),
            },
            "groups": [
                {
                    "sensors": [sensor + 1 for sensor in group.sensors],
                    "share": kept(group.share),
                    "smallest": {
                        way: {
                            f"{s}_s": _pair(pair)
                            | {"tried": kept(survey.smallest_tried(one, group, way, s))}
                            for s, pair in found.items()
                        }
                        for way, found in group.smallest.items()
                    },
                    "delays_s": [
                        _size_values(survey, one, group, size) for size in sizes[one.kind.name]
                    ],
                }
                for group in one.groups
            ],
        }
    return values


def _size_values(survey: Survey, one: Set, group: Group, size: float) -> JsonObject:
    at = int(np.argmin(np.abs(group.sizes - size)))
    values: JsonObject = {
        "fault": size,
        "theory": {way: _pair(delays[at]) for way, delays in group.delays.items()},
        "monte_carlo": None,
    }
    tried = survey.tried(one, group, size)
    if tried is not None:
        values["monte_carlo"] = {
            way: _pair([tried.quantile(way, p) for p in (HALF, MOST)]) for way in WAYS
        } | {"runs": len(tried.alarm), "right": tried.right, "wrong": tried.wrong}
        values["theory_fails"] = list(survey.doubted(one, group, size))
    return values
