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
from rrins.host_tools.runs.results.estimator_log import EstimatorLog
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.parity_log import ParityLog
from rrins.host_tools.runs.results.samples import (
    NAVIGATION_SAMPLES,
    TRUTH_SAMPLES,
    SampleBuffer,
    SampleFile,
    keep_every,
)
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.sides.firmware_job import firmware_progress, firmware_summary
from rrins.host_tools.runs.sides.hardware_job import hardware_summary
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.serial.lines import open_lines

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
    scenario : Scenario
    folder : Path, optional
        Where the logs of both sides go.
    on_progress : callable, optional
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
    RowsError
        When a log cannot be written.
    """
    log_every = keep_every(scenario.epochs, scenario.rate_hz)
    navigation = SampleFile(None if folder is None else folder / NAVIGATION_SAMPLES)
    truth_file = SampleFile(None if folder is None else folder / TRUTH_SAMPLES)
    truth_rows = SampleBuffer(Truth, truth_file)
    firmware = Firmware(firmware_settings(scenario), NavigationTrace(log_every, navigation.append))
    wire = scenario_wire(scenario)
    hardware = Hardware(hardware_settings(scenario), wire)
    error_ppm = scenario.firmware.clock_error_ppm
    sides = DirectExchange(hardware, firmware, truth_rows, log_every, error_ppm, wire)
    lines = open_lines(serial, firmware, on_note)
    lines_every = lines.every
    progress_every = _PROGRESS_S * scenario.rate_hz
    parity = ParityLog(firmware.ram, folder, scenario.duration_s)
    estimates = EstimatorLog(firmware.ram, folder, scenario.duration_s)
    every = math.gcd(lines_every, parity.every, estimates.every, progress_every)
    start = time.monotonic()
    epoch = -1
    with (
        closing(truth_file),
        closing(navigation),
        closing(lines),
        closing(parity),
        closing(estimates),
    ):
        try:
            while epoch < scenario.epochs:
                epoch = sides.run(scenario.epochs + 1, every)
                if lines_every and epoch % lines_every == 0:
                    lines.run(epoch)
                if parity.every and epoch % parity.every == 0:
                    parity.run()
                if estimates.every and epoch % estimates.every == 0:
                    estimates.run()
                if epoch % progress_every:
                    continue
                if should_stop():
                    break
                if on_progress is not None:
                    on_progress(firmware_progress(firmware), _hardware_progress(hardware, epoch))
        finally:
            truth_rows.flush()
            parity.run()
            estimates.run()
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
    rows = SampleFile(None if folder is None else folder / NAVIGATION_SAMPLES)
    truth_rows = SampleFile(None if folder is None else folder / TRUTH_SAMPLES)
    firmware = Firmware(firmware_settings(scenario), NavigationTrace(log_every, rows.append))
    hardware = Hardware(hardware_settings(scenario))
    run = FastRun(firmware.ram, hardware.plant, hardware.pieces)
    parity = ParityLog(firmware.ram, folder, scenario.duration_s)
    estimates = EstimatorLog(firmware.ram, folder, scenario.duration_s)
    left = scenario.epochs + 1
    start = time.monotonic()
    with closing(truth_rows), closing(rows), closing(parity), closing(estimates):
        while left and not should_stop():
            track = run.run(min(left, _PROGRESS_S * scenario.rate_hz))
            left -= min(left, _PROGRESS_S * scenario.rate_hz)
            firmware.trace.extend(track.navigation)
            parity.run()
            estimates.run()
            truth_rows.append(track.truth[track.truth["epoch"] % log_every == 0])
            if on_progress is not None:
                on_progress(
                    firmware_progress(firmware), _hardware_progress(hardware, firmware.epoch)
                )
        summary = firmware_summary(firmware)
    return Outcome(summary, hardware_summary(hardware), time.monotonic() - start)
