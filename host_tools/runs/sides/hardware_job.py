"""The hardware as the job of a process: its shell, its samples, its reports."""

from __future__ import annotations

import math
from contextlib import ExitStack

import numpy as np

from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.bus.port import BatchPort
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware_lockstep
from rrins.host_tools.hardware.loop import run_realtime as run_hardware_realtime
from rrins.host_tools.hardware.memory import Sensors, Truth
from rrins.host_tools.hardware.units import ARCSEC, DPH, PPM, UG
from rrins.host_tools.runs.programs.followed_port import Watch, open_followed_port
from rrins.host_tools.runs.programs.follower import Follower, follower_of
from rrins.host_tools.runs.programs.notices import bus_notices
from rrins.host_tools.runs.programs.own_hardware import OwnHardware, ProgramLink
from rrins.host_tools.runs.results.pipe import ReportPipe
from rrins.host_tools.runs.results.samples import (
    TRUTH_SAMPLES,
    SampleBuffer,
    SampleFile,
    keep_every,
)
from rrins.host_tools.runs.set_up.settings import hardware_settings, scenario_wire
from rrins.host_tools.runs.set_up.typed_numbers import typed_numbers
from rrins.host_tools.runs.sides.job import Job, open_port, prepare, settle
from rrins.host_tools.runs.sides.realtime import LatenessHistogram
from rrins.host_tools.runs.sides.steering import SteeredPace
from rrins.host_tools.wire.wire import Wire


def hardware_summary(hardware: Hardware) -> JsonObject:
    """Return the hardware's summary of a run, in plain values."""
    plant = hardware.plant[0]
    dt = int(plant["period_ns"]) * 1e-9
    return {
        "epochs": int(plant["epoch"]),
        "frames_received": hardware.frames_received,
        "frames_sent": hardware.frames_sent,
        "faults": {name: int(plant["counters"][name]) for name in plant["counters"].dtype.names},
        "wire": hardware.wire.statistics() if isinstance(hardware.wire, Wire) else None,
        "bus": None,
        "biases": {
            "gyros_dph": _biases(plant["gyros"], dt * DPH),
            "accelerometers_ug": _biases(plant["accelerometers"], dt * UG),
            "gyros": _constants(plant["gyros"]),
            "accelerometers": _constants(plant["accelerometers"]),
            "odometer": {
                "metres_per_pulse": float(plant["odometer"]["metres_per_pulse"]),
                "forward_b": plant["odometer"]["forward_b"].tolist(),
                "lever_arm_m": plant["odometer"]["lever_arm"].tolist(),
            },
            "altimeter_m": float(plant["altimeter"]["bias"]),
        },
    }


def _biases(sensors: Sensors, unit: float) -> list[float]:
    """Return the sensors' biases at the end of the run, with drift and faults."""
    increments = sensors["bias_increment"] + sensors["fault_bias_increment"]
    return typed_numbers(increments[: int(sensors["count"])] / unit)


def _constants(sensors: Sensors) -> JsonObject:
    """Return scale factors and installation errors at the end of the run, by a scenario's keys."""
    count = int(sensors["count"])
    scale = sensors["scale_error"] + sensors["fault_scale_error"]
    # The derivatives of the axis h' by δu and δv are -v and -u, of length 1 and across it.
    angles = np.einsum("ki,kai->ka", sensors["axis"], sensors["axis_by_angle"]) / ARCSEC
    return {
        "scale_error_ppm": typed_numbers(scale[:count] / PPM),
        "asymmetric_scale_error_ppm": typed_numbers(
            sensors["asymmetric_scale_error"][:count] / PPM
        ),
        "installation_u_arcsec": typed_numbers(angles[:count, 0]),
        "installation_v_arcsec": typed_numbers(angles[:count, 1]),
    }


def _open(job: Job, follower: Follower | None) -> BatchPort | MessagePort:
    if follower is None or job.follow is None:
        return open_port(
            job.address, "hardware", foreign_senders=job.foreign_senders, keeps=job.keep
        )
    watch = Watch(job.follow, follower, job.patience_s, job.scenario.rate_hz)
    return open_followed_port(job.address, watch, job.foreign_senders, job.keep)


def _hardware(job: Job, report: ReportPipe) -> Hardware:
    """Return the emulated hardware, or the user's program beside it."""
    settings, wire = hardware_settings(job.scenario), scenario_wire(job.scenario, is_live=True)
    if job.program is None:
        return Hardware(settings, wire)
    link = ProgramLink(job.program, job.scenario, job.folder, job.patience_s, report)
    return OwnHardware(settings, wire, link)


class _Absence:
    """Tells the user when the firmware goes, and when one comes again."""

    def __init__(self, report: ReportPipe) -> None:
        self._report, self._is_there = report, True

    def note(self, is_there: bool) -> None:
        """Take note whether a firmware is attached."""
        if is_there != self._is_there:
            self._is_there = is_there
            goes_on = "a firmware is on the bus again"
            text = goes_on if is_there else "the firmware has gone; the hardware goes on"
            self._report.note("hardware", text)


class _Power:
    """Lets the rehearsal take and return the power of the user's program, as a fault says."""

    def __init__(
        self, job: Job, report: ReportPipe, port: BatchPort | MessagePort, hardware: Hardware
    ) -> None:
        self._waits, self._report, self._port = not job.is_realtime, report, port
        self._hardware, self._is_on = hardware, True
        self._can_cut = job.follow is not None and job.report_fd is not None
        if isinstance(hardware.wire, Wire):
            hardware.wire.faults.can_cut_power = self._can_cut

    def follow(self, epoch: int) -> bool:
        """Return whether there is power in an epoch; in lockstep wait until that is so."""
        has_power = self._hardware.has_power(epoch)
        if has_power != self._is_on and self._can_cut:
            self._is_on = has_power
            self._report.send("power", side="hardware", is_on=has_power)
            if not has_power and not self._waits:
                self._port.dismiss()
            elif not has_power:
                self._port.await_end(self._hardware.outbox.copy())
            elif self._waits:
                self._port.await_other()
        return self._is_on


def run_hardware(job: Job) -> JsonObject:
    """Run the hardware to the end of the scenario, which shuts the firmware down.

    Raises
    ------
    BusError
        When the bus cannot be had or ends.
    SideLostError
        When no firmware comes, or it goes before the end.
    """
    report = ReportPipe(job.report_fd)
    scenario = job.scenario
    prepare(report, "hardware", scenario)
    hardware = _hardware(job, report)
    file = SampleFile(job.log_path(TRUTH_SAMPLES))
    rows = SampleBuffer(Truth, file)
    lateness = LatenessHistogram(scenario.period_ns)
    log_every = keep_every(scenario.epochs, scenario.rate_hz)
    every = math.gcd(log_every, job.report_every)
    truth = hardware.truth
    follower = None if job.follow is None else follower_of(job.folder)

    def on_epoch(epoch: int) -> None:
        if epoch % log_every == 0:
            rows.append(truth)
        if epoch % job.report_every == 0:
            report.send(
                "progress",
                side="hardware",
                epoch=epoch,
                latitude=float(truth["latitude"][0]),
                longitude=float(truth["longitude"][0]),
            )
            if follower is not None:
                report.send("progress", side="firmware", **follower.progress(epoch))
            if isinstance(port, BatchPort) and job.keep:
                absence.note(port.has_other())

    port = _open(job, follower)
    absence = _Absence(report)
    epochs = scenario.epochs + 1  # the last one shuts the firmware down
    notices = ExitStack()
    try:
        notices.enter_context(bus_notices(report, "hardware"))
        report.send("ready", side="hardware")
        permitted = settle(job)
        if isinstance(hardware, OwnHardware):
            notices.enter_context(hardware.link).begin()
        port.meet(job.await_peers)
        report.send("started", side="hardware", **permitted)
        power = _Power(job, report, port, hardware).follow
        if job.is_realtime:
            run_hardware_realtime(hardware, port, lateness, epochs, every, on_epoch, power)
        else:
            wait_for = None
            if job.steer is not None:
                wait_for = notices.enter_context(
                    SteeredPace(job.steer, scenario.period_ns, rest=port.rest)
                ).wait_for
            run_hardware_lockstep(
                hardware, port, epochs, job.speed, every, on_epoch, wait_for, power
            )
    finally:
        rows.flush()
        file.close()
        port.close()
        notices.close()
        if follower is not None:
            follower.close()
            told = follower.summary(int(hardware.plant[0]["epoch"]) - 1)
            report.send("summary", side="firmware", program=job.follow, **told)
        statistics = {"lateness_us": lateness.summary(), "bus": port.statistics()}
        summary = hardware_summary(hardware) | statistics
        report.send("summary", side="hardware", **summary)
    return summary
