"""One run as one row: its inputs, what came out, or why nothing did."""

from __future__ import annotations

import json
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np

from rrins.compiled.record import Floats, Records
from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.modes.modes import FirmwareFault
from rrins.firmware_py.core.records.memory import NavigationOutput, Ram
from rrins.firmware_py.core.settings import Settings, fill_unit
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.campaigns.definition import Definition
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.sources import sources_digest, versions
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware import settings as hardware
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.findings import redundancy_summary
from rrins.host_tools.runs.results.integrity import integrity_summary
from rrins.host_tools.runs.results.results import Errors, compare, east_north_m, read_errors
from rrins.host_tools.runs.results.samples import keep_every
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.together.conditions import can_share, shared_of
from rrins.host_tools.runs.together.group import AT_ONCE, Group, Shared
from rrins.host_tools.scenario.scenario import Scenario

Row = dict[str, Any]
"""A run: column and value."""

TIMES: Final = 61
"""Instants, evenly over the navigation, at which a row has its errors."""

_ERRORS: Final[dict[str, Callable[[Errors], float]]] = {
    "horizontal_error_m": lambda e: np.hypot(e.position_east_m[-1], e.position_north_m[-1]),
    "position_east_m": lambda e: e.position_east_m[-1],
    "position_north_m": lambda e: e.position_north_m[-1],
    "height_error_m": lambda e: e.height_m[-1],
    "velocity_east_mps": lambda e: e.velocity_east_mps[-1],
    "velocity_north_mps": lambda e: e.velocity_north_mps[-1],
    "roll_error_arcsec": lambda e: 3600.0 * e.roll_deg[-1],
    "pitch_error_arcsec": lambda e: 3600.0 * e.pitch_deg[-1],
    "heading_error_arcsec": lambda e: 3600.0 * e.heading_deg[-1],
    "max_horizontal_error_m": lambda e: _radial(e).max(),
    "max_abs_east_m": lambda e: np.abs(e.position_east_m).max(),
    "max_abs_north_m": lambda e: np.abs(e.position_north_m).max(),
    "max_velocity_error_mps": lambda e: np.hypot(e.velocity_east_mps, e.velocity_north_mps).max(),
    "rms_horizontal_error_m": lambda e: np.sqrt(np.mean(_radial(e) * _radial(e))),
}
"""Figures of a run's errors, at its end unless the name says otherwise."""

_FINDINGS: Final = {"alarm_s": "alarm_s", "left_out_s": "isolated_s", "left_out": "sensor"}
"""When redundancy raised an alarm for a kind of sensors, left one out, and which one."""

_BOUNDS: Final = (
    "horizontal_protection_m",
    "vertical_protection_m",
    "heading_protection_deg",
    "available_share",
)
"""Of the integrity's summary."""

OUTPUTS: Final = (
    *_ERRORS,
    *_BOUNDS,
    *(f"{kind}_{name}" for kind in ("gyro", "accelerometer") for name in _FINDINGS),
)
"""Columns of a row's results."""

SERIES: Final = ("east_over_time_m", "north_over_time_m")
MAIN: Final = "horizontal_error_m"
OK, FAULT, FAILED = "ok", "fault", "failed"
"""A run that came to its end, one whose firmware did not navigate to the end, one that broke."""

LEAST_TOGETHER, LEAST_TOGETHER_S = 16, 120
"""Fewest runs, and shortest, for which sharing a loop is worth its beginning."""

_LEADERS = 2
"""Runs that may lead: where one is to blame, the next saves all others loops of their own."""

_BEGINNING_S = 20
"""Seconds of navigation after which runs share a loop, at least."""

_PART_S = 600  # simulated, between two looks at whether to stop
_READY = threading.Lock()


def times_of(scenario: Scenario) -> list[float]:
    """Return the instants of `SERIES`, s since navigation began."""
    return [scenario.duration_s * k / (TIMES - 1) for k in range(TIMES)]


class RunStoppedError(Exception):
    """The run is not wanted any more."""


_ALIKE: Final[dict[str, Any]] = {
    "redundancy": None,
    "estimator": None,
    "integrity": None,
    "calibration_file": None,
    **dict.fromkeys(("latitude_deg", "longitude_deg", "height_m"), 0.0),
    **dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg"), 0.0),
}
"""Settings of what `fill_unit` fills in."""


@lru_cache(maxsize=2)
def _alike(settings: Settings) -> Records[Ram]:
    return Firmware(settings).ram


def switched_on(settings: Settings) -> Records[Ram]:
    """Return the memory of a firmware at power-on; what all runs share is set up once."""
    alike = _alike(settings.model_copy(update=_ALIKE))
    copied = alike.view(np.uint8).copy()  # not field by field, which takes longer
    ram = cast(Records[Ram], copied.view(alike.dtype))
    fill_unit(ram[0], settings, load_contract())
    return ram


class _End(NamedTuple):
    fault: str
    redundancy: JsonObject | None
    integrity: JsonObject | None
    errors: Errors


def _both_of(scenario: Scenario, firmware: Settings, every: int) -> FastRun:
    settings = hardware_settings(scenario)
    plant, pieces = hardware.power_on(settings), hardware.pieces_of(settings)
    return FastRun(switched_on(firmware), plant, pieces, every)


def run_fast(
    scenario: Scenario,
    firmware: Settings,
    every: int,
    should_stop: Callable[[], bool] = lambda: False,
) -> tuple[Records[Ram], Errors]:
    """Run a scenario without frames; return the firmware's memory, and the errors.

    Parameters
    ----------
    scenario : Scenario
    firmware : Settings
        Of its firmware.
    every : int
        Epochs between errors.
    should_stop : callable
        Looked at now and then.

    Raises
    ------
    RunStoppedError
        When `should_stop` says so before the end.
    """
    both = _both_of(scenario, firmware, every)
    navigation, truth = [], []
    left = scenario.epochs + 1
    while left:
        if should_stop():
            raise RunStoppedError
        part = min(left, _PART_S * scenario.rate_hz)
        track = both.run(part)
        navigation.append(track.navigation)
        truth.append(track.truth)
        left -= part
    errors = compare(
        cast(Records[NavigationOutput], np.concatenate(navigation)),
        cast(Records[Truth], np.concatenate(truth)),
        scenario.rate_hz,
    )
    return both.ram, errors


def _end_of(ram: Records[Ram], errors: Errors) -> _End:
    fault = FirmwareFault(int(ram[0].modes.fault)).name
    return _End(fault, redundancy_summary(ram), integrity_summary(ram), errors)


def _run(scenario: Scenario, should_stop: Callable[[], bool]) -> _End:
    """Run a scenario without frames, or with them if it has a wire: faults on it, or a bit rate."""
    if scenario_wire(scenario) is None:
        every = keep_every(scenario.epochs, scenario.rate_hz)
        return _end_of(*run_fast(scenario, firmware_settings(scenario), every, should_stop))
    with tempfile.TemporaryDirectory(prefix="rrins-") as folder:
        outcome = run_direct(scenario, Path(folder), should_stop=should_stop)
        if should_stop():
            raise RunStoppedError
        errors = read_errors(Path(folder), scenario.rate_hz)
    found = outcome.firmware
    return _End(found["fault"], found["redundancy"], found["integrity"], errors)


def _radial(errors: Errors) -> Floats:
    return np.hypot(errors.position_east_m, errors.position_north_m)


def _findings(redundancy: JsonObject | None) -> Row:
    return {
        f"{kind.removesuffix('s')}_{name}": found[key]
        for kind, found in (redundancy or {}).items()
        for name, key in _FINDINGS.items()
    }


def _series(errors: Errors, duration_s: float) -> Row:
    """Return the errors at the instants of `times_of`; NaN where it did not navigate."""
    instants = duration_s * np.arange(TIMES) / (TIMES - 1)
    half = 0.5 * errors.sample_interval_s + 1e-9
    at = np.clip(np.searchsorted(errors.time_s, instants - half), 0, len(errors) - 1)
    is_there = np.abs(errors.time_s[at] - instants) <= 2.0 * half
    columns = (errors.position_east_m, errors.position_north_m)
    return {
        name: np.where(is_there, column[at], np.nan).astype(np.float32)
        for name, column in zip(SERIES, columns, strict=True)
    }


def row_of(
    definition: Definition, run: int, should_stop: Callable[[], bool] = lambda: False
) -> Row:
    """Run one run; return its row, whatever comes of it.

    Raises
    ------
    RunStoppedError
        When `should_stop` says so before its end.
    """
    begin = time.monotonic()
    row = _inputs(definition, run)
    try:
        scenario = definition.scenario_of(run)
        row |= _came_out(scenario, _run(scenario, should_stop))
    except RunStoppedError:
        raise
    except Exception as error:  # noqa: BLE001 - a run that breaks is a row with its reason
        why = str(error) if isinstance(error, RehearsalError) else repr(error)
        row |= {"status": FAILED, "error": why}
    return row | {"wall_s": time.monotonic() - begin}


def _inputs(definition: Definition, run: int) -> Row:
    plan = definition.plan
    row: Row = {"run": run, "seed": plan.seed(run)}
    return row | {one.column: value for one, value in plan.point(run).items()}


def _came_out(scenario: Scenario, end: _End) -> Row:
    row = _findings(end.redundancy)
    row |= {name: (end.integrity or {}).get(name) for name in _BOUNDS}
    if len(end.errors):
        row |= {name: float(figure(end.errors)) for name, figure in _ERRORS.items()}
        row |= _series(end.errors, scenario.duration_s)
    if end.fault != FirmwareFault.NONE.name:
        return row | {"status": FAULT, "error": f"the firmware ended in FAULT: {end.fault}"}
    if not len(end.errors):
        return row | {"status": FAULT, "error": "the firmware never navigated"}
    return row | {"status": OK, "error": None}


@dataclass(frozen=True)
class Work:
    """The work of a worker: the campaign, and the sources that it is meant for."""

    text: str
    sources: str
    versions: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, definition: Definition) -> Work:
        """Return the work of a campaign on these sources."""
        text = json.dumps(definition.values())
        return cls(text, sources_digest(), tuple(sorted(versions().items())))

    def check(self) -> None:
        """Refuse a worker whose rows would differ.

        Raises
        ------
        CampaignError
        """
        place = f"worker {socket.gethostname()}, process {os.getpid()}"
        if self.sources != sources_digest():
            raise CampaignError(
                f"{place}: has other sources ({sources_digest()}, here {self.sources}); "
                "install the same wheel there"
            )
        mine = versions()
        for name, version in self.versions:
            if mine.get(name) != version:
                raise CampaignError(
                    f"{place}: has {name} {mine.get(name)}, here it is {version}; "
                    "install the same there"
                )


@lru_cache(maxsize=4)
def _definition_of(work: Work) -> Definition:
    work.check()
    definition = Definition.of(json.loads(work.text))
    _ = definition.plan  # once, not in every thread
    return definition


def rows_of(
    work: Work, runs: Sequence[int], should_stop: Callable[[], bool] = lambda: False
) -> list[Row]:
    """Run a chunk of a campaign; return a row for each run, fewer if it is to stop.

    This is what threads, processes and Dask's workers call.

    Raises
    ------
    CampaignError
        When this worker's sources are not those of the campaign.
    """
    with _READY:  # a process compiles, or loads what is compiled, once
        definition = _definition_of(work)
        _prepare(definition)
    rows: list[Row] = []
    try:
        for first in range(0, len(runs), AT_ONCE):
            rows += _rows_together(definition, runs[first : first + AT_ONCE], should_stop)
    except RunStoppedError:
        return rows
    done = {row["run"] for row in rows}
    for run in runs:
        if run in done:
            continue
        try:
            rows.append(row_of(definition, run, should_stop))
        except RunStoppedError:
            break
    return rows


def _rows_together(
    definition: Definition, runs: Sequence[int], should_stop: Callable[[], bool]
) -> list[Row]:
    """Return the rows of those runs of a chunk that can share a loop.

    Raises
    ------
    RunStoppedError
        When `should_stop` says so before their end.
    """
    begin = time.monotonic()
    scenario = definition.scenario
    if len(runs) < LEAST_TOGETHER or scenario.duration_s < LEAST_TOGETHER_S:
        return []
    every = keep_every(scenario.epochs, scenario.rate_hz)
    alike: dict[bytes, list[tuple[int, FastRun]]] = {}
    for run in runs:
        both = None
        with suppress(Exception):  # a run that cannot begin is a row with its reason
            own = definition.scenario_of(run)
            if scenario_wire(own) is None:
                both = _both_of(own, firmware_settings(own), every)
        if both is not None and can_share(both):
            alike.setdefault(shared_of(both), []).append((run, both))
    largest = max(alike.values(), key=len, default=[])
    if len(largest) < LEAST_TOGETHER:
        return []
    rows: list[Row] = []
    for leader in range(_LEADERS):
        led = largest[leader:]
        found = Group([both for _, both in led], scenario.epochs + 1, every).run(should_stop)
        if found is None:
            raise RunStoppedError
        rows += [
            _inputs(definition, run) | _came_out(scenario, _end_together(shared, scenario.rate_hz))
            for (run, _), shared in zip(led, found, strict=True)
            if shared is not None
        ]
        if len(rows) > leader + 1:
            break
    wall_s = (time.monotonic() - begin) / max(1, len(rows))
    return [row | {"wall_s": wall_s} for row in rows]


def at_once(definition: Definition) -> int:
    """Return how many runs a chunk should have at least: many if they share a loop."""
    scenario = definition.scenario_of(0)
    if scenario.duration_s < LEAST_TOGETHER_S or scenario_wire(scenario) is not None:
        return 1
    one = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    return AT_ONCE if can_share(one) else 1


def _end_together(shared: Shared, rate_hz: int) -> _End:
    """Return the end of a run of a group; of its attitude and height it has the last errors."""
    truth, samples = shared.truth, shared.samples
    last = compare(shared.navigation, truth[-1:], rate_hz)
    east, north = east_north_m(
        samples[:, 0], samples[:, 1], truth["latitude"], truth["longitude"], truth["height"]
    )
    velocity = samples[:, 2:] - truth["velocity_n"][:, :2]
    errors = replace(
        last,
        epoch=truth["epoch"],
        time_s=(truth["epoch"] - truth["epoch"][0]) / rate_hz,
        position_east_m=east,
        position_north_m=north,
        velocity_east_mps=velocity[:, 0],
        velocity_north_mps=velocity[:, 1],
    )
    return _end_of(shared.ram, errors)


_prepared: set[tuple[bool | None, bool | None]] = set()


def _prepare(definition: Definition) -> None:
    """Have the loops ready that most runs of a campaign take."""
    scenario = definition.scenario
    settings = firmware_settings(scenario)
    key = (settings.redundancy is not None, settings.estimator is not None)
    if key not in _prepared:
        plain = hardware_settings(scenario)
        FastRun.of(settings, plain).run(2)
        if at_once(definition) > 1:
            rate_hz = scenario.rate_hz
            epochs = min(scenario.epochs, scenario.navigation_epoch + _BEGINNING_S * rate_hz)
            Group([FastRun.of(settings, plain) for _ in range(2)], epochs, rate_hz).run()
        _prepared.add(key)
