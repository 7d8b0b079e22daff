"""The sides of a rehearsal as processes that a test starts and stops."""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import select
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import can

from rrins.host_tools.bus.address import EMBEDDED, Address, Side
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.interruption import INTERRUPTED
from rrins.host_tools.runs.programs.program import GRACE_S, Program, ProgramProcess, said_path
from rrins.host_tools.runs.results.pipe import ReportReader
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.errors import BenchError

_ATTACH_S = 30.0
_HOST_COMPILES_S = 300.0  # before it answers who calls
_POLL_S = 0.2
_PIPE_BYTES = 1024 * 1024  # room for hours of unread reports
_ASKED_TO_END = (0, INTERRUPTED, -signal.SIGTERM)  # shut down, or stopped by a signal
_numbers = itertools.count()


def fresh_channel() -> str:
    """Return the name of an unused channel of the embedded bus."""
    return f"rrins-test-{os.getpid()}-{next(_numbers)}"


def shared_core() -> int:
    """Return the CPU core to share among processes that wait for each other.

    Each pytest-xdist worker gets its own core, as long as there are enough.
    """
    cores = sorted(os.sched_getaffinity(0))
    worker = os.environ.get("PYTEST_XDIST_WORKER", "").removeprefix("gw")
    return cores[-1 - int(worker) % len(cores)] if worker.isdigit() else cores[-1]


@dataclass(frozen=True)
class OwnProgram:
    """The user's program as the firmware of a bench."""

    program: Program
    scenario: Scenario

    @staticmethod
    def folder(scenario_file: Path) -> Path:
        """Return where its set-up goes, and what it prints."""
        return scenario_file.with_suffix(".firmware")

    def start(
        self, scenario_file: Path, channel: str, speed: str, keep_open: tuple[int, ...]
    ) -> ProgramProcess:
        """Start the program on a channel of the embedded bus."""
        folder = self.folder(scenario_file)
        folder.mkdir(parents=True, exist_ok=True)
        address = Address(EMBEDDED, channel)
        return self.program.start(
            self.scenario, address, speed, _HOST_COMPILES_S, folder, keep_open
        )


class SideProcess:
    """The process of one side. It exits by itself soon after this process has ended.

    Parameters
    ----------
    side : {"firmware", "hardware"}
    scenario_file : Path
    channel : str
        Channel of the embedded bus.
    speed : {"1", "max"}
        Real time or lockstep.
    *options : str
        More options of the side's command.
    own : OwnProgram, optional
        The user's program instead; it has no other options.

    Attributes
    ----------
    process : subprocess.Popen
    """

    def __init__(
        self,
        side: Side,
        scenario_file: Path,
        channel: str,
        speed: Literal["1", "max"],
        *options: str,
        own: OwnProgram | None = None,
    ) -> None:
        self.side = side
        self._own = own
        self._said = scenario_file.with_suffix(f".{side}.txt")
        self._reader = ReportReader()
        self._error = ""
        self._is_ready = False
        self.process: subprocess.Popen[bytes]
        self._pipe, write_end = os.pipe()
        command = [sys.executable, "-m", "rrins", side, str(scenario_file)]
        command += ["--channel", channel, "--speed", speed, "--report-fd", str(write_end)]
        try:
            os.set_blocking(self._pipe, False)
            with contextlib.suppress(PermissionError):  # user limit reached: keep the default size
                fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
            if own is not None:
                self.process = own.start(scenario_file, channel, speed, (write_end,))
                self._said = said_path(own.folder(scenario_file))
                return
            with self._said.open("wb") as said:
                self.process = subprocess.Popen(
                    [*command, *options],
                    stdin=subprocess.DEVNULL,
                    stdout=said,
                    stderr=said,
                    pass_fds=(write_end,),
                    start_new_session=True,
                )
        finally:
            os.close(write_end)

    @property
    def _name(self) -> str:
        what = self._own.program.name if self._own is not None else f"the {self.side}"
        pid = self.process.pid
        if isinstance(self.process, ProgramProcess):
            pid = self.process.program_pid
        return f"{what} process {pid}"

    def poll(self) -> int | None:
        """Read the reports of the process; return its exit status, None while it runs."""
        while self._pipe >= 0:
            try:
                data = os.read(self._pipe, 65536)
            except BlockingIOError:
                break
            if not data:
                os.close(self._pipe)
                self._pipe = -1
            for report in self._reader.feed(data):
                self._is_ready |= report["kind"] == "ready"
                if report["kind"] == "error":
                    self._error = str(report["message"])
        return self.process.poll()

    def wait_until_ready(self, patience_s: float) -> None:
        """Wait until the process is on its bus.

        Raises
        ------
        BenchError
            If it has ended, or is not ready in time.
        """
        deadline = time.monotonic() + patience_s
        while True:
            status = self.poll()
            if self._is_ready:
                return
            if status is not None:
                raise BenchError(self.failure())
            if time.monotonic() >= deadline:
                raise BenchError(f"{self._name} was not ready within {patience_s:g} s")
            select.select([self._pipe] if self._pipe >= 0 else [], [], [], _POLL_S)

    def failure(self) -> str:
        """Return how the process ended, in words; wait briefly for its end."""
        try:
            status = self.process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            return f"{self._name} has left the bus but not ended"
        self.poll()
        if status < 0:
            return f"{self._name} was killed by {signal.Signals(-status).name} (status {status})"
        said = self._said.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        last = self._error or (said[-1] if said else "")
        return f"{self._name} ended with status {status}" + (f": {last}" if last else "")

    def kill(self) -> None:
        """End the process at once, as the loss of its power does."""
        self.process.kill()
        if isinstance(self.process, ProgramProcess):
            self.process.close()
        self.process.wait()
        self.poll()

    def stop(self) -> str:
        """Terminate the process; kill it if necessary. Idempotent.

        Returns
        -------
        str
            How it had ended, in words, if by itself; empty otherwise.
        """
        ends: tuple[int, ...] = _ASKED_TO_END
        if self.process.poll() is None:
            self.process.terminate()
            self.process.send_signal(signal.SIGCONT)
            try:
                self.process.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                ends = (*ends, -signal.SIGKILL)
        if isinstance(self.process, ProgramProcess):
            self.process.close()
        self.poll()
        words = "" if self.process.returncode in ends else self.failure()
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1
        return words


def attach_to_own(host: RrinsBus, name: str) -> RrinsBus:
    """Attach an observer to a channel that this process itself hosts.

    Raises
    ------
    BenchError
        If that fails.
    """
    found: list[RrinsBus] = []
    failed: list[can.CanError] = []

    def open_end() -> None:
        try:
            found.append(RrinsBus(host.channel, host="never", role="observer", name=name))
        except can.CanError as error:
            failed.append(error)

    thread = threading.Thread(target=open_end)
    thread.start()
    try:
        host.wait_for(name, _ATTACH_S)  # the host answers while it waits
    except can.CanError as error:
        failed.append(error)
    thread.join()
    if failed:
        raise BenchError(f"cannot attach to channel {host.channel!r}: {failed[0]}") from failed[0]
    return found[0]
