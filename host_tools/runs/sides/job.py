"""The job of a side's process, and what each side does before it begins."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from rrins.compiled.code_folder import CodeFolderError, code_folder
from rrins.compiled.compile_events import compiling_watched
from rrins.compiled.compiled_beside import compiled_beside
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultAction
from rrins.firmware_py.core.step import parts_beside
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial.settings import NO_LINES, SerialSettings
from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.bus.port import BatchPort, frame_of_message
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.injection.messages import fault_commands
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.results.pipe import ReportPipe
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.sides.realtime import enter_realtime
from rrins.host_tools.scenario.scenario import Scenario, fault_of

REALTIME = 1.0
"""The speed that means real time: both sides by their own clocks, not in lockstep."""

_ATTENTIVE_SPEED = 20.0  # up to which a report comes every simulated second


@dataclass(frozen=True)
class Job:
    """The job of one side's process."""

    scenario: Scenario
    address: Address  #: the bus
    #: `REALTIME`, a factor for lockstep, or None for lockstep as fast as it goes
    speed: float | None
    folder: Path | None = None  #: where the log goes
    report_fd: int | None = None  #: pipe to the rehearsal
    #: processor to stay on. Two processes that wait for each other are several times faster on one
    #: than on two.
    core: int | None = None
    attach_wait_s: float = 0.0  #: how long the firmware waits for the bus to come up
    #: other peers of the embedded bus without which the hardware does not begin
    await_peers: tuple[str, ...] = ()
    serial: SerialSettings = NO_LINES  #: the firmware's serial lines
    parameters: Path | None = None  #: file of the firmware's parameter memory
    #: whether the hardware lets others on the embedded bus send what is the sides'
    foreign_senders: bool = False
    keep: bool = False  #: whether the hardware goes on when the firmware has gone
    #: name of the user's own program that is the firmware: the hardware follows it by its frames
    follow: str | None = None
    patience_s: float = 0.0  #: longest silence of a program of the user's; 0 waits for ever
    #: the user's own program in the place of the sensors and the table
    program: Program | None = None
    #: file that sets how fast the hardware goes (`rrins.host_tools.runs.sides.steering`).
    steer: Path | None = None

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


def open_port(
    address: Address,
    side: Side,
    attach_wait_s: float = 0.0,
    foreign_senders: bool = False,
    keeps: bool = False,
) -> BatchPort | MessagePort:
    """Open a side's port on a bus.

    Raises
    ------
    BusError
        If the bus does not exist, or that side is already on it.
    """
    if address.is_embedded:
        return BatchPort(address, side, attach_wait_s, foreign_senders, keeps)
    return MessagePort(address, side, keeps=keeps)


def settle(job: Job) -> dict[str, bool]:
    """Set the scheduling of the process as its job needs it."""
    if job.is_realtime:
        return enter_realtime()
    if job.core is not None:
        os.sched_setaffinity(0, {job.core})
    return {}


def check_code_folder() -> None:
    """Refuse to start where others could have written the compiled code.

    Raises
    ------
    RehearsalError
        With what to do.
    """
    folder = code_folder()
    try:
        if folder is not None:
            folder.check()
    except CodeFolderError as error:
        raise RehearsalError(str(error)) from error


def prepare_firmware(scenario: Scenario) -> None:
    """Run one step on a spare instance, so that all code is compiled or loaded."""
    aside = Firmware(firmware_settings(scenario))
    with compiled_beside(*parts_beside(aside.contract, aside.compares)):
        aside.step(frame_array(1), 0, 0, 0)


def prepare_hardware(scenario: Scenario) -> None:
    """Run some steps on a spare instance, so that all code is compiled or loaded.

    Faults are put in, too: what they need is not to be compiled while time is real.
    """
    aside = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    commands = frame_array(2)
    for frame, kind in zip(commands, ("drop", "gyro_bias"), strict=True):
        (message,) = fault_commands(FaultAction.INJECT, fault_of({"kind": kind}))
        frame_of_message(frame, message)
    for epoch in range(3):
        aside.open_epoch(epoch, commands, len(commands) if epoch == 1 else 0)


def prepare(report: ReportPipe, side: str, scenario: Scenario) -> None:
    """Compile or load what a side needs; report each function that is compiled, and how long.

    Raises
    ------
    RehearsalError
        When others could have written the compiled code.
    """
    report.send("preparing", side=side)
    start = time.monotonic()
    check_code_folder()
    with compiling_watched(lambda functions: report.compiling(side, functions)):
        {"firmware": prepare_firmware, "hardware": prepare_hardware}[side](scenario)
    report.send("prepared", side=side, seconds=round(time.monotonic() - start, 2))
