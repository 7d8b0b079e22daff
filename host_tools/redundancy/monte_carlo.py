"""The same by a Monte Carlo: whole runs of both sides, a fault put in when the parity is learned.

Each run goes to where the faults begin; from a copy of its memory there each fault is tried, once
as the scenario is, once with nothing to tell that the vehicle stands. Runs go in threads, for the
compiled loop holds no lock of the interpreter.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field

import numpy as np

from rrins.host_tools.hardware import faults
from rrins.host_tools.redundancy.sensor_kinds import KINDS, Kind
from rrins.host_tools.redundancy.theory import LEARNED_S
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

PATIENCE_S = 600
"""For how long a fault is waited for to be found, s."""

_NO_ROWS = 1 << 40
"""Epochs between those that are written down: never."""

_PART_S = 100
"""Simulated time between two looks at whether to stop."""

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Multiples of it spread evenly over a unit."""

_ONE_PARITY = 4
"""Sensors up to which the parity cannot tell which one fails."""


@dataclass(frozen=True)
class Fault:
    """A step on one of some sensors, which take turns over the runs."""

    kind: Kind
    sensors: tuple[int, ...]  #: from 0
    size: float  #: in the unit of the kind


@dataclass
class Delays:
    """Time that each run took to find a fault, s; infinity where it did not in `PATIENCE_S`.

    Attributes
    ----------
    standing, parity : list of float
        Until a sensor was left out: as the scenario is, and by the parity alone.
    right, wrong : int
        Sensors that were left out, of both ways.
    """

    #: until it was known that there is one, by the parity alone
    alarm: list[float] = field(default_factory=list)
    standing: list[float] = field(default_factory=list)
    parity: list[float] = field(default_factory=list)
    right: int = 0
    wrong: int = 0

    def quantile(self, way: str, probability: float) -> float:
        """Return a quantile of the delays of a way, s."""
        delays: list[float] = getattr(self, way)
        return float(np.quantile(delays, probability, method="inverted_cdf"))


@dataclass
class Trials:
    """Results of the runs of a scenario."""

    delays: dict[Fault, Delays]
    sound_h: float = 0.0  #: hours in which no sensor failed
    alarms: int = 0  #: of the runs that raised one in that time; they are left out of `delays`


@dataclass(frozen=True)
class _Found:
    """A fault as a run found it: delays in s, the sensor that was left out, from 0, or -1."""

    alarm_s: float
    isolated_s: float
    sensor: int


def _look(run: FastRun, kind: Kind, since: int, rate_hz: int) -> _Found:
    """Return what is known now of a fault that began with an epoch."""
    parity = kind.parity(run.ram[0])
    sensor = int(parity.isolated)
    begun = int(parity.found_epoch if sensor >= 0 else parity.alarm_epoch)
    alarm_s = (begun + 1 - since) / rate_hz if begun >= since else math.inf
    isolated_s = (int(parity.isolated_epoch) + 1 - since) / rate_hz if sensor >= 0 else math.inf
    return _Found(alarm_s, isolated_s, sensor)


def _try(
    base: FastRun, fault: Fault, sensor: int, knows_rest: bool, stop: threading.Event
) -> _Found:
    """Return what is found of a fault, from a copy of the memory of a run."""
    run = FastRun(base.ram.copy(), base.plant.copy(), base.pieces, _NO_ROWS)
    plant, state = run.plant[0], run.ram[0]
    rate_hz = round(1e9 / int(plant.period_ns))
    since = int(plant.epoch)
    faults.put(plant, int(fault.kind.fault), sensor, since, -1, fault.size * fault.kind.si)
    can_name = knows_rest or int(fault.kind.fusion(state).count) > _ONE_PARITY
    if not knows_rest:
        fault.kind.parity(state).standing_limit = -1.0  # whatever is measured means motion
    alarm_s = math.inf
    found = _Found(math.inf, math.inf, -1)
    for _ in range(PATIENCE_S):
        run.run(rate_hz)
        found = _look(run, fault.kind, since, rate_hz)
        alarm_s = min(alarm_s, found.alarm_s)
        is_done = found.sensor >= 0 or (not can_name and math.isfinite(alarm_s))
        if is_done or stop.is_set():
            break
    return _Found(alarm_s, found.isolated_s, found.sensor)


_Tried = list[tuple[Fault, int, _Found, _Found]]


def _is_sound(run: FastRun) -> bool:
    """Return whether no sensor has raised an alarm."""
    parities = [kind.parity(run.ram[0]) for kind in KINDS]
    return all(int(one.alarm_epoch) <= 0 and int(one.excluded) == 0 for one in parities)


def _run(
    scenario: Scenario, tried: Sequence[Fault], number: int, stop: threading.Event
) -> _Tried | None:
    """Return what a run finds of each fault; None if it raised an alarm before.

    Faults begin anywhere in a second, spread evenly over the runs.
    """
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario), _NO_ROWS)
    run.run(scenario.navigation_epoch + int(number * _GOLDEN % 1.0 * scenario.rate_hz))
    for _ in range(0, LEARNED_S, _PART_S):
        run.run(_PART_S * scenario.rate_hz)
        if stop.is_set():
            return []
    if not _is_sound(run):
        return None
    results = []
    for fault in tried:
        sensor = fault.sensors[number % len(fault.sensors)]
        at_rest, alone = (_try(run, fault, sensor, knows, stop) for knows in (True, False))
        if stop.is_set():
            return []
        results.append((fault, sensor, at_rest, alone))
    return results


def _take(trials: Trials, results: _Tried) -> None:
    for fault, sensor, at_rest, alone in results:
        delays = trials.delays[fault]
        delays.alarm.append(alone.alarm_s)
        delays.standing.append(at_rest.isolated_s)
        delays.parity.append(alone.isolated_s)
        for found in (at_rest, alone):
            delays.right += found.sensor == sensor
            delays.wrong += found.sensor not in (sensor, -1)


def run_trials(
    scenario: Scenario,
    tried: Sequence[Fault],
    runs: int,
    seed: int = 1,
    on_done: Callable[[], None] = lambda: None,
    stop: threading.Event | None = None,
) -> Trials:
    """Return what runs with consecutive seeds find of each of some faults.

    Parameters
    ----------
    scenario : Scenario
        Compares its sensors; has no faults.
    tried : sequence of Fault
    runs : int
    seed : int
        Of the first run.
    on_done : callable
        Called after each run.
    stop : threading.Event, optional
        Once set, the runs end early; what they gave is not to be used then.
    """
    stop = stop or threading.Event()
    trials = Trials({fault: Delays() for fault in tried})
    scenarios = [scenario.varied(seed=seed + number) for number in range(runs)]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        waiting: list[Future[_Tried | None]] = [
            pool.submit(_run, one, tried, number, stop) for number, one in enumerate(scenarios)
        ]
        try:
            for future in _in_order(waiting, on_done):
                trials.sound_h += LEARNED_S / 3600
                results = future.result()
                if results is None:
                    trials.alarms += 1
                else:
                    _take(trials, results)
        finally:
            if any(not future.done() for future in waiting):
                stop.set()
                pool.shutdown(wait=True, cancel_futures=True)
    return trials


def _in_order(
    waiting: Sequence[Future[_Tried | None]], on_done: Callable[[], None]
) -> Iterator[Future[_Tried | None]]:
    """Yield all runs in order, once all are done; report each as it ends."""
    for future in as_completed(waiting):
        future.result()
        on_done()
    yield from waiting
