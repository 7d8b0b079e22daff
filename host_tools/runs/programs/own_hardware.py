"""The user's own program as the sensors and the table, beside the emulation that knows the truth.

The program has a bus of its own to this process, on which it is the hardware and each epoch is in
lockstep; what it sends goes the way that the emulation's frames go: over the wire with its faults,
at the pace of the rehearsal, onto any bus. The emulation runs beside it for the truth and the
operator. `docs/own-firmware.md` has the rules.
"""

from __future__ import annotations

import contextlib
import logging
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import can
import numpy as np

from rrins.dbc.codec import load
from rrins.dbc.frame import FrameArray, frame_array
from rrins.dbc.values import FaultRefusal
from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.bus.batch import Batch
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import RehearsalError, SideLostError
from rrins.host_tools.hardware.fault_server import HardwareFaultServer
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.settings import Settings
from rrins.host_tools.hardware.step import OUTBOX_CAPACITY
from rrins.host_tools.runs.programs.notices import LOGGER
from rrins.host_tools.runs.programs.program import (
    Program,
    end_error,
    last_words,
    misfit_error,
    misfit_of,
)
from rrins.host_tools.runs.results.pipe import ReportPipe
from rrins.host_tools.scenario.fault_tables import FaultOnWire
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.wire.wire import Wire

_ATTACH_S: Final = 30.0
_LOOK_S: Final = 0.2  # between two looks whether the program still runs
_END_S: Final = 2.0  # for the program to end after the bus has
_LARGEST: Final = OUTBOX_CAPACITY - 4  # frames in an epoch: there is room for the operator's


def check_faults(program: Program, scenario: Scenario) -> None:
    """Refuse faults of the sensors and the table: they are the program's own.

    Raises
    ------
    RehearsalError
        For the first such fault.
    """
    for number, fault in enumerate(scenario.faults, 1):
        if not isinstance(fault, FaultOnWire):
            raise RehearsalError(
                f"faults.{number}: {fault.kind} is of the emulated hardware, in whose place "
                f"{program.name} is; with it only faults on the wire are possible"
            )


class _Misfits(logging.Handler):
    """Keeps what the bus says of a program that it does not understand."""

    def __init__(self, pid: int) -> None:
        super().__init__(logging.WARNING)
        self._pid = pid
        self.text = ""

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the reason."""
        self.text = misfit_of(record.getMessage(), self._pid) or self.text


class ProgramLink(Closing):
    """The program, and the bus between it and this process.

    Parameters
    ----------
    folder : Path or None
        Where its set-up goes, and what it prints (`hardware.txt`).
    patience_s : float
        Longest silence in wall clock time; 0 waits for ever.
    report : ReportPipe
        To the rehearsal, without which nothing is waited for.
    """

    def __init__(
        self,
        program: Program,
        scenario: Scenario,
        folder: Path | None,
        patience_s: float,
        report: ReportPipe,
    ) -> None:
        self._program = program
        self._name = program.name
        self._scenario = scenario
        self._patience_s = patience_s
        self._report = report
        self._epoch: int | None = None
        self._frames = frame_array(_LARGEST)
        self._ends = ExitStack()
        own = Path(self._ends.enter_context(tempfile.TemporaryDirectory(prefix="rrins-")))
        self._folder = own if folder is None else folder
        self._channel = str(own / "program.sock")

    def begin(self) -> None:
        """Start the program, and wait until it is on its bus.

        Raises
        ------
        SideLostError
            If it ends, or does not attach.
        """
        self._bus = RrinsBus(self._channel, host="here", name="firmware", exclusive=True)
        self._ends.callback(self._bus.shutdown)
        self._process = self._program.start(
            self._scenario,
            Address(EMBEDDED, self._channel),
            "max",
            _ATTACH_S,
            self._folder,
            side="hardware",
        )
        self._ends.callback(self._end_program)
        self._misfits = _Misfits(self._process.program_pid)
        logger = logging.getLogger(LOGGER)
        logger.addHandler(self._misfits)
        self._ends.callback(logger.removeHandler, self._misfits)
        self._meet()

    def _meet(self) -> None:
        wait_s = max(_ATTACH_S, self._patience_s)
        deadline = time.monotonic() + wait_s
        while True:
            try:
                self._bus.wait_for("hardware", _LOOK_S)
                self._bus.require(["hardware"])
                return
            except can.CanTimeoutError:
                self._check_process()
                if self._patience_s and time.monotonic() > deadline:
                    raise SideLostError(
                        f"{self._name} has not attached as the hardware within {wait_s:g} s"
                    ) from None

    @property
    def _when(self) -> str:
        if self._epoch is None:
            return "before it was on the bus"
        return f"after {self._epoch / self._scenario.rate_hz:.0f} s of simulated time"

    def _check_process(self) -> None:
        """Raise if the program has ended, with its last words, or was not understood.

        Likewise if the rehearsal has ended.
        """
        self._report.check_read()
        if self._misfits.text:
            raise misfit_error(self._name, self._misfits.text)
        status = self._process.poll()
        if status is not None:
            said = last_words(self._folder, "hardware")
            raise end_error(self._name, status, self._when, said)

    def exchange(
        self, frames: FrameArray, count: int, epoch: int, time_ns: int
    ) -> tuple[FrameArray, int]:
        """Give the program what the firmware has sent; return what it sends in the epoch.

        Raises
        ------
        SideLostError
            If it has ended, hangs, or sends too much.
        """
        self._epoch = epoch
        try:
            self._bus.send_batch(frames, count, epoch=epoch, time_ns=time_ns, closes_epoch=True)
            received = 0
            while True:
                batch = self._receive(self._frames[received:])
                received += batch.count
                if batch.closes_epoch:
                    return self._frames, received
                if received == _LARGEST:
                    raise SideLostError(
                        f"{self._name} floods the bus: more than {_LARGEST} frames in epoch {epoch}"
                    )
        except can.CanError as error:
            self._await_end()
            self._check_process()
            raise SideLostError(f"{self._name} has left the bus {self._when}: {error}") from error

    def _receive(self, into: FrameArray) -> Batch:
        deadline = time.monotonic() + self._patience_s
        while True:
            batch = self._bus.recv_batch(into, _LOOK_S)
            if batch is not None:
                return batch
            self._check_process()
            if self._patience_s and time.monotonic() > deadline:
                raise SideLostError(
                    f"{self._name} has not closed its epoch for {self._patience_s:g} s, in epoch "
                    f"{self._epoch}: it hangs"
                )

    def _await_end(self) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)

    def _end_program(self) -> None:
        self._bus.shutdown()  # which tells it that all is over
        self._await_end()
        self._process.close()

    def close(self) -> None:
        """End the bus; kill the program if it does not heed that."""
        self._ends.close()


class _NoFaults(HardwareFaultServer):
    """Knows no fault: the sensors and the table are the program's."""

    def _refusal_of_target(self, kind: int, target: int) -> FaultRefusal:
        return FaultRefusal.UNKNOWN


class OwnHardware(Hardware):
    """The hardware whose frames are those of the user's program.

    Parameters
    ----------
    settings : Settings
        Of the emulation beside it: truth and operator.
    link : ProgramLink
        Begun before the first step.
    """

    def __init__(self, settings: Settings, wire: Wire | None, link: ProgramLink) -> None:
        super().__init__(settings, wire)
        self.link = link
        self.fault_server = _NoFaults(self.plant[0])
        self._emulated = np.array(
            [one.frame_id for one in load().database.messages if "HARDWARE" in one.senders],
            dtype=np.uint32,
        )

    def undisturbed_until(self, epoch: int) -> int:
        """Return `epoch`: the program is asked in each."""
        return epoch

    def step(self, inbox: FrameArray, count: int) -> int:
        """Run one epoch on the first `count` frames; return the number in `outbox`."""
        epoch = self.epoch
        of_emulation = self.outbox[: super().step(inbox, count)]
        of_operator = of_emulation[~np.isin(of_emulation["can_id"], self._emulated)].copy()
        frames, sent = self.link.exchange(inbox, count, epoch, epoch * self.period_ns)
        last = max(0, sent - 1)
        total = sent + len(of_operator)
        self.outbox[:last] = frames[:last]
        self.outbox[last : last + len(of_operator)] = of_operator
        self.outbox[last + len(of_operator) : total] = frames[last:sent]
        return total
