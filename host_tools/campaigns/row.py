"""One run as one row: its inputs, what came out, or why nothing did."""

from __future__ import annotations

import json
import math
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from rrins.compiled.record import Records
from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.modes.modes import FirmwareFault
from rrins.firmware_py.core.records.memory import NavigationOutput, Ram
from rrins.firmware_py.core.sensors.calibration import Calibration
from rrins.firmware_py.core.settings import Settings, power_on
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
from rrins.host_tools.runs.results.results import Errors, compare, read_errors
from rrins.host_tools.runs.results.samples import keep_every
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.scenario import Scenario

Row = dict[str, Any]
"""A run: column and value."""

TIMES: Final = 61
"""Instants, evenly over the navigation, at which a row has its errors."""

OUTPUTS: Final = (
    "horizontal_error_m",
    "position_east_m",
    "position_north_m",
    "height_error_m",
    "velocity_east_mps",
    "velocity_north_mps",
    "roll_error_arcsec",
    "pitch_error_arcsec",
    "heading_error_arcsec",
    "max_horizontal_error_m",
    "max_abs_east_m",
    "max_abs_north_m",
    "max_velocity_error_mps",
    "rms_horizontal_error_m",
    "gyro_alarm_s",
    "gyro_left_out_s",
    "gyro_left_out",
    "accelerometer_alarm_s",
    "accelerometer_left_out_s",
    "accelerometer_left_out",
)
"""What comes out of a run, at its end unless the name says otherwise."""

SERIES: Final = ("east_over_time_m", "north_over_time_m")
MAIN: Final = "horizontal_error_m"
OK, FAULT, FAILED = "ok", "fault", "failed"
"""A run that came to its end, one whose firmware did not navigate to the end, one that broke."""

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
    "calibration": Calibration(),
    "calibration_file": None,
    **dict.fromkeys(("latitude_deg", "longitude_deg", "height_m"), 0.0),
    **dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg"), 0.0),
}
"""What the diagnostics of a firmware do not look at when they are set up."""


@lru_cache(maxsize=2)
def _with_diagnostics(settings: Settings) -> Records[Ram]:
    return Firmware(settings).ram


def switched_on(settings: Settings) -> Records[Ram]:
    """Return the memory of a firmware at power-on; its diagnostics are set up once for all runs.

    Making the diagnostics' objects takes longer than all else that happens at power-on.
    """
    ram = power_on(settings, load_contract())
    ram["diagnostics"] = _with_diagnostics(settings.model_copy(update=_ALIKE))["diagnostics"]
    return ram


@dataclass(frozen=True)
class _End:
    """What a run came to: the firmware's fault, what redundancy found, and the errors."""

    fault: str
    redundancy: JsonObject | None
    errors: Errors


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
    settings = hardware_settings(scenario)
    both = FastRun(
        switched_on(firmware),
        hardware.power_on(settings),
        hardware.pieces_of(settings),
        every,
    )
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


def _run(scenario: Scenario, should_stop: Callable[[], bool]) -> _End:
    """Run a scenario without frames, as fast as it goes."""
    every = keep_every(scenario.epochs, scenario.rate_hz)
    ram, errors = run_fast(scenario, firmware_settings(scenario), every, should_stop)
    fault = FirmwareFault(int(ram[0].modes.fault)).name
    return _End(fault, redundancy_summary(ram), errors)


def _run_with_frames(scenario: Scenario, should_stop: Callable[[], bool]) -> _End:
    """Run a scenario that needs frames: one with faults on the wire, or a bit rate."""
    with tempfile.TemporaryDirectory(prefix="rrins-") as folder:
        outcome = run_direct(scenario, Path(folder), should_stop=should_stop)
        if should_stop():
            raise RunStoppedError
        errors = read_errors(Path(folder), scenario.rate_hz)
    return _End(outcome.firmware["fault"], outcome.firmware["redundancy"], errors)


def _outputs(errors: Errors) -> Row:
    """Return the figures of a run's errors."""
    east, north = errors.position_east_m, errors.position_north_m
    radial = np.hypot(east, north)
    speed = np.hypot(errors.velocity_east_mps, errors.velocity_north_mps)
    return {
        "horizontal_error_m": float(radial[-1]),
        "position_east_m": float(east[-1]),
        "position_north_m": float(north[-1]),
        "height_error_m": float(errors.height_m[-1]),
        "velocity_east_mps": float(errors.velocity_east_mps[-1]),
        "velocity_north_mps": float(errors.velocity_north_mps[-1]),
        "roll_error_arcsec": 3600.0 * float(errors.roll_deg[-1]),
        "pitch_error_arcsec": 3600.0 * float(errors.pitch_deg[-1]),
        "heading_error_arcsec": 3600.0 * float(errors.heading_deg[-1]),
        "max_horizontal_error_m": float(radial.max()),
        "max_abs_east_m": float(np.abs(east).max()),
        "max_abs_north_m": float(np.abs(north).max()),
        "max_velocity_error_mps": float(speed.max()),
        "rms_horizontal_error_m": math.sqrt(float(np.mean(radial * radial))),
    }


def _findings(redundancy: JsonObject | None) -> Row:
    """Return when a sensor of each kind alarmed and was left out, and which."""
    row: Row = {}
    for kind, found in (redundancy or {}).items():
        one = kind.removesuffix("s")
        row[f"{one}_alarm_s"] = found["alarm_s"]
        row[f"{one}_left_out_s"] = found["isolated_s"]
        row[f"{one}_left_out"] = found["sensor"]
    return row


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
    plan = definition.plan
    row: Row = {"run": run, "seed": plan.seed(run)}
    row |= {one.column: value for one, value in plan.point(run).items()}
    try:
        row |= _came_out(definition.scenario_of(run), should_stop)
    except RunStoppedError:
        raise
    except Exception as error:  # noqa: BLE001 - a run that breaks is a row with its reason
        why = str(error) if isinstance(error, RehearsalError) else repr(error)
        row |= {"status": FAILED, "error": why}
    return row | {"wall_s": time.monotonic() - begin}


def _came_out(scenario: Scenario, should_stop: Callable[[], bool]) -> Row:
    way = _run if scenario_wire(scenario) is None else _run_with_frames
    end = way(scenario, should_stop)
    row = _findings(end.redundancy)
    if len(end.errors):
        row |= _outputs(end.errors) | _series(end.errors, scenario.duration_s)
    if end.fault != FirmwareFault.NONE.name:
        return row | {"status": FAULT, "error": f"the firmware ended in FAULT: {end.fault}"}
    if not len(end.errors):
        return row | {"status": FAULT, "error": "the firmware never navigated"}
    return row | {"status": OK, "error": None}


@dataclass(frozen=True)
class Work:
    """What a worker needs to know: the campaign, and which sources it is meant for."""

    text: str
    sources: str
    versions: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, definition: Definition) -> Work:
        """Return the work of a campaign on these sources."""
        text = json.dumps(definition.values())
        return cls(text, sources_digest(), tuple(sorted(versions().items())))

    def check(self) -> None:
        """Refuse a worker whose rows would not be ours.

        Raises
        ------
        CampaignError
        """
        if self.sources != sources_digest():
            raise CampaignError(
                f"worker {_place()}: has other sources ({sources_digest()}, here {self.sources}); "
                "install the same wheel there"
            )
        mine = versions()
        for name, version in self.versions:
            if mine.get(name) != version:
                raise CampaignError(
                    f"worker {_place()}: has {name} {mine.get(name)}, here it is {version}; "
                    "install the same there"
                )


def _place() -> str:
    return f"{socket.gethostname()}, process {os.getpid()}"


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
    for run in runs:
        try:
            rows.append(row_of(definition, run, should_stop))
        except RunStoppedError:
            break
    return rows


_prepared: set[tuple[bool | None, bool | None]] = set()


def _prepare(definition: Definition) -> None:
    """Have the loop ready that most runs of a campaign take."""
    scenario = definition.scenario
    settings = firmware_settings(scenario)
    key = (settings.redundancy is not None, settings.estimator is not None)
    if key not in _prepared:
        FastRun.of(settings, hardware_settings(scenario)).run(2)
        _prepared.add(key)
