"""The error of a run at an instant, split by its sources.

For each source i two reruns, with everything else as it was drawn: the source *alone* in a unit
without errors, and the unit *without* it. With e(S) the error that a set S of sources gives::

    alone_i = e({i}) - e(∅)        loss_i = e(all) - e(all without i)        part_i = their mean

In a linear system all three are the same, and the parts add up to e(all) - e(∅). Where two sources
act only together (noise and the loss of a fix), one sees nothing and the other all of it; the mean
gives each of them half, and the sum still holds (the parts are then Shapley's values). What three
and more sources do only together remains, and is stated.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.explanation.reruns import PART_S, QUANTITIES, Rerun
from rrins.host_tools.explanation.sources import (
    Sides,
    Source,
    joined,
    sides_of,
    sources_of,
    without,
)
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.samples import keep_every
from rrins.host_tools.scenario.scenario import Scenario

By = Literal["sensor", "source"]

OF: Final = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}
"""Errors that can be asked about, and which of `QUANTITIES` they are."""

_SHARED: Final = {"position": slice(0, 2), "velocity": slice(3, 5), "attitude": slice(8, 9)}
"""Components whose error a share refers to: the horizontal ones, and the heading."""

_MOST_SAMPLES: Final = 400


@dataclass(frozen=True)
class Part:
    """The contribution of a source; arrays are by `QUANTITIES`, the last row is the instant."""

    source: str  #: such as "gyro bias"
    part: str  #: which sensor, axis or component; empty where there is but one
    alone: Floats  #: shape (n, 9); the error that it gives by itself
    loss: Floats  #: shape (n, 9); what the error loses without it

    @property
    def over_time(self) -> Floats:
        """The contribution at each instant, shape (n, 9)."""
        both = np.stack([self.alone, self.loss])
        known = np.isfinite(both).all(axis=2, keepdims=True)
        count = known.sum(axis=0)
        total = np.where(known, both, 0.0).sum(axis=0)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    @property
    def value(self) -> Floats:
        """The contribution, shape (9,)."""
        return np.asarray(self.over_time[-1])

    @property
    def name(self) -> str:
        """Source and part."""
        return f"{self.source}, {self.part}" if self.part else self.source


@dataclass(frozen=True)
class Explanation:
    """The error of a run at an instant, and what contributes to it; arrays by `QUANTITIES`."""

    time_s: float  #: since navigation began
    times_s: Floats  #: shape (n,); the last is `time_s`
    error: Floats  #: shape (n, 9)
    rest: Floats  #: shape (n, 9); the error of a unit without any of the sources
    parts: list[Part]
    by: By  #: what the parts are

    @property
    def together(self) -> Floats:
        """The part that only three and more sources give together, shape (9,)."""
        values = [np.nan_to_num(part.value) for part in self.parts]
        return np.asarray(self.error[-1] - self.rest[-1] - sum(values, np.zeros(len(QUANTITIES))))

    def share(self, value: Floats, of: str) -> float:
        """Return the share of a contribution in the error: along its direction; all add up to 1."""
        error = self.error[-1, _SHARED[of]]
        square = float(error @ error)
        return float(np.nan_to_num(value[_SHARED[of]]) @ error) / square if square > 0 else 0.0

    def by_size(self, of: str = "position") -> list[tuple[str, list[Part]]]:
        """Return the parts by source: the largest source first, and in it the largest part."""
        groups: dict[str, list[Part]] = {}
        for part in self.parts:
            groups.setdefault(part.source, []).append(part)

        def size(values: list[Part]) -> float:
            total = np.nansum([one.value[_SHARED[of]] for one in values], axis=0)
            return -float(np.linalg.norm(total))

        ordered = sorted(groups.items(), key=lambda item: size(item[1]))
        return [(name, sorted(parts, key=lambda one: size([one]))) for name, parts in ordered]

    def rows(self, of: str = "position") -> list[tuple[str, str, Floats, float]]:
        """Return the lines of a table: source, part, contribution (3,), share.

        A source of several parts has a line for all, with an empty part, and one for each.
        """
        found = []
        for name, parts in self.by_size(of):
            total = np.nansum([one.value for one in parts], axis=0)
            several = len(parts) > 1
            if several:
                found.append((name, "", total[OF[of]], self.share(total, of)))
            found += [(name, p.part, p.value[OF[of]], self.share(p.value, of)) for p in parts]
        for name, value in (
            ("a unit without errors", self.rest[-1]),
            ("three or more together", self.together),
        ):
            found.append((name, "", value[OF[of]], self.share(value, of)))
        return found

    def values(self) -> JsonObject:
        """Return it as plain values."""

        def named(values: Floats) -> JsonObject:
            pairs = zip(QUANTITIES, values.tolist(), strict=True)
            return {name: value if np.isfinite(value) else None for name, value in pairs}

        return {
            "time_s": self.time_s,
            "error": named(self.error[-1]),
            "parts": [
                {
                    "source": part.source,
                    "part": part.part,
                    **named(part.value),
                    "share": {of: self.share(part.value, of) for of in OF},
                    "alone": named(part.alone[-1]),
                    "loss": named(part.loss[-1]),
                }
                for _, parts in self.by_size()
                for part in parts
            ],
            "rest": named(self.rest[-1]),
            "together": named(self.together),
        }


def runs_of(scenario: Scenario, by: By) -> int:
    """Return how many runs an explanation takes."""
    sources = sources_of(scenario)
    return 2 * len(joined(sources) if by == "source" else sources) + 2


def explain(
    scenario: Scenario,
    time_s: float,
    by: By = "sensor",
    on_progress: Callable[[int], None] = lambda done: None,
    should_stop: Callable[[], bool] = lambda: False,
    workers: int = 1,
    from_power_on: bool = False,
) -> Explanation:
    """Split the error of a run at an instant by its sources.

    Parameters
    ----------
    time_s : float
        Since navigation began; taken to the nearest sample of the run.
    from_power_on : bool
        Whether `time_s` counts from power-on instead, as times on the bus do.
    by : str
        "sensor": each sensor's errors for themselves; "source": all sensors of a kind together,
        in fewer runs.
    on_progress : callable
        Called with the runs done so far, of `runs_of`.
    should_stop : callable
        Asked now and then.
    workers : int
        Threads; 0: one for each processor.

    Raises
    ------
    RehearsalError
        When there is no such instant in the run.
    StoppedError
        When `should_stop` said so.
    """
    every = keep_every(scenario.epochs, scenario.rate_hz)
    sources = sources_of(scenario)
    if by == "source":
        sources = joined(sources)
    whole = sides_of(scenario)
    epochs, times_s, error = _first(scenario, whole, every, time_s, should_stop, from_power_on)
    on_progress(1)
    last = int(epochs[-1])

    def rerun(sides: Sides) -> Floats:
        run = Rerun(scenario, sides, every, should_stop)
        run.run_until(last)
        found, values = run.errors()
        aligned = np.full(error.shape, np.nan)
        _, ours, theirs = np.intersect1d(epochs, found, assume_unique=True, return_indices=True)
        aligned[ours] = values[theirs]
        return aligned

    def others(index: int) -> Sequence[Source]:
        return sources[:index] + sources[index + 1 :]

    wanted = [without(whole, sources)]
    wanted += [without(whole, others(k)) for k in range(len(sources))]
    wanted += [without(whole, [source]) for source in sources]
    rest, *results = _all(rerun, wanted, workers, lambda done: on_progress(1 + done))
    count = len(sources)
    parts = [
        Part(source.name, source.part, results[k] - rest, error - results[count + k])
        for k, source in enumerate(sources)
    ]
    return Explanation(float(times_s[-1]), times_s, error, rest, parts, by)


def _first(
    scenario: Scenario,
    sides: Sides,
    every: int,
    time_s: float,
    should_stop: Callable[[], bool],
    from_power_on: bool,
) -> tuple[Integers, Floats, Floats]:
    """Run the run itself; return epochs up to the instant, their times (s), and the errors."""
    run = Rerun(scenario, sides, every, should_stop)
    rate_hz, end = scenario.rate_hz, scenario.epochs
    reached = min(scenario.navigation_epoch + every, end)
    run.run_until(reached)
    while not len(run.errors()[0]):
        if reached == end:
            raise RehearsalError("explain: the firmware never navigates in this run")
        reached = min(reached + PART_S * rate_hz, end)
        run.run_until(reached)
    first = int(run.errors()[0][0])
    begin = 0 if from_power_on else first
    wanted = begin + round(time_s * rate_hz / every) * every
    if wanted < first:
        begins_s = first / rate_hz
        raise RehearsalError(f"explain: at {time_s:g} s: navigation begins at {begins_s:g} s")
    run.run_until(min(wanted, end))
    epochs, error = run.errors()
    if epochs[-1] < wanted:
        last_s = (epochs[-1] - begin) / rate_hz
        raise RehearsalError(f"explain: at {time_s:g} s: navigation ends at {last_s:g} s")
    kept = np.unique(np.linspace(0, len(epochs) - 1, _MOST_SAMPLES).round().astype(int))
    return epochs[kept], (epochs[kept] - first) / rate_hz, error[kept]


def _all(
    rerun: Callable[[Sides], Floats],
    wanted: Sequence[Sides],
    workers: int,
    on_done: Callable[[int], None],
) -> list[Floats]:
    """Run all set-ups in threads; the compiled loop holds no lock of the interpreter."""
    with ThreadPoolExecutor(
        workers or len(os.sched_getaffinity(0)), thread_name_prefix="rrins-explain"
    ) as pool:
        futures = [pool.submit(rerun, sides) for sides in wanted]
        try:
            for done, future in enumerate(as_completed(futures), 1):
                future.result()
                on_done(done)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]
