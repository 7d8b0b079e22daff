"""The check in real time: hardware whose clock is 200 ppm slow, against the program's own clock."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, field
from typing import Final

import can

from rrins.dbc.codec import decode
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of, crc_holds
from rrins.dbc.frame import Frame, frame_array
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.conformance.check import SCENARIO, Subject, check
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.runs.sides.job import prepare_hardware
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.processes import OwnProgram, SideProcess, fresh_channel
from rrins.host_tools.testing.scenarios import prepare_scenario

ERROR_PPM: Final = 200.0
SECONDS: Final = 8.0
_REPORTED_PPM: Final = 50.0  # of 127, the most that the field holds
_DELAY: Final = 2  # epochs until a command takes effect
_IN_TIME: Final = 0.9  # of the epochs
_TRIES: Final = 3  # the machine has others to serve: what is late once need not be the program's
_START_S: Final = 120.0
_LOOK_S: Final = 0.2  # between two looks whether the program still runs


class _LateError(AssertionError):
    """The program is late: perhaps because the machine is."""


@dataclass
class _Heard:
    """Frames of the program."""

    commands: set[int] = field(default_factory=set)  # epochs whose commands came in time
    error_ppm: list[float] = field(default_factory=list)


@check("firmware.md#clock")
def clock_error(subject: Subject) -> None:
    """In real time a clock error of 200 ppm is learned, and commands are in time."""
    for _ in range(_TRIES - 1):
        with contextlib.suppress(_LateError):
            _try(subject)
            return
    _try(subject)


def _try(subject: Subject) -> None:
    file = subject.folder / "clock.toml"
    overrides = {"firmware": {"alignment_s": 1.0}, "duration_s": 60.0}
    scenario = prepare_scenario(SCENARIO, overrides, file, subject.folder)
    prepare_hardware(scenario)
    channel = fresh_channel()
    with RrinsBus(channel, host="here", name="hardware", exclusive=True) as bus:
        own = None
        if subject.program is not None:
            own = OwnProgram(Program.parse(subject.program), scenario)
        wait = ("--attach-wait", str(_START_S))
        side = SideProcess("firmware", file, channel, "1", *wait, own=own)
        try:
            _await(bus, side)
            heard = _run(bus, scenario, Hardware(hardware_settings(scenario)))
        finally:
            side.stop()
    epochs = round(SECONDS * scenario.rate_hz)
    settled = range(epochs // 2, epochs - _DELAY)
    in_time = sum(epoch in heard.commands for epoch in settled) / len(settled)
    if in_time < _IN_TIME:
        raise _LateError(
            f"commands in time in {in_time:.1%} of the epochs, with a clock error of "
            f"{ERROR_PPM:g} ppm"
        )
    reported = sorted(heard.error_ppm[-10:])
    assert reported, "no FIRMWARE_STATUS in real time"
    middle = reported[len(reported) // 2]
    if middle < _REPORTED_PPM:
        raise _LateError(
            f"clock_error_ppm is {middle:g} after {SECONDS:g} s, with an error of {ERROR_PPM:g} ppm"
        )


def _await(bus: RrinsBus, side: SideProcess) -> None:
    """Wait until the program is on the bus; AssertionError if it ends, or does not come."""
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline:
        with contextlib.suppress(can.CanTimeoutError):
            bus.wait_for("firmware", _LOOK_S)
            return
        status = side.process.poll()
        assert status is None, f"it ended with status {status} before it was on the bus"
    raise AssertionError(f"it has not come to the bus within {_START_S:g} s")


def _run(bus: RrinsBus, scenario: Scenario, hardware: Hardware) -> _Heard:
    """Open epochs at the slow clock's deadlines; take what comes meanwhile."""
    heard, inbox = _Heard(), frame_array(4096)
    period_ns = hardware.period_ns * (1 + ERROR_PPM * 1e-6)
    start_ns = time.monotonic_ns()
    count = 0
    for epoch in range(round(SECONDS * scenario.rate_hz)):
        deadline_ns = start_ns + round(epoch * period_ns)
        while (left_ns := deadline_ns - time.monotonic_ns()) > 0 or count == 0:
            batch = bus.recv_batch(inbox[count:], max(0, left_ns) * 1e-9)
            if batch is None:
                break
            for k in range(count, count + batch.count):
                _take(heard, inbox[k], epoch)
            count += batch.count
        frames, sent = hardware.open_epoch(epoch, inbox, count)
        bus.send_batch(
            frames, sent, epoch=epoch, time_ns=epoch * hardware.period_ns, closes_epoch=True
        )
        count = 0
    return heard


def _take(heard: _Heard, frame: Frame, now: int) -> None:
    """Take a frame that came before epoch `now` was opened."""
    contract = load_contract()[0]
    can_id = int(frame["can_id"])
    if can_id == int(contract.axis_outer_command.message.can_id):
        if crc_holds(frame, contract.axis_outer_command.message):
            age = (now - counter_of(frame["data"])) % COUNTER_MODULUS
            if age <= _DELAY:
                heard.commands.add(now - age)
    elif can_id == int(contract.firmware_status.message.can_id):
        status = contract.firmware_status
        if crc_holds(frame, status.message):
            heard.error_ppm.append(decode(frame["data"], status.clock_error_ppm))
