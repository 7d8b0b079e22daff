"""Runs with one fault each, from copies of the memory of a run that has come to the phase.

What the unit says is what a tester would read: alarms of the parity, and at the end of each second
the tests of trouble codes that fail, and whether the navigation calls itself not available, where
the same run without the fault does not.
"""

from __future__ import annotations

import math
import random
import re
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.modes.modes import FirmwareFault
from rrins.firmware_py.core.monitoring import monitor
from rrins.firmware_py.core.records.integrity_records import IntegrityStatus
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.firmware_py.core.records.trouble_table import TROUBLES
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware import faults
from rrins.host_tools.hardware.fault_kinds import AIDS, EVERY, HardwareFault, Part
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.integrity.fmeda.rates import FailureMode
from rrins.host_tools.integrity.phases import instants
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

_KINDS: Final = {Part.GYRO: "gyros", Part.ACCELEROMETER: "accelerometers"}
_BLAME: Final = re.compile(
    r"((?:gyro|accelerometer)_\d+|axis_inner|axis_outer|gnss|odometer|altimeter)"
    r"_(?:left_out|rejected|lost|encoder|not_following|drive|abandoned)"
)
_BLAMED: Final = (
    *(found[1] if (found := _BLAME.fullmatch(trouble.name)) else "" for trouble in TROUBLES),
    "",
)
"""The part that each trouble code calls faulty, empty where it names none; last, of the status of
the integrity."""

_KIND, _BIT = (np.array([getattr(one, key) for one in TROUBLES]) for key in ("kind", "bit"))
_PART_S: Final = 20
"""Simulated time between two looks at whether to stop."""


@dataclass(frozen=True)
class Trial:
    """A fault to try."""

    mode: FailureMode
    part: str  #: as trouble codes name it, such as gyro_3
    target: int  #: of the fault: index of the sensor, the axis or the direction
    phase: str
    epoch: int  #: in which it begins
    seed: int
    value: float | None  #: of the kind's parameter, in the unit of its key

    def scenario(self, base: Scenario, window_s: float) -> Scenario:
        """Return the scenario that repeats the trial."""
        fault: JsonObject = {"kind": self.mode.fault.word, "at_s": self.epoch / base.rate_hz}
        target = self.mode.fault.target
        if target is not None:
            fault[target.key] = target.names[self.target] if target.names else self.target + 1
        if self.mode.fault.parameter is not None:
            fault[self.mode.fault.parameter.key] = self.value
        end_s = (self.epoch - base.navigation_epoch) / base.rate_hz + window_s
        return base.varied(seed=self.seed, faults=[fault], duration_s=end_s)


@dataclass(frozen=True)
class Finding:
    """The consequences of a fault; times in s since it began, infinity for never."""

    trial: Trial
    detected_s: float  #: until it said that something is wrong
    isolated_s: float  #: until the part that fails was left out or refused
    wrong: tuple[str, ...]  #: sound parts that were left out or refused
    dangerous_s: float  #: until the position was off by more than the alert limit
    effect_m: float  #: largest horizontal distance to the run without the fault
    error_m: float  #: largest horizontal error of the position
    ended: str  #: the firmware's reason to end in FAULT; empty if it did not

    @property
    def wrong_sensors(self) -> tuple[str, ...]:
        """The sound sensors and axes that were left out; a refused aid comes back."""
        return tuple(part for part in self.wrong if part not in AIDS)

    @property
    def is_dangerous(self) -> bool:
        """Whether the position was off by more than the alert limit."""
        return math.isfinite(self.dangerous_s)

    @property
    def is_unnoticed_danger(self) -> bool:
        """Whether it was, before the unit said that something is wrong."""
        return self.is_dangerous and self.detected_s > self.dangerous_s

    @property
    def is_latent(self) -> bool:
        """Whether neither the unit nor the position showed the fault."""
        return not self.is_dangerous and not math.isfinite(self.detected_s)


def parts_of(scenario: Scenario, fault: HardwareFault) -> list[str]:
    """Return the parts of a scenario that a kind of fault may befall."""
    rimu, part = scenario.rimu, fault.part
    if part in _KINDS:
        one = _KINDS[part].removesuffix("s")
        return [f"{one}_{k + 1}" for k in range(len(getattr(rimu, _KINDS[part])))]
    if part is Part.AXIS:
        is_turning = scenario.mode == "rotating"
        return (
            [f"axis_{name}" for name in fault.target.names] if fault.target and is_turning else []
        )
    return [] if getattr(scenario, part.aid) is None else [part.aid]


def trials_of(
    scenario: Scenario, modes: tuple[FailureMode, ...], runs: int, seed: int
) -> list[Trial]:
    """Return the trials: run by run, phase by phase, each mode of each part."""
    found = []
    for run in range(seed, seed + runs):
        for phase, epoch in instants(scenario).items():
            for mode in modes:
                for index, part in enumerate(parts_of(scenario, mode.fault)):
                    chance = random.Random(f"{run} {phase} {mode.name} {part}")
                    target = mode.fault.target
                    if mode.fault.part is Part.GNSS_POSITION and target is not None:
                        index = chance.randrange(len(target.names))
                    elif target is None:
                        index = EVERY
                    value = mode.draw(chance)
                    found.append(Trial(mode, part, index, phase, epoch, run, value))
    return found


@dataclass(frozen=True)
class _Followed:
    """The seconds of a run from the phase on."""

    epochs: NDArray[np.int64]  #: of the errors
    east_m: Floats
    north_m: Floats
    codes: NDArray[np.bool_]  #: of `_BLAMED` that have failed so far, shape (seconds, codes)
    alarm_epoch: int  #: of the first alarm of a parity; -1: none
    isolated: dict[str, int]  #: sensor that was left out: epoch
    ended: str


def _parities(state: Any) -> Iterator[tuple[str, Any]]:
    for name in _KINDS.values():
        yield name.removesuffix("s"), state.redundancy[name]


def _follow(run: FastRun, seconds: int, stop: threading.Event) -> _Followed | None:
    """Run on for some seconds; None if it is to stop."""
    state, since = run.ram[0], int(run.plant[0].epoch)
    navigation, truth = [], []
    codes = np.zeros((seconds, len(_BLAMED)), bool)
    alarm, isolated = -1, dict[str, int]()
    for second in range(seconds):
        if second % _PART_S == 0 and stop.is_set():
            return None
        track = run.run(run.every)
        navigation.append(track.navigation)
        truth.append(track.truth)
        monitor.watch(state, 0)
        codes[second, :-1] = state.diagnostics.failing[_KIND] >> _BIT & 1
        codes[second, -1] = state.integrity.status == IntegrityStatus.NOT_AVAILABLE
        for name, parity in _parities(state):
            known = [int(parity.alarm_epoch), int(parity.found_epoch)]
            fresh = [epoch for epoch in known if epoch >= since]
            alarm = min([epoch for epoch in (alarm, *fresh) if epoch >= 0], default=-1)
            if int(parity.isolated) >= 0 and int(parity.isolated_epoch) >= since:
                sensor = f"{name}_{int(parity.isolated) + 1}"
                isolated.setdefault(sensor, int(parity.isolated_epoch))
    rate_hz = run.every
    errors = compare(
        cast(Records[NavigationOutput], np.concatenate(navigation)),
        cast(Records[Truth], np.concatenate(truth)),
        rate_hz,
    )
    fault = FirmwareFault(int(state.modes.fault))
    return _Followed(
        errors.epoch,
        errors.position_east_m,
        errors.position_north_m,
        np.logical_or.accumulate(codes),
        alarm,
        isolated,
        "" if fault is FirmwareFault.NONE else fault.name,
    )


def _judged(
    trial: Trial, found: _Followed, healthy: _Followed, alert_m: float, rate_hz: int
) -> Finding:
    """Return what a unit made of a fault, by the same run without it."""
    seconds = np.arange(1, len(found.codes) + 1)
    is_new = found.codes & ~healthy.codes

    def first_s(codes: NDArray[np.bool_]) -> float:
        at = np.flatnonzero(codes.any(axis=1))
        return float(seconds[at[0]]) if len(at) else math.inf

    def since_s(epoch: int) -> float:
        return (epoch + 1 - trial.epoch) / rate_hz

    is_alarm_new = found.alarm_epoch >= 0 and found.alarm_epoch != healthy.alarm_epoch
    alarm_s = since_s(found.alarm_epoch) if is_alarm_new else math.inf
    blamed = {
        part: first_s(is_new[:, [of == part for of in _BLAMED]])
        for k, part in enumerate(_BLAMED)
        if part and is_new[:, k].any()
    }
    blamed |= {part: since_s(epoch) for part, epoch in found.isolated.items() if part in blamed}
    _, ours, theirs = np.intersect1d(
        found.epochs, healthy.epochs, assume_unique=True, return_indices=True
    )
    error = np.hypot(found.east_m[ours], found.north_m[ours])
    sound = np.hypot(healthy.east_m[theirs], healthy.north_m[theirs])
    effect = np.hypot(
        found.east_m[ours] - healthy.east_m[theirs], found.north_m[ours] - healthy.north_m[theirs]
    )
    beyond = np.flatnonzero((error > alert_m) & (sound <= alert_m))
    return Finding(
        trial,
        detected_s=min(alarm_s, first_s(is_new)),
        isolated_s=blamed.get(trial.part, math.inf),
        wrong=tuple(sorted(blamed.keys() - {trial.part})),
        dangerous_s=since_s(int(found.epochs[ours][beyond[0]])) if len(beyond) else math.inf,
        effect_m=float(effect.max(initial=0.0)),
        error_m=float(error.max(initial=0.0)),
        ended=found.ended,
    )


def _copy(base: FastRun) -> FastRun:
    return FastRun(base.ram.copy(), base.plant.copy(), base.pieces, base.every)


def _try(
    base: FastRun,
    healthy: _Followed,
    seconds: int,
    alert_m: float,
    stop: threading.Event,
    trial: Trial,
) -> Finding | None:
    run = _copy(base)
    parameter = trial.mode.fault.parameter
    value = 0.0 if parameter is None or trial.value is None else trial.value * parameter.si
    faults.put(run.plant[0], int(trial.mode.fault), trial.target, trial.epoch, -1, value)
    found = _follow(run, seconds, stop)
    return None if found is None else _judged(trial, found, healthy, alert_m, base.every)


def run_trials(
    scenario: Scenario,
    trials: list[Trial],
    window_s: int,
    alert_m: float,
    workers: int,
    stop: threading.Event,
    on_done: Callable[[], None] = lambda: None,
) -> list[Finding]:
    """Return what came of the trials, fewer if it was stopped.

    Parameters
    ----------
    scenario : Scenario
        Has no faults.
    trials : list of Trial
        Of `trials_of`.
    window_s : int
        For how long each fault is followed, at most.
    alert_m : float
        Horizontal alert limit.
    workers : int
        Threads.
    """
    found: list[Finding] = []
    end = scenario.navigation_epoch + round(scenario.duration_s * scenario.rate_hz)
    bases = dict.fromkeys((trial.seed, trial.phase, trial.epoch) for trial in trials)
    with ThreadPoolExecutor(workers) as pool:
        for seed, phase, epoch in bases:
            one = scenario.varied(seed=seed)
            base = FastRun.of(firmware_settings(one), hardware_settings(one), one.rate_hz)
            base.run(epoch)
            seconds = min(window_s, (end - epoch) // one.rate_hz)
            healthy = _follow(_copy(base), seconds, stop)
            if healthy is None:
                break
            of_base = [t for t in trials if (t.seed, t.phase) == (seed, phase)]
            tried = partial(_try, base, healthy, seconds, alert_m, stop)
            for result in pool.map(tried, of_base):
                if result is not None:
                    found.append(result)
                    on_done()
    return found
