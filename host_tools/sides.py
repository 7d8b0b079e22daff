"""The two sides of a rehearsal, each as the job of a process: its shell, its log, its reports."""

from __future__ import annotations

import math
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dbc.frame import frame_array
from dbc.values import FaultAction
from firmware_py.diagnostics.store import StoreError
from firmware_py.loop import Firmware, open_memories
from firmware_py.loop import run_lockstep as run_firmware_lockstep
from firmware_py.loop import run_realtime as run_firmware_realtime
from firmware_py.modes import Fault, Mode
from firmware_py.serial_lines import NO_LINES, SerialSettings
from firmware_py.trace import NavigationTrace
from host_tools.errors import ParameterFileError
from host_tools.fault_tables import FaultOfSensor, FaultOnWire
from host_tools.hardware.loop import Hardware
from host_tools.hardware.loop import run_lockstep as run_hardware_lockstep
from host_tools.hardware.loop import run_realtime as run_hardware_realtime
from host_tools.hardware.memory import TRUTH
from host_tools.injection.messages import fault_commands
from host_tools.outfit import firmware_settings, hardware_settings, scenario_wire
from host_tools.port import Address, frame_of_message, open_port
from host_tools.realtime import LatenessHistogram, enter_realtime
from host_tools.report import Report
from host_tools.rows import RowBuffer, RowFile, keep_every
from host_tools.scenario import Scenario
from host_tools.serial.lines import Tasks, open_lines
from host_tools.wire import Wire

NAVIGATION_ROWS = "navigation.rows"
TRUTH_ROWS = "truth.rows"

REALTIME = 1.0
"""The speed that means real time: both sides by their own clocks, not in lockstep."""

_ATTENTIVE_SPEED = 20.0  # up to which a report comes every simulated second
_COUNTERS = ("crc_errors", "counter_errors", "missing_frames", "bridged_epochs", "overruns")


@dataclass(frozen=True)
class Job:
    """What a side is to do.

    Attributes
    ----------
    scenario : Scenario
    address : Address
        The bus.
    speed : float or None
        `REALTIME`, a factor for lockstep, or None for lockstep as fast as it goes.
    folder : Path or None
        Where the log goes.
    report_fd : int or None
        Pipe to the rehearsal.
    core : int or None
        Processor to stay on. Two processes that wait for each other are several times faster on
        one than on two.
    attach_wait_s : float
        How long the firmware waits for the bus to come up.
    await_peers : tuple of str
        Other peers of the embedded bus without which the hardware does not begin.
    serial : SerialSettings
        The firmware's serial lines.
    parameters : Path or None
        File of the firmware's parameter memory.
    """

    scenario: Scenario
    address: Address
    speed: float | None
    folder: Path | None = None
    report_fd: int | None = None
    core: int | None = None
    attach_wait_s: float = 0.0
    await_peers: tuple[str, ...] = ()
    serial: SerialSettings = NO_LINES
    parameters: Path | None = None

    @property
    def is_realtime(self) -> bool:
        """Whether the side runs by its own clock."""
        return self.speed == REALTIME

    @property
    def report_every(self) -> int:
        """Epochs from one progress report to the next."""
        slow = self.speed is not None and self.speed <= _ATTENTIVE_SPEED
        return self.scenario.rate_hz * (1 if slow else 10)

    def log_path(self, name: str) -> Path | None:
        """Return where a log goes."""
        return None if self.folder is None else self.folder / name


def _settle(job: Job) -> dict[str, bool]:
    """Give the process the place among others that its job asks for."""
    if job.is_realtime:
        return enter_realtime()
    if job.core is not None:
        os.sched_setaffinity(0, {job.core})
    return {}


def prepare_firmware(scenario: Scenario) -> None:
    """Run one step aside, so that all that is compiled is compiled or loaded."""
    aside = Firmware(firmware_settings(scenario))
    aside.step(frame_array(1), 0, 0, 0)


def prepare_hardware(scenario: Scenario) -> None:
    """Run some steps aside, so that all that is compiled is compiled or loaded.

    Faults are put in, too: what they need is not to be compiled while time is real.
    """
    aside = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    commands = frame_array(2)
    on_wire = fault_commands(FaultAction.INJECT, FaultOnWire(kind="drop"))
    of_hardware = fault_commands(FaultAction.INJECT, FaultOfSensor(kind="gyro_bias"))
    for frame, message in zip(commands, (*on_wire, *of_hardware), strict=True):
        frame_of_message(frame, message)
    for epoch in range(3):
        aside.open_epoch(epoch, commands, len(commands) if epoch == 1 else 0)


def _prepare(report: Report, side: str, scenario: Scenario) -> None:
    report.send("preparing", side=side)
    start = time.monotonic()
    {"firmware": prepare_firmware, "hardware": prepare_hardware}[side](scenario)
    report.send("prepared", side=side, seconds=round(time.monotonic() - start, 2))


def firmware_summary(firmware: Firmware) -> dict[str, Any]:
    """Return what the firmware has to say of a run, in plain values."""
    state = firmware.ram[0]
    return {
        "mode": firmware.mode.name,
        "fault": Fault(int(state["modes"]["fault"])).name,
        "epoch": firmware.epoch,
        "epochs_navigated": firmware.trace.epochs,
        "navigation_sha256": firmware.trace.sha256(),
        "scheme_cycles": int(state["sequencer"]["cycle"]),
        "axes_not_following": [bool(flag) for flag in state["sequencer"]["not_following"]],
        "frames_received": firmware.frames_received,
        "frames_sent": firmware.frames_sent,
        "calibration": _calibration_used(firmware),
        "clock_jumps": int(state["clock"]["jumps"]),
        "faults": {name: int(state["faults"][name]) for name in _COUNTERS},
    }


def _calibration_used(firmware: Firmware) -> dict[str, Any] | None:
    """Return the file of the calibration and what it says of the sensors; None without one."""
    settings = firmware.settings
    if settings.calibration_file is None:
        return None
    values = settings.calibration.model_dump(mode="json", exclude_unset=True)
    return {"file": settings.calibration_file} | values


def firmware_progress(firmware: Firmware) -> dict[str, Any]:
    """Return where the firmware believes to be, for a progress line."""
    state = firmware.ram[0]
    output, running = state["navigation"], state["sequencer"]
    return {
        "epoch": firmware.epoch,
        "mode": firmware.mode.name,
        "fault": Fault(int(state["modes"]["fault"])).name,
        "position": int(running["position"]) + 1 if running["running"] else 0,
        "navigating": firmware.mode in (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING),
        "latitude": float(output["latitude"]),
        "longitude": float(output["longitude"]),
        "overruns": int(state["faults"]["overruns"]),
    }


def _open_firmware(job: Job, trace: NavigationTrace) -> Firmware:
    settings = firmware_settings(job.scenario)
    try:
        stores = None if job.parameters is None else open_memories(job.parameters)
        return Firmware(settings, trace, stores)
    except StoreError as error:
        raise ParameterFileError(f"parameter memory {error}") from error


def run_firmware(job: Job) -> dict[str, Any]:
    """Run the firmware until it is shut down; return its summary.

    Raises
    ------
    BusError
        When the bus is not there, is taken, or ends.
    ParameterFileError
        When the parameter memory cannot be had.
    """
    report = Report(job.report_fd)
    scenario = job.scenario
    _prepare(report, "firmware", scenario)
    rows = RowFile(job.log_path(NAVIGATION_ROWS))
    trace = NavigationTrace(keep_every(scenario.epochs, scenario.rate_hz), rows.append)
    firmware = _open_firmware(job, trace)
    lateness = LatenessHistogram()

    def progress(epoch: int) -> None:
        report.send("progress", side="firmware", **firmware_progress(firmware))

    lines = open_lines(job.serial, firmware, lambda text: report.note("firmware", text))
    tasks = Tasks((job.report_every, progress), (lines.every, lines.take))
    summary: dict[str, Any] = {}
    try:
        permitted = _settle(job)  # locking memory takes long: before anyone waits for us
        port = open_port(job.address, "firmware", job.attach_wait_s)
    except BaseException:
        lines.close()
        firmware.close()
        raise
    try:
        report.send("ready", side="firmware", **permitted)
        if job.is_realtime:
            run_firmware_realtime(
                firmware,
                port,
                lateness,
                scenario.firmware.clock_error_ppm,
                tasks.every,
                tasks.run,
            )
        else:
            port.meet()
            run_firmware_lockstep(
                firmware, port, scenario.firmware.clock_error_ppm, tasks.every, tasks.run
            )
    finally:
        summary = firmware_summary(firmware) | {"lateness_us": lateness.summary()}
        summary |= lines.statistics()
        lines.close()
        rows.close()
        port.close()
        firmware.close()
        report.send("summary", side="firmware", **summary)
    return summary


def run_hardware(job: Job) -> dict[str, Any]:
    """Run the hardware to the end of the scenario, which shuts the firmware down.

    Raises
    ------
    BusError
        When the bus cannot be had or ends.
    SideLostError
        When no firmware comes, or it goes before the end.
    """
    report = Report(job.report_fd)
    scenario = job.scenario
    _prepare(report, "hardware", scenario)
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    file = RowFile(job.log_path(TRUTH_ROWS))
    rows = RowBuffer(TRUTH, file)
    lateness = LatenessHistogram()
    log_every = keep_every(scenario.epochs, scenario.rate_hz)
    every = math.gcd(log_every, job.report_every)
    truth = hardware.plant["truth"]

    def on_epoch(epoch: int) -> None:
        if epoch % log_every == 0:
            rows.take(truth)
        if epoch % job.report_every == 0:
            report.send(
                "progress",
                side="hardware",
                epoch=epoch,
                latitude=float(truth["latitude"][0]),
                longitude=float(truth["longitude"][0]),
            )

    port = open_port(job.address, "hardware")
    epochs = scenario.epochs + 1  # the last one shuts the firmware down
    try:
        report.send("ready", side="hardware")
        permitted = _settle(job)
        port.meet(job.await_peers)
        report.send("started", side="hardware", **permitted)
        if job.is_realtime:
            run_hardware_realtime(hardware, port, lateness, epochs, every, on_epoch)
        else:
            run_hardware_lockstep(hardware, port, epochs, job.speed, every, on_epoch)
    finally:
        rows.flush()
        file.close()
        port.close()
        summary = hardware_summary(hardware) | {"lateness_us": lateness.summary()}
        report.send("summary", side="hardware", **summary)
    return summary


def hardware_summary(hardware: Hardware) -> dict[str, Any]:
    """Return what the hardware has to say of a run, in plain values."""
    plant = hardware.plant[0]
    return {
        "epochs": int(plant["epoch"]),
        "frames_received": hardware.frames_received,
        "frames_sent": hardware.frames_sent,
        "faults": {name: int(plant["counters"][name]) for name in plant["counters"].dtype.names},
        "wire": hardware.wire.statistics() if isinstance(hardware.wire, Wire) else None,
    }
