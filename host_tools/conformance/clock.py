"""Checks in real time: the program's own clock against SYNC, and stalls of either side."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import signal
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import FunctionType
from typing import Final

import can

from rrins.dbc.codec import decode
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of, crc_holds
from rrins.dbc.frame import Frame, frame_array
from rrins.firmware_py.core.frames_in import clock as own_clock
from rrins.firmware_py.core.records.memory import Clock
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.conformance.check import SCENARIO, NotApplicableError, Subject, check
from rrins.host_tools.conformance.stimuli import identifier
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.runs.sides.job import prepare_hardware
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.processes import OwnProgram, SideProcess, fresh_channel
from rrins.host_tools.testing.scenarios import prepare_scenario

_DELAY: Final = 2  # epochs until a command takes effect
_IN_TIME: Final = 0.9  # of the epochs
_TRIES: Final = 3  # the machine has others to serve: what is late once need not be the program's
_FAILURES: Final = 2
_PRIORITY: Final = 40  # below that of a program that asks for real time itself
_START_S: Final = 120.0
_LOOK_S: Final = 0.2  # between two looks whether the program still runs
_BUSY_S: Final = 0.002  # lateness of this side that makes a try worthless for the verdict
_MISSING: Final = 20  # frames, of three epochs
_CLOCK_HZ: Final = 100
_SETTLED: Final = 260  # epochs until the arrival of the first SYNC no longer matters
_PPM: Final = 30.0  # between the reported error and that of our own loop
_AGREE: Final = 0.64  # of the reports: noise of 0.5 ms in every 50th arrival leaves 68 %, a gain
# that is twice or half of what it should be at most 61 %
_AGREE_OF_TRIES: Final = 0.7
"""Of the epochs in one of several tries: noise hits others each time, a wrong loop the same."""
_GAINS: Final = (-1, 1)
"""Of loops that learn the period twice or half as fast, as shifts: a report is nearer to ours."""
_FAR_PPM: Final = 100.0  # farther off a report says no more: something has held it up
_JUMPED: Final = range(630, 730)  # epochs that only a reset of the phase explains: ten reports
_ALONE: Final = range(735, 800, 5)  # epochs whose SYNC is late, and those beside them are not
_LATE_NS: Final = 6_000_000


class _LateError(AssertionError):
    """The program is late: perhaps because the machine is."""


@dataclass
class _Heard:
    """Frames of the program, and when this side has sent its own."""

    commands: dict[int, int] = field(default_factory=dict)
    """Epochs whose commands came in time, and when, ns."""
    reports: list[tuple[int, float, bool]] = field(default_factory=list)
    """Epoch, `clock_error_ppm` and `sync_lost` of each FIRMWARE_STATUS."""
    modes: list[tuple[int, str]] = field(default_factory=list)
    loads_percent: list[float] = field(default_factory=list)  #: of each FIRMWARE_STATUS
    overruns: int = 0
    missing: int = 0
    sync_ns: list[int] = field(default_factory=list)  #: when each SYNC was sent; 0: it was not
    late_epochs: int = 0  #: of this side

    def in_time(self, epochs: Sequence[int]) -> float:
        """Return the share of epochs whose commands came in time."""
        return sum(epoch in self.commands for epoch in epochs) / len(epochs)

    def answer_ns(self, epochs: Sequence[int]) -> float:
        """Return the median time from SYNC to the commands of its epoch."""
        return statistics.median(
            self.commands[epoch] - self.sync_ns[epoch] for epoch in epochs if epoch in self.commands
        )


@dataclass(frozen=True)
class _Script:
    """The course of a session on this side."""

    epochs: int
    rate_hz: int
    offset_ns: Callable[[int], float] = lambda _: 0.0  #: of the epoch's SYNC from its due time
    has_sync: Callable[[int], bool] = lambda _: True
    halts: tuple[tuple[int, float, str], ...] = ()  #: epoch, seconds, and who: program, bus, both
    first: int = 0  #: epochs that go by before the program is there


def _repeatedly(subject: Subject, script: _Script, judge: Callable[[_Heard], None]) -> None:
    """Try again what is late, perhaps because the machine is: two failures of three decide."""
    failures = 0
    for number in range(_TRIES):
        heard = _session(subject, script)
        try:
            judge(heard)
        except _LateError:
            failures += 1
            if failures < _FAILURES:
                continue
            if heard.late_epochs > script.epochs // 20:
                late = heard.late_epochs / script.epochs
                raise NotApplicableError(
                    f"the machine is too busy to tell: in {late:.0%} of the epochs this side was "
                    f"itself late by more than {_BUSY_S * 1e3:g} ms"
                ) from None
            raise
        if number != 1:  # the first, or the third, after one that failed
            return


@check("firmware.md#clock", "CLK-3 CLK-5")
def clock_error(subject: Subject) -> None:
    """In real time the clock is disciplined by SYNC as the reference's is.

    Through errors of 100 ppm, steps of SYNC's phase, outliers and a loss, `clock_error_ppm` is that
    of our own loop fed with the same arrivals, and commands are in time. The load reported then
    leaves time for it.
    """
    script = _Script(880, _CLOCK_HZ, _offset_ns, lambda epoch: not 810 <= epoch < 830)
    closest: dict[int, tuple[float, float]] = {}  # of all tries, the report and what is due

    def judge(heard: _Heard) -> None:
        ours = _own_errors_ppm(heard.sync_ns)
        assert heard.reports, "no FIRMWARE_STATUS in real time"
        agree = _AGREE_OF_TRIES if closest else _AGREE
        jumped = 0
        for epoch, ppm, _ in heard.reports:
            due = _reported(ours[epoch])
            jumped += epoch in _JUMPED and abs(ppm - due) > 2 * _PPM
            before = closest.get(epoch, (math.inf, 0.0))
            if epoch >= _SETTLED and abs(ppm - due) < abs(before[0] - before[1]):
                closest[epoch] = ppm, due
        apart = {epoch: one for epoch, one in closest.items() if abs(one[0] - one[1]) > _PPM}
        is_jump_missed = jumped > 0.6 * len(_JUMPED) / (_CLOCK_HZ // 10)
        if len(apart) > (1 - agree) * len(closest) or is_jump_missed:
            epoch = sorted(apart)[len(apart) // 2]
            ppm, due = apart[epoch]
            raise _LateError(
                f"clock_error_ppm is {ppm:g} in epoch {epoch}, and by the arrival of SYNC "
                f"{due:.0f} ± {_PPM:g}; so {len(apart)} of {len(closest)} reports"
            )
        distance = _distance(heard, ours)
        for gain in _GAINS:
            if _distance(heard, _own_errors_ppm(heard.sync_ns, gain)) < distance:
                raise _LateError(
                    f"clock_error_ppm is nearer to a loop that learns the period "
                    f"{'half' if gain > 0 else 'twice'} as fast as firmware.md says"
                )
        lost = [epoch for epoch, _, is_lost in heard.reports if is_lost]
        if not lost or not set(lost) <= set(range(815, 836)):
            raise _LateError(f"sync_lost in the epochs {lost}, not in 820 only")
        _expect_in_time(heard, range(100, 580))
        _expect_in_time(heard, range(_ALONE.start, _ALONE.stop))
        load_percent = statistics.median(heard.loads_percent)
        if load_percent > 100:  # whatever else the machine does: it would not be in time
            raise _LateError(f"load_percent is {load_percent:g}, with commands in time")
        after_ns, else_ns = (heard.answer_ns([e + k for e in _ALONE]) for k in (1, 3))
        if after_ns - else_ns > _LATE_NS / 2:
            raise _LateError(
                f"a SYNC that is late alone, by {_LATE_NS / 1e6:g} ms, moves the clock: the next "
                f"epoch's commands come {after_ns / 1e6:.1f} ms after its SYNC, others "
                f"{else_ns / 1e6:.1f} ms"
            )

    _repeatedly(subject, script, judge)


def _offset_ns(epoch: int) -> float:
    """Return by how much SYNC is off a perfect clock: its rate, then steps, then outliers."""
    rate = 100e-6 * min(epoch, 200) - 100e-6 * max(0, min(epoch, 400) - 200)
    offset_ns = rate * 1e9 / _CLOCK_HZ
    if epoch >= 450:
        offset_ns += 100_000
    if epoch >= 520:
        offset_ns -= 100_000
    if 590 <= epoch < 597:
        offset_ns += 6_000_000
    if epoch >= 610:
        offset_ns += 6_000_000
    if epoch >= 622:
        offset_ns += 90_000
    if epoch >= 700:
        offset_ns -= 90_000
    if epoch in _ALONE:
        offset_ns += _LATE_NS
    return offset_ns


def _distance(heard: _Heard, errors_ppm: Sequence[float]) -> float:
    """Return how far the reports are from the errors of a loop, ppm in all."""
    return sum(
        min(_FAR_PPM, abs(ppm - _reported(errors_ppm[epoch])))
        for epoch, ppm, _ in heard.reports
        if epoch >= _SETTLED
    )


def _reported(error_ppm: float) -> float:
    return min(127.0, max(-128.0, error_ppm))


def _own_errors_ppm(sync_ns: Sequence[int], gain: int = 0) -> list[float]:
    """Return what our own loop reports in each epoch, of SYNC at these times.

    A `gain` other than 0 is added to the shift by which the loop learns the period.
    """
    clock = Clock.zeros()[0]
    period_ns = 1_000_000_000 // _CLOCK_HZ
    own_clock.power_on(clock, period_ns)
    synchronise = own_clock.synchronise
    if gain:
        plain = synchronise.py_func  # type: ignore[attr-defined]  # as all compiled functions have
        changed = {"_RATE_SHIFT": plain.__globals__["_RATE_SHIFT"] + gain}
        synchronise = FunctionType(plain.__code__, plain.__globals__ | changed)
    errors = []
    for arrival_ns in sync_ns:
        clock.sync_seen = arrival_ns > 0
        if arrival_ns > 0:
            clock.sync_arrival_ns = arrival_ns
            synchronise(clock, 0)
        if clock.synchronised:
            own_clock.advance(clock)
        errors.append(float(own_clock.error_ppm(clock, period_ns)))
    return errors


@check("firmware.md#clock", "CLK-4")
def stalls(subject: Subject) -> None:
    """In real time a stall of the program, of the bus or of both ends no navigation.

    Eight stalls of 12 to 60 ms at 200 Hz; a second later commands are in time again, and what the
    program has missed by itself counts as overruns.
    """
    halts = (
        *((1000 + 300 * k, seconds, "bus") for k, seconds in enumerate((0.012, 0.03, 0.06))),
        *((1900 + 300 * k, seconds, "both") for k, seconds in enumerate((0.03, 0.06))),
        *((2500 + 300 * k, seconds, "program") for k, seconds in enumerate((0.012, 0.03, 0.06))),
    )

    def judge(heard: _Heard) -> None:
        begun = next((epoch for epoch, mode in heard.modes if mode.startswith("NAVIGATION")), None)
        if begun is None or begun > 900:
            raise _LateError(f"it does not navigate after 4.5 s: mode {heard.modes[-1:]}")
        ended = [
            (e, mode) for e, mode in heard.modes if e > begun and mode != "NAVIGATION_ROTATING"
        ]
        if ended:
            raise _LateError(f"a stall ends the rotation: {ended[0][1]} in epoch {ended[0][0]}")
        for epoch, seconds, who in halts:
            try:
                _expect_in_time(heard, range(epoch + 200, epoch + 290))
            except _LateError as error:
                raise _LateError(
                    f"{error}, after a stall of {who} for {seconds * 1e3:g} ms"
                ) from None
        if heard.overruns == 0:
            raise _LateError("stalls of the program for 30 ms and 60 ms count as no overrun")

    _repeatedly(subject, _Script(3400, 200, halts=halts), judge)


@check("firmware.md#clock", "CLK-3 SYN-5")
def late_attach(subject: Subject) -> None:
    """In real time at 400 Hz a program that comes to a running hardware navigates in time.

    The hardware's clock is 800 ppm slow, so one that is not followed slips by an epoch. Four times
    the program stands still for two periods.
    """

    def judge(heard: _Heard) -> None:
        modes = [mode for _, mode in heard.modes]
        if "NAVIGATION_ROTATING" not in modes:
            raise _LateError(f"it does not navigate after 5 s: mode {modes[-1:]}")
        _expect_in_time(heard, range(2400, 2990))
        if heard.missing > _MISSING:
            raise _LateError(f"{heard.missing} frames are missing, though all were sent in time")

    halts = tuple((2000 + 100 * k, 0.005, "program") for k in range(4))
    script = _Script(4000, 400, lambda epoch: 800e-6 * epoch * 2.5e6, first=800, halts=halts)
    _repeatedly(subject, script, judge)


def _expect_in_time(heard: _Heard, epochs: Sequence[int]) -> None:
    share = heard.in_time(epochs)
    if share < _IN_TIME:
        raise _LateError(
            f"commands in time in {share:.1%} of the epochs {epochs[0]} to {epochs[-1]}"
        )


def _session(subject: Subject, script: _Script) -> _Heard:
    """Run the hardware of this process in real time against the program."""
    file = subject.folder / "clock.toml"
    overrides = {
        "firmware": {"alignment_s": 1.0},
        "duration_s": 600.0,
        "rate_hz": script.rate_hz,
        "redundancy": {"enabled": False},
    }
    scenario = prepare_scenario(SCENARIO, overrides, file, subject.folder)
    prepare_hardware(scenario)
    channel = fresh_channel()
    with RrinsBus(channel, host="here", name="hardware", exclusive=True) as bus:
        own = None
        if subject.program is not None:
            own = OwnProgram(Program.parse(subject.program), scenario)
        hardware = Hardware(hardware_settings(scenario))
        for epoch in range(script.first):
            hardware.open_epoch(epoch, hardware.inbox, 0)
        wait = ("--attach-wait", str(_START_S))
        side = SideProcess("firmware", file, channel, "1", *wait, own=own)
        try:
            _await(bus, side)
            return _Line(bus, scenario, hardware, side, script).run()
        finally:
            side.process.send_signal(signal.SIGCONT)
            side.stop()


def _await(bus: RrinsBus, side: SideProcess) -> None:
    """Wait until the program is on the bus; AssertionError if it ends, or does not come."""
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline:
        try:
            bus.wait_for("firmware", _LOOK_S)
        except can.CanTimeoutError:
            status = side.process.poll()
            assert status is None, f"it ended with status {status} before it was on the bus"
        else:
            return
    raise AssertionError(f"it has not come to the bus within {_START_S:g} s")


@contextlib.contextmanager
def _on_time() -> Iterator[None]:
    """Be on time on a busy machine, where that is permitted."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        os.sched_setscheduler(0, policy, parameters)


class _Line:
    """A session in real time."""

    def __init__(
        self,
        bus: RrinsBus,
        scenario: Scenario,
        hardware: Hardware,
        side: SideProcess,
        script: _Script,
    ) -> None:
        self._bus, self._hardware, self._side, self._script = bus, hardware, side, script
        self._period_ns = scenario.period_ns
        self._heard = _Heard()
        self._inbox = frame_array(4096)
        self._sync = identifier("SYNC")
        self._continue_ns = 0

    def run(self) -> _Heard:
        """Open epochs at their deadlines; take what comes meanwhile."""
        with _on_time():
            return self._run()

    def _run(self) -> _Heard:
        halts = {epoch: (seconds, who) for epoch, seconds, who in self._script.halts}
        script, hardware = self._script, self._hardware
        self._heard.sync_ns += [0] * script.first
        start_ns = time.monotonic_ns() - script.first * self._period_ns
        for epoch in range(script.first, script.epochs):
            due_ns = start_ns + epoch * self._period_ns + round(script.offset_ns(epoch))
            count = self._gather(due_ns, epoch)
            frames, sent = hardware.open_epoch(epoch, self._inbox, count)
            if not script.has_sync(epoch):
                frames = frames[:sent][frames["can_id"][:sent] != self._sync]
                sent = len(frames)
            now_ns = time.monotonic_ns()
            if now_ns - due_ns > _BUSY_S * 1e9 and not self._was_halted(halts, epoch):
                self._heard.late_epochs += 1
            self._heard.sync_ns.append(now_ns if script.has_sync(epoch) else 0)
            time_ns = epoch * self._period_ns
            self._bus.send_batch(frames, sent, epoch=epoch, time_ns=time_ns, closes_epoch=True)
            if epoch in halts:
                self._halt(*halts[epoch])
        return self._heard

    def _was_halted(self, halts: dict[int, tuple[float, str]], epoch: int) -> bool:
        return any(epoch - back in halts for back in range(20))

    def _halt(self, seconds: float, who: str) -> None:
        if who != "bus":
            self._side.process.send_signal(signal.SIGSTOP)
            self._continue_ns = time.monotonic_ns() + round(seconds * 1e9)
        if who != "program":
            time.sleep(seconds)
        self._go_on()

    def _go_on(self) -> None:
        if self._continue_ns and time.monotonic_ns() >= self._continue_ns:
            self._side.process.send_signal(signal.SIGCONT)
            self._continue_ns = 0

    def _gather(self, due_ns: int, epoch: int) -> int:
        """Take frames until a time; return how many came."""
        count, is_first = 0, True
        while is_first or time.monotonic_ns() < due_ns:
            is_first = False
            self._go_on()
            until_ns = min(due_ns, self._continue_ns or due_ns)
            left_ns = max(0, until_ns - time.monotonic_ns())
            batch = self._bus.recv_batch(self._inbox[count:], left_ns * 1e-9)
            if batch is None:
                continue
            for k in range(count, count + batch.count):
                self._take(self._inbox[k], epoch)
            count += batch.count
        return count

    def _take(self, frame: Frame, now: int) -> None:
        """Take a frame that came before epoch `now` was opened."""
        contract, heard = load_contract()[0], self._heard
        can_id = int(frame["can_id"])
        if can_id == int(contract.axis_outer_command.message.can_id):
            if crc_holds(frame, contract.axis_outer_command.message):
                age = (now - counter_of(frame["data"])) % COUNTER_MODULUS
                if age <= _DELAY:
                    heard.commands[now - age] = time.monotonic_ns()
        elif can_id == int(contract.firmware_status.message.can_id):
            status = contract.firmware_status
            if crc_holds(frame, status.message):
                every = self._script.rate_hz // 10
                epoch = (now - 1) // every * every
                ppm = decode(frame["data"], status.clock_error_ppm)
                is_lost = bool(decode(frame["data"], status.sync_lost))
                heard.reports.append((epoch, ppm, is_lost))
                heard.loads_percent.append(decode(frame["data"], status.load_percent))
                heard.modes.append((epoch, _MODES[int(decode(frame["data"], status.mode))]))
        elif can_id == int(contract.firmware_faults.message.can_id):
            faults = contract.firmware_faults
            if crc_holds(frame, faults.message):
                heard.overruns = int(decode(frame["data"], faults.overruns))
                heard.missing = int(decode(frame["data"], faults.missing_frames))


_MODES: Final = (
    "POWER_ON",
    "SELF_TEST",
    "STANDBY",
    "ALIGNMENT",
    "NAVIGATION_STRAPDOWN",
    "NAVIGATION_ROTATING",
    "FAULT",
    "SHUTDOWN",
    "FINE_ALIGNMENT",
)
