"""The firmware as the job of a process: its shell, its samples, its reports."""

from __future__ import annotations

from contextlib import ExitStack, closing

from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.diagnostics.store import StoreError
from rrins.firmware_py.loop import Firmware, open_memories, run_lockstep, run_realtime
from rrins.host_tools.errors import ParameterFileError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.findings import FINDINGS
from rrins.host_tools.runs.results.pipe import ReportPipe
from rrins.host_tools.runs.results.samples import NAVIGATION_SAMPLES, SampleFile, keep_every
from rrins.host_tools.runs.results.seconds_log import SecondsLog
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.runs.sides.job import Job, open_port, prepare, settle
from rrins.host_tools.runs.sides.realtime import LatenessHistogram
from rrins.host_tools.serial.lines import Tasks, open_lines

_COUNTERS = (
    "crc_errors",
    "counter_errors",
    "disagreeing_frames",
    "missing_frames",
    "bridged_epochs",
    "overruns",
)


def firmware_summary(firmware: Firmware) -> JsonObject:
    """Return the firmware's summary of a run, in plain values."""
    state = firmware.ram[0]
    sequencer = state.sequencer
    return (
        {
            "mode": firmware.mode.name,
            "fault": FirmwareFault(int(state.modes.fault)).name,
            "epoch": firmware.epoch,
            "epochs_navigated": firmware.trace.epochs,
            "navigation_sha256": firmware.trace.sha256() if firmware.trace.epochs else None,
            "scheme_cycles": int(sequencer.cycle),
            "axes_not_following": [bool(flag) for flag in sequencer.not_following],
            "axis_interruptions": [int(count) for count in sequencer.interruptions],
            "axes_abandoned": [bool(flag) for flag in sequencer.abandoned],
            "frames_received": firmware.frames_received,
            "frames_sent": firmware.frames_sent,
            "calibration": _calibration_used(firmware),
            "clock_jumps": int(state.clock.jumps),
            "faults": {name: int(state.faults[name]) for name in _COUNTERS},
        }
        | {finding.key: finding.read(firmware.ram) for finding in FINDINGS}
        | _xcp_used(firmware)
    )


def _xcp_used(firmware: Firmware) -> JsonObject:
    """Return how XCP was used; nothing if the scenario has none."""
    return {} if firmware.xcp is None else {"xcp": dict(firmware.xcp.summary())}


def _calibration_used(firmware: Firmware) -> JsonObject | None:
    """Return the calibration file and its values; None without one."""
    settings = firmware.settings
    if settings.calibration_file is None:
        return None
    values = settings.calibration.model_dump(mode="json", exclude_unset=True)
    return {"file": settings.calibration_file} | values


def firmware_progress(firmware: Firmware) -> JsonObject:
    """Return mode, position and scheme, for a progress line."""
    state = firmware.ram[0]
    output, running = state["navigation"], state["sequencer"]
    return {
        "epoch": firmware.epoch,
        "mode": firmware.mode.name,
        "fault": FirmwareFault(int(state["modes"]["fault"])).name,
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


def run_firmware(job: Job) -> JsonObject:
    """Run the firmware until it is shut down; return its summary.

    Raises
    ------
    BusError
        When the bus is not there, is taken, or ends.
    ParameterFileError
        When the parameter memory cannot be had.
    """
    report = ReportPipe(job.report_fd)
    scenario = job.scenario
    prepare(report, "firmware", scenario)
    with ExitStack() as ends:
        rows = ends.enter_context(closing(SampleFile(job.log_path(NAVIGATION_SAMPLES))))
        trace = NavigationTrace(keep_every(scenario.epochs, scenario.rate_hz), rows.append)
        firmware = ends.enter_context(closing(_open_firmware(job, trace)))
        lateness = LatenessHistogram(scenario.period_ns)

        def progress(epoch: int) -> None:
            report.send("progress", side="firmware", **firmware_progress(firmware))

        lines = open_lines(job.serial, firmware, lambda text: report.note("firmware", text))
        ends.callback(lines.close)
        seconds = SecondsLog(firmware.ram, job.folder, scenario.duration_s)
        ends.callback(seconds.close)
        tasks = Tasks(
            (job.report_every, progress), (lines.every, lines.run), (seconds.every, seconds.run)
        )
        permitted = settle(job)  # locking memory takes long: before anyone waits for us
        port = ends.enter_context(closing(open_port(job.address, "firmware", job.attach_wait_s)))
        error_ppm = scenario.firmware.clock_error_ppm
        try:
            report.send("ready", side="firmware", **permitted)
            if job.is_realtime:
                run_realtime(firmware, port, lateness, error_ppm, tasks.every, tasks.run)
            else:
                port.meet()
                run_lockstep(firmware, port, error_ppm, tasks.every, tasks.run)
        finally:
            seconds.run()
            summary = firmware_summary(firmware) | {"lateness_us": lateness.summary()}
            summary |= lines.statistics()
            ends.callback(lambda: report.send("summary", side="firmware", **summary))
    return summary
