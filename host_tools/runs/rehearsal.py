"""A rehearsal: both sides as processes on one bus, watched from start to end."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rrins.host_tools import interruption
from rrins.host_tools.bus import channel as embedded
from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.errors import BusError, RehearsalError, SideLostError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.recording import recorder
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.note import Note
from rrins.host_tools.runs.programs.program import (
    GRACE_S,
    PROGRAM_GRACE_S,
    Program,
    ProgramProcess,
    digest_said,
    end_error,
    last_words,
    misfit_error,
    misfit_of,
)
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.pipe import ReportReader
from rrins.host_tools.runs.sides.job import REALTIME
from rrins.host_tools.runs.sides.starting import Fork, start_program
from rrins.host_tools.scenario.scenario import Scenario

OnReport = Callable[[JsonObject], None]
"""Called with every report of either side."""

Start = Callable[[Sequence[str], int], Fork | subprocess.Popen[bytes]]
"""Starts a side by the words behind `rrins`, with a descriptor for its reports."""

_BUS_ENDS_S = 60.0  # to write what was received before that
_ATTACH_WAIT_S = 300.0  # the first start compiles
_POLL_S = 0.2
CHANNEL = "rrins"
"""Name of the channels of rehearsals; a number follows."""


_ERRORS: dict[int, type[RehearsalError]] = {
    kind.exit_status: kind for kind in (BusError, SideLostError)
}
"""The errors that a side can report, by exit status; all others are plain."""


class Interrupted(RehearsalError):  # noqa: N818 - no error: the user asked for it
    """The user stopped the rehearsal."""

    exit_status = interruption.INTERRUPTED


def free_channel() -> str:
    """Return the first of rrins0, rrins1, … that nobody hosts."""
    taken = set(embedded.detect())
    number = 0
    while f"{CHANNEL}{number}" in taken:
        number += 1
    return f"{CHANNEL}{number}"


@dataclass
class WatchedSide:
    """One side's process, and what it has reported."""

    name: str
    process: Fork | subprocess.Popen[bytes]
    pipe: int
    reader: ReportReader = field(default_factory=ReportReader)
    summary: JsonObject = field(default_factory=dict)  #: its last words; empty until then
    error: JsonObject = field(default_factory=dict)  #: why it failed: `message`, `exit_status`
    epoch: int = 0
    is_open: bool = True
    is_asked_to_end: bool = False  #: whether we have asked it
    is_made_to_end: bool = False  #: whether it did not heed that
    program: Program | None = None  #: the user's own, which reports nothing itself
    is_without_power: bool = False  #: whether a fault has taken its power
    ended_by_itself: bool = False  #: whether it had ended before it was asked to

    def read(self) -> list[JsonObject]:
        """Read the pipe."""
        data = os.read(self.pipe, 65536)
        if not data:
            self.is_open = False
            return []
        return self.reader.feed(data)

    def keep(self, report: JsonObject) -> None:
        """Keep summary, error and epoch of a report of this side."""
        kind = report["kind"]
        if kind == "summary":
            self.summary = {k: v for k, v in report.items() if k not in ("kind", "side")}
        elif kind == "error":
            self.error = report
        elif kind == "progress":
            self.epoch = int(report["epoch"])

    @property
    def killed_by(self) -> signal.Signals | None:
        """Somebody else's signal that ended the process.

        One that is asked to end while it does so anyway dies of an interrupt that nobody catches.
        """
        status = self.process.returncode
        asked = self.is_asked_to_end and status in (-signal.SIGTERM, -signal.SIGINT)
        is_ours = self.is_made_to_end or asked
        return None if status is None or status >= 0 or is_ours else signal.Signals(-status)

    @property
    def was_stopped(self) -> bool:
        """Whether somebody else has stopped it, and it has heeded that."""
        return self.process.returncode == interruption.INTERRUPTED and not self.is_asked_to_end

    def ask_to_end(self) -> None:
        """Terminate the process, if it has not ended by itself."""
        self.is_asked_to_end = self.process.poll() is None
        self.process.terminate()

    def end(self) -> None:
        """Terminate the process; kill it if it does not end."""
        self.ended_by_itself = self.process.poll() is not None
        if not self.ended_by_itself:
            self.ask_to_end()
            self.process.send_signal(signal.SIGCONT)
            try:
                self.process.wait(GRACE_S if self.program is None else PROGRAM_GRACE_S)
            except subprocess.TimeoutExpired:
                self.is_made_to_end = True
                self.process.kill()
                self.process.wait()
        if isinstance(self.process, ProgramProcess):
            self.process.close()


@dataclass
class Rehearsal:
    """Starts both sides, follows them, and stops both in every case.

    Attributes
    ----------
    firmware_options, hardware_options : sequence of str
        Command-line options for one side alone.
    """

    name: str  #: scenario, as given on the command line: the sides load it themselves
    scenario: Scenario
    overrides: tuple[str, ...]  #: Command-line options by which the scenario differs from its file
    address: Address
    speed: float | None  #: see `rrins.host_tools.runs.sides.job.Job`.
    folder: Path  #: where the sides put their logs
    record: Path | None = None  #: file to record the bus to
    firmware_options: tuple[str, ...] = ()
    hardware_options: tuple[str, ...] = ()
    start: Start = start_program  #: starts a side
    timestamps: Literal["bus", "unix"] = "bus"  #: time of the recorded frames, as of `Recorder`
    program: Program | None = None  #: the user's own program as the firmware
    patience_s: float = 10.0  #: longest silence of that program; 0 waits for ever
    restarts: int = 0  #: how often that program is started again when it fails

    def __post_init__(self) -> None:
        self._misfit = ""  # what the bus has said of a program that it does not understand
        self._has_started = False
        self._restarted = self._power_cycles = 0
        self._recorder: recorder.Recorder | None = None
        self._started_ns: int | None = None
        self._ended_ns = 0
        self._sides: list[WatchedSide] = []
        # Both sides on one processor; not all rehearsals of a machine on the same.
        cores = sorted(os.sched_getaffinity(0))
        self._core = cores[os.getpid() % len(cores)]

    def run(self, on_report: OnReport) -> Outcome:
        """Run to the end; both processes have ended when this returns.

        Raises
        ------
        RehearsalError
            When the rehearsal cannot begin.
        """
        with interruption.as_event() as stop:
            try:
                for name in ("hardware", "firmware"):
                    self._sides.append(self._start(name))
                self._follow(on_report, stop)
                was_stopped = stop.is_set()
            finally:
                self._ended_ns = self._ended_ns or time.monotonic_ns()
                for side in self._sides:
                    side.end()
                self._drain(on_report)
                self._close_recorder()
        return self._outcome(Interrupted("stopped by the user") if was_stopped else self._failure())

    def _start(self, name: str) -> WatchedSide:
        words = [
            *(name, self.name, *self.overrides),
            *("--interface", self.address.interface, "--channel", self.address.channel),
            *("--speed", "max" if self.speed is None else f"{self.speed:.12g}"),
            *("--log", str(self.folder)),
        ]
        if self.address.bitrate is not None:
            words += ["--bitrate", str(self.address.bitrate)]
        if name == "firmware":
            words += ["--attach-wait", str(_ATTACH_WAIT_S), *self.firmware_options]
        else:
            words += self.hardware_options
            if self.program is not None:
                words += ["--follow", self.program.name, "--patience", f"{self.patience_s:g}"]
            if self.restarts:
                words.append("--keep")
            if self.record is not None and self.address.is_embedded:
                words += ["--await-peer", recorder.NAME]
        if self.speed != REALTIME and self.address.is_embedded:
            words += ["--core", str(self._core)]
        if name == "firmware" and self.program is not None:
            return self._start_program(self.program)
        read_end, write_end = os.pipe()
        try:
            process = self.start(words, write_end)
        except BaseException:
            os.close(read_end)
            raise
        finally:
            os.close(write_end)
        return WatchedSide(name, process, read_end)

    def _start_program(self, program: Program) -> WatchedSide:
        """Start the user's program; the end of the pipe is its end."""
        read_end, write_end = os.pipe()
        try:
            process = self._process_of(program, write_end)
        except BaseException:
            os.close(read_end)
            raise
        finally:
            os.close(write_end)
        return WatchedSide("firmware", process, read_end, program=program)

    def _process_of(self, program: Program, write_end: int) -> ProgramProcess:
        is_realtime = self.speed == REALTIME
        speed = "1" if is_realtime else "max"
        process = program.start(
            self.scenario,
            self.address,
            speed,
            _ATTACH_WAIT_S,
            self.folder,
            (write_end,),
            again=self._has_begun_again,
        )
        if not is_realtime and self.address.is_embedded:
            with contextlib.suppress(ProcessLookupError):  # it has ended, which will be noticed
                os.sched_setaffinity(process.program_pid, {self._core})
        return process

    @property
    def _has_begun_again(self) -> bool:
        return self._restarted + self._power_cycles > 0

    def _follow(self, on_report: OnReport, stop: threading.Event) -> None:
        """Hand on reports until both sides have closed their pipes, one has failed, or `stop`."""
        with selectors.DefaultSelector() as selector:
            for side in self._sides:
                selector.register(side.pipe, selectors.EVENT_READ, side)
            while selector.get_map() and not stop.is_set():
                for key, _ in selector.select(_POLL_S):
                    side = key.data
                    for report in side.read():
                        if report["kind"] == "power":
                            self._switch(selector, is_on=bool(report["is_on"]))
                            continue
                        self._keep(report)
                        self._note(report, on_report)
                        on_report(report)
                    if not side.is_open and not side.is_without_power:
                        selector.unregister(side.pipe)
                        side.process.wait()
                        again = self._started_again(side, on_report)
                        if again is not None:
                            selector.register(again.pipe, selectors.EVENT_READ, again)
                        elif side.process.returncode != 0 or self._came_too_early(side):
                            self._let_other_end(side)
                            return

    def _switch(self, selector: selectors.BaseSelector, is_on: bool) -> None:
        """Take the power of the user's program, or return it."""
        side = self._sides[-1]
        if not is_on:
            selector.unregister(side.pipe)
            side.is_without_power = True
            side.process.kill()
            side.process.wait()
            return
        os.close(side.pipe)
        assert side.program is not None
        self._power_cycles += 1
        again = self._start_program(side.program)
        again.summary, again.epoch = side.summary, side.epoch
        self._sides[-1] = again
        selector.register(again.pipe, selectors.EVENT_READ, again)

    def _started_again(self, side: WatchedSide, on_report: OnReport) -> WatchedSide | None:
        """Start the user's program again if it has failed in the rehearsal; None if not."""
        program, status = side.program, side.process.returncode
        is_failure = program is not None and status != 0 and self._has_started
        hardware = self._sides[0]
        if (
            not is_failure
            or self._restarted == self.restarts
            or hardware.process.poll() is not None
        ):
            return None
        assert program is not None
        why = end_error(program.name, status or 0, self._after(side), last_words(self.folder))
        os.close(side.pipe)
        self._restarted += 1
        text = f"{why}; started again ({self._restarted} of {self.restarts})"
        on_report({"kind": "note", "side": "firmware", "text": text})
        again = self._start_program(program)
        again.summary, again.epoch = side.summary, side.epoch
        self._sides[self._sides.index(side)] = again
        return again

    def _keep(self, report: JsonObject) -> None:
        """Keep a report for the side that it is about."""
        for side in self._sides:
            if side.name == report["side"]:
                side.keep(report)

    def _came_too_early(self, side: WatchedSide) -> bool:
        """Return whether the user's program ended well, but before the rehearsal began."""
        return side.program is not None and not self._has_started

    def _let_other_end(self, failed: WatchedSide) -> None:
        """Give the remaining side a moment to notice and report it."""
        for side in self._sides:
            if side is not failed:
                try:
                    side.process.wait(GRACE_S if self.address.is_embedded else 0.0)
                except subprocess.TimeoutExpired:
                    side.ask_to_end()

    def _note(self, report: JsonObject, on_report: OnReport) -> None:
        if report["side"] != "hardware":
            return
        if report["kind"] == "ready" and self.record is not None:
            note, lossless = self._note_of_recording(), self.speed != REALTIME
            self._recorder = recorder.Recorder(
                self.record, self.address, lossless, note, timestamps=self.timestamps
            )
            if self._recorder.kept_words is not None:
                on_report({"kind": "note", "side": "hardware", "text": self._recorder.kept_words})
        elif report["kind"] == "note":
            for side in self._sides:
                if isinstance(side.process, ProgramProcess):
                    pid = side.process.program_pid
                    self._misfit = misfit_of(report["text"], pid) or self._misfit
        elif report["kind"] == "started":
            self._has_started = True
            self._started_ns = time.monotonic_ns()
        elif report["kind"] == "summary":
            self._ended_ns = time.monotonic_ns()

    def _drain(self, on_report: OnReport) -> None:
        """Read the last reports of processes that have ended."""
        ended_ns = self._ended_ns
        for side in self._sides:
            while side.is_open:
                for report in side.read():
                    self._keep(report)
                    on_report(report)
            os.close(side.pipe)
            if side.program is not None and side.summary and not self._has_begun_again:
                side.summary["navigation_sha256"] = digest_said(self.folder)
        self._ended_ns = ended_ns

    def _note_of_recording(self) -> Note:
        return Note(
            interface=self.address.interface,
            channel=self.address.channel,
            scenario_name=self.name,
            scenario=self.scenario.model_dump(mode="json"),
            speed="max" if self.speed is None else self.speed,
        )

    def _close_recorder(self) -> None:
        if self._recorder is None or self.record is None:
            return
        self._recorder.close(_BUS_ENDS_S if self.address.is_embedded else GRACE_S)
        for side in self._sides:
            if side.name == "firmware" and side.summary:
                sha256 = side.summary.get("navigation_sha256")
                try:
                    recorder.add_result(self.record, self._recorder.note, sha256)
                except RecordError as error:
                    self._recorder.failure = self._recorder.failure or f"its note: {error}"

    def _failure(self) -> RehearsalError | None:
        """Return why the rehearsal failed: the side that was killed before the one that noticed."""
        own = self._failure_of_program()
        if own is not None:
            return own
        ends = [side for side in self._sides if not side.is_without_power]
        failed = [side for side in ends if side.process.returncode != 0]
        for side in failed:
            if side.killed_by is not None:
                return SideLostError(
                    f"the {side.name} process {side.process.pid} was killed by "
                    f"{side.killed_by.name} {self._after(side)}"
                )
            if side.was_stopped:
                return SideLostError(
                    f"the {side.name} process {side.process.pid} was stopped by SIGTERM or SIGINT "
                    f"{self._after(side)}"
                )
        for side in failed:
            if side.error:
                kind = _ERRORS.get(side.error["exit_status"], RehearsalError)
                kind = embedded.HostedError if side.error["channel_is_hosted"] else kind
                return kind(side.error["message"])
        for side in failed:
            status = side.process.returncode
            return SideLostError(f"the {side.name} process ended with status {status}")
        if self._recorder is not None and self._recorder.failure is not None:
            return RecordError(f"recording {self.record}: {self._recorder.failure}")
        return None

    def _after(self, side: WatchedSide) -> str:
        return f"after {side.epoch / self.scenario.rate_hz:.0f} s of simulated time"

    def _failure_of_program(self) -> RehearsalError | None:
        """Return how the user's program failed, if it did: killed, ended, not understood."""
        hardware, firmware = self._sides if len(self._sides) == 2 else (None, None)
        if hardware is None or firmware is None or firmware.program is None:
            return None
        if hardware.process.returncode == 0:
            return None  # the scenario has come to its end
        taken = None if self._has_started else self._taken()
        if taken is not None:
            return taken  # it met somebody else's hardware
        name, status = firmware.program.name, firmware.process.returncode
        if firmware.killed_by is not None:
            return end_error(name, -firmware.killed_by, self._after(firmware), "")
        if self._misfit:
            return misfit_error(name, self._misfit)
        if hardware.error and hardware.error["message"].startswith(f"{name} "):
            return SideLostError(hardware.error["message"])  # it hangs, or floods
        if firmware.ended_by_itself:
            said = last_words(self.folder)
            when = self._after(firmware) if self._has_started else "before it was on the bus"
            return end_error(name, status or 0, when, said)
        return None

    def _taken(self) -> RehearsalError | None:
        """Return who hosts the channel, if anybody does: our hardware has ended."""
        try:
            if self.address.is_embedded:
                embedded.Claim(self.address.channel).release()
        except embedded.HostedError as error:
            return error
        return None

    def _outcome(self, failure: RehearsalError | None) -> Outcome:
        summaries = {side.name: side.summary for side in self._sides}
        if self.restarts:
            summaries["firmware"] = summaries.get("firmware", {}) | {"restarts": self._restarted}
        wall_s = 0.0 if self._started_ns is None else (self._ended_ns - self._started_ns) * 1e-9
        return Outcome(
            summaries.get("firmware", {}), summaries.get("hardware", {}), wall_s, failure
        )


def default_address(interface: str, channel: str | None, bitrate: int | None) -> Address:
    """Return the bus for the options of a rehearsal.

    Raises
    ------
    BusError
        When an interface other than the embedded one is named without a channel.
    """
    if channel is None:
        if interface != EMBEDDED:
            raise BusError(f"interface {interface}: needs a --channel, such as vcan0 or can0")
        channel = free_channel()
    return Address(interface, channel, bitrate)
