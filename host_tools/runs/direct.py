"""The direct shell: both sides in one process, no bus.

`run_direct` passes the same frames as a bus would; `run_without_frames` the same payloads, which is
faster. The navigation is the same to the bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial.settings import NO_LINES, SerialSettings
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.runs.exchange import DirectExchange
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.samples import SampleBuffer, keep_every, sample_files
from rrins.host_tools.runs.results.seconds_log import SecondsLog
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.sides.firmware_job import firmware_progress, firmware_summary
from rrins.host_tools.runs.sides.hardware_job import hardware_summary
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.serial.lines import Tasks, open_lines

Progress = Callable[[JsonObject, JsonObject], None]
"""Called with the firmware's and the hardware's progress, as the sides report it."""

_PROGRESS_S = 20


def run_direct(
    scenario: Scenario,
    folder: Path | None = None,
    on_progress: Progress | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    serial: SerialSettings = NO_LINES,
    on_note: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Run a scenario to its end.

    Parameters
    ----------
    folder : Path, optional
        Where the logs of both sides go.
    should_stop : callable
        Asked now and then; the run ends early when it says so.
    serial : SerialSettings
        The firmware's serial lines.
    on_note : callable
        Told what the user is to know of them.

    Returns
    -------
    Outcome

    Raises
    ------
    SamplesError
        When a log cannot be written.
    """
    log_every = keep_every(scenario.epochs, scenario.rate_hz)
    navigation, truth_file = sample_files(folder)
    truth = SampleBuffer(Truth, truth_file)
    firmware = Firmware(firmware_settings(scenario), NavigationTrace(log_every, navigation.append))
    wire = scenario_wire(scenario)
    hardware = Hardware(hardware_settings(scenario), wire)
    error_ppm = scenario.firmware.clock_error_ppm
    sides = DirectExchange(hardware, firmware, truth, log_every, error_ppm, wire)
    lines = open_lines(serial, firmware, on_note)
    seconds = SecondsLog(firmware.ram, folder, scenario.duration_s)
    tasks = Tasks((lines.every, lines.run), (seconds.every, seconds.run))
    progress_every = _PROGRESS_S * scenario.rate_hz
    every = math.gcd(tasks.every, progress_every)
    start = time.monotonic()
    epoch = -1
    with closing(truth_file), closing(navigation), closing(lines), closing(seconds):
        try:
            while epoch < scenario.epochs:
                epoch = sides.run(scenario.epochs + 1, every)
                tasks.run(epoch)
                if epoch % progress_every:
                    continue
                if should_stop():
                    break
                if on_progress is not None:
                    on_progress(firmware_progress(firmware), _hardware_progress(hardware, epoch))
        finally:
            truth.flush()
            seconds.run()
            summary = firmware_summary(firmware) | lines.statistics()
    return Outcome(summary, hardware_summary(hardware), time.monotonic() - start)


def _hardware_progress(hardware: Hardware, epoch: int) -> JsonObject:
    truth = hardware.truth
    return {
        "epoch": epoch,
        "latitude": float(truth["latitude"][0]),
        "longitude": float(truth["longitude"][0]),
    }


def run_without_frames(
    scenario: Scenario,
    folder: Path | None = None,
    on_progress: Progress | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Run a scenario that has no fault on the wire to its end, as `run_direct` does."""
    assert scenario_wire(scenario) is None, "a wire needs frames"
    log_every = keep_every(scenario.epochs, scenario.rate_hz)
    navigation, truth = sample_files(folder)
    firmware = Firmware(firmware_settings(scenario), NavigationTrace(log_every, navigation.append))
    hardware = Hardware(hardware_settings(scenario))
    run = FastRun(firmware.ram, hardware.plant, hardware.pieces)
    seconds = SecondsLog(firmware.ram, folder, scenario.duration_s)
    left = scenario.epochs + 1
    start = time.monotonic()
    with closing(truth), closing(navigation), closing(seconds):
        while left and not should_stop():
            epochs = min(left, _PROGRESS_S * scenario.rate_hz)
            track = run.run(epochs)
            left -= epochs
            firmware.trace.extend(track.navigation)
            seconds.run()
            truth.append(track.truth[track.truth["epoch"] % log_every == 0])
            if on_progress is not None:
                where = _hardware_progress(hardware, firmware.epoch)
                on_progress(firmware_progress(firmware), where)
        summary = firmware_summary(firmware)
    return Outcome(summary, hardware_summary(hardware), time.monotonic() - start)
