"""A bench: a whole rehearsal driven by a test, the same in each of the three ways."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from subprocess import Popen
from tempfile import TemporaryDirectory

import can

from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.closing import Closing
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.results.results import east_north_m
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.diagnostics import BenchTarget, BenchTransport
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.expectation import Expectation, Where, in_words
from rrins.host_tools.testing.faults import BenchFaults
from rrins.host_tools.testing.processes import OwnProgram
from rrins.host_tools.testing.realtime import RealtimeExecution
from rrins.host_tools.testing.recording import (
    Contract,
    FrameRing,
    Messages,
    SignalValue,
    Values,
)
from rrins.host_tools.testing.sending import FrameSender
from rrins.host_tools.testing.states import EastNorthPair, NavigationFix, TrueState
from rrins.host_tools.testing.virtual_bus import VirtualTimeBus
from rrins.host_tools.testing.virtual_time import DirectExecution, Execution, LockstepExecution

Maker = Callable[
    [Scenario, FrameRing, Path, float, bool, OwnProgram | None, Path | None], Execution
]

WAYS: dict[str, Maker] = {
    "direct": lambda scenario, ring, *rest: DirectExecution(scenario, ring, rest[-1]),
    "lockstep": LockstepExecution,
    "realtime": RealtimeExecution,
}
"""The ways to run a bench, by name."""

_STATUS, _FAULTS = "FIRMWARE_STATUS", "FIRMWARE_FAULTS"
_NO_COUNTERS = ("crc", "alive_counter", "time_s", "crc_holds")


class Bench(Closing):
    """A rehearsal that a test, or any other program, drives.

    Parameters
    ----------
    scenario : Scenario
    scenario_file : Path, optional
        The same scenario as a file, for the processes; without it they get one of their own.
    way : {"direct", "lockstep", "realtime"}
    patience_s : float
        Longest silence of a process, in wall clock time; 0 waits forever.
    foreign_senders : bool
        Whether clients that a test attaches may send what the contract gives to a side. In real
        time the bench itself is such a client.
    program : str, optional
        The user's program, or its command line, as the firmware: always a process of its own.
    memory : Path, optional
        File of the firmware's parameter memory; without one, what a test writes there is lost when
        the power is.

    Attributes
    ----------
    scenario : Scenario
    way : str
    """

    def __init__(
        self,
        scenario: Scenario,
        scenario_file: Path | None = None,
        way: str = "direct",
        patience_s: float = 60.0,
        foreign_senders: bool = True,
        program: str | None = None,
        memory: Path | None = None,
    ) -> None:
        if way not in WAYS:
            raise BenchError(f"way {way!r} is not one of {', '.join(WAYS)}")
        if program is not None and way == "direct":
            way = "lockstep"  # another program is a process
        own = None if program is None else OwnProgram(Program.parse(program), scenario)
        self.scenario = scenario
        self.way = way
        self._ends = ExitStack()
        if scenario_file is None:
            folder = self._ends.enter_context(TemporaryDirectory(prefix="rrins-"))
            scenario_file = Path(folder) / "scenario.toml"
            scenario_file.write_text(scenario.toml(), encoding="utf-8")
        self._bus: can.BusABC | None = None
        self._attached: list[VirtualTimeBus] = []
        self._ring = FrameRing()
        self._execution = WAYS[way](
            scenario, self._ring, scenario_file, patience_s, foreign_senders, own, memory
        )
        self._contract = Contract()
        self._sender = FrameSender(self._execution, self._ring, self._contract)
        self._faults = BenchFaults(self._execution, self._sender)
        self._reported = ""  # why it has ended, as reported to the test

    # ---- what a test sees

    @property
    def time_s(self) -> float:
        """Simulated time since power-on."""
        return self._execution.now_ns / 1e9

    def advance(self, seconds: float) -> None:
        """Let simulated time pass, rounded to epochs; in real time, wait that long.

        Raises
        ------
        BenchError
            If a process has died or the scenario is over.
        """
        until_ns = self._execution.now_ns + round(seconds * 1e9)
        while self._going_on(self._execution.advance, until_ns):
            pass

    def step(self, epochs: int = 1) -> None:
        """Let epochs pass, one by default; see `advance`."""
        self.advance(epochs * self.scenario.period_ns / 1e9)

    def _pump(self, until_ns: int) -> bool:
        return self._going_on(self._execution.pump, until_ns)

    def _going_on(self, go_on: Callable[[int], bool], until_ns: int) -> bool:
        try:
            return go_on(until_ns)
        except BenchError as error:
            self._reported = str(error)
            raise

    def expect(self, message: str, within: float, where: Where = None, at_least: int = 1) -> Values:
        """Let time pass until a matching frame has been sent, by anyone; return its values.

        Only frames from now on count; in real time, those since the last call of the bench. Frames
        with a wrong CRC do not count, unless `where` includes ``crc_holds``.

        Parameters
        ----------
        message : str
            Name in the DBC.
        within : float
            Seconds of simulated time.
        where : dict or callable, optional
            Wanted values by signal name (a value, or a callable that accepts it), or a callable
            that accepts all values of a frame.
        at_least : int
            Number of matching frames to wait for.

        Returns
        -------
        dict
            Values of the last one: signals by name, `time_s`, `crc_holds`.

        Raises
        ------
        AssertionError
            If they were not sent; the message says what was sent instead.
        BenchError
            If a name is not in the DBC, a process has died, or the scenario is over.
        """
        __tracebackhide__ = True
        wanted = Expectation(self._contract, message, where)
        start_ns = self._execution.now_ns
        first = seen = self._ring.total
        hits: list[Values] = []
        until_ns = start_ns + round(within * 1e9)
        while self._pump(until_ns):
            hits += wanted.hits(self._ring, seen)
            seen = self._ring.total
            if len(hits) >= at_least:
                return hits[at_least - 1]
        came = self._contract.can_id(message)
        count = len(self._ring.find(came, first)[0])
        number = "" if at_least == 1 else f" {at_least} times ({len(hits)} came)"
        raise AssertionError(
            f"no {wanted}{number} within {within:g} s, by {self.time_s:.3f} s\n"
            f"  {count} {message} came meanwhile; {self._last_words(message)}\n"
            f"{self._state_words()}"
        )

    def expect_not(self, message: str, within: float, where: Where = None) -> None:
        """Let time pass and check that no matching frame is sent; see `expect`.

        Raises
        ------
        AssertionError
            As soon as one is sent.
        """
        __tracebackhide__ = True
        wanted = Expectation(self._contract, message, where)
        start_s = self.time_s
        seen = self._ring.total
        until_ns = self._execution.now_ns + round(within * 1e9)
        while self._pump(until_ns):
            hits = wanted.hits(self._ring, seen)
            seen = self._ring.total
            if hits:
                raise AssertionError(
                    f"{wanted} came {hits[0]['time_s'] - start_s:.3f} s after {start_s:.3f} s, "
                    f"unwanted for {within:g} s\n  {in_words(hits[0])}\n{self._state_words()}"
                )

    def messages(self, message: str) -> Messages:
        """Return all recorded frames of a message, oldest first."""
        self._execution.catch_up()
        return Messages(self._contract, message, *self._ring.find(self._contract.can_id(message)))

    def last(self, message: str) -> Values | None:
        """Return the values of the last sound frame of a message; None if there was none."""
        every = self.messages(message)
        return next((values for values in reversed(every) if values["crc_holds"]), None)

    @property
    def mode(self) -> str:
        """Mode of the firmware, as last reported; empty before the first report."""
        return str((self.last(_STATUS) or {}).get("mode", ""))

    @property
    def fault_counters(self) -> dict[str, int]:
        """Fault counters of the firmware, as last reported: crc_errors, missing_frames, ….

        Empty before the first report.
        """
        values = self.last(_FAULTS) or {}
        return {name: int(value) for name, value in values.items() if name not in _NO_COUNTERS}

    @property
    def ram(self) -> Ram:
        """The firmware's memory, a record of numpy; only in the direct way.

        It is another one after the firmware has been without power.
        """
        if not isinstance(self._execution, DirectExecution):
            raise BenchError("the firmware's memory is in its own process; use way='direct'")
        return self._execution.firmware.ram[0]

    @property
    def frames_sha256(self) -> str:
        """Digest of the recorded frames, with their times and senders."""
        return self._ring.sha256()

    @property
    def frames(self) -> int:
        """Frames on the bus so far."""
        return self._ring.total

    def _last_words(self, message: str) -> str:
        last = self.last(message)
        return "there was none before" if last is None else f"the last one ever: {in_words(last)}"

    def _state_words(self) -> str:
        status, counters = self.last(_STATUS), self.fault_counters
        if status is None:
            return "  the firmware has not reported its mode yet"
        listed = ", ".join(f"{name} {value}" for name, value in counters.items())
        return (
            f"  mode {status['mode']}, fault {status['fault']} at {status['time_s']:.3f} s\n"
            f"  fault counters: {listed}"
        )

    # ---- stimulation

    def inject(self, kind: str, **keys: str | float | None) -> None:
        """Inject a fault from the next epoch on; in real time as soon as the command arrives.

        Injecting an active fault again replaces it.

        Parameters
        ----------
        kind : str
            On the wire: drop, delay, duplicate, reorder, corrupt_wire, corrupt, wrong_counter,
            babble, silence, bus_off, cut, stale or power_off. In the hardware: axis_stall,
            axis_runaway, encoder_stuck, encoder_offset, ``gyro_`` or ``accelerometer_`` stuck,
            dead, absent, full_scale, bias, ramp, noise, scale, shift_u or shift_v.
        **keys
            As in a scenario's `[[faults]]`, except `at_s`. All faults: `for_s`; without it they
            last until removed. On the wire: `message`, `node`, `probability`, `delay_s`, `bit`,
            `frames_per_epoch`. In the hardware: `period_s` and `duty` of intermittent faults;
            `axis`, `rate_dps`, `offset_deg`; `sensor`, `bias_dph`, `bias_ug`, `bias_dph_per_min`,
            `bias_ug_per_min`, `scale_ppm`, `shift_arcsec`, `angle_random_walk_deg_per_sqrt_h`,
            `white_noise_ug_per_sqrt_hz`.

        Raises
        ------
        ScenarioError
            If there is no such fault.
        BenchError
            If it is refused: too many faults, or no such axis or sensor.
        """
        self._faults.inject(kind, keys)

    def remove_fault(self, kind: str, **keys: str | float | None) -> None:
        """Remove a fault from the next epoch on.

        Parameters
        ----------
        kind : str
        **keys
            Keys that identify it: `message` and `node`, `axis`, or `sensor`, as injected.

        Raises
        ------
        ScenarioError
            If there is no such kind of fault.
        BenchError
            If it is not active; never in real time.
        """
        self._faults.remove(kind, keys)

    def clear_faults(self) -> None:
        """Remove all faults, on the wire and in the hardware, including those of the scenario."""
        self._faults.clear()

    def send(self, message_name: str, **values: SignalValue) -> None:
        """Send a message of the contract, with the right counter and CRC.

        It arrives just before the next epoch; in real time at once. Omitted signals are 0. Give
        `crc` or `alive_counter` to send a wrong one.

        Raises
        ------
        BenchError
            If the DBC has no such message or signal, or a value is out of range.
        """
        self._sender.send(message_name, values)

    def send_frame(self, message: can.Message) -> None:
        """Send any classic frame unchanged; see `send` for when it arrives."""
        self._sender.send_frame(message)

    # ---- power

    @property
    def is_on(self) -> bool:
        """Whether the firmware has power."""
        return self._execution.is_on

    def power_off(self) -> None:
        """Cut the firmware's power at once; the hardware and the bus go on."""
        if self.is_on:
            self._execution.power_off()

    def power_on(self) -> None:
        """Switch the firmware on: it begins anew, with what its non-volatile memory holds.

        Raises
        ------
        BenchError
            If it does not start.
        """
        if not self.is_on:
            self._execution.power_on()

    def power_cycle(self, off_s: float) -> None:
        """Take the firmware's power for a time; in real time its start takes longer than that.

        Parameters
        ----------
        off_s : float
            Seconds of simulated time, rounded to epochs.
        """
        self.power_off()
        self.advance(off_s)
        self.power_on()

    # ---- truth and navigation

    @property
    def truth(self) -> TrueState:
        """The true state of the vehicle after the last epoch; not in real time."""
        return TrueState.of_hardware(self._execution.truth(), self.scenario.period_ns)

    @property
    def navigation(self) -> NavigationFix | None:
        """The firmware's navigation output, from the last NAV_* frames; None before the first."""
        names = ("NAV_LATITUDE", "NAV_LONGITUDE", "NAV_HEIGHT", "NAV_VELOCITY", "NAV_ATTITUDE")
        values: Values = {}
        for name in reversed(names):  # time and epoch are those of the latitude
            last = self.last(name)
            if last is None:
                return None
            values |= last
        return NavigationFix.of(values)

    def errors_m(self) -> EastNorthPair:
        """Return the error of the firmware's last position against the truth of its epoch, m.

        Raises
        ------
        BenchError
            In real time, and before navigation.
        """
        ours = self.navigation
        if ours is None:
            raise BenchError("the firmware has not navigated yet")
        true = self._execution.truth_at(round(ours.time_s * 1e9))
        east, north = east_north_m(
            math.radians(ours.lat_deg),
            math.radians(ours.lon_deg),
            true["latitude"],
            true["longitude"],
            true["height"],
        )
        return EastNorthPair(float(east), float(north))

    # ---- the bus and processes behind it

    def _on_bus(self) -> LockstepExecution | RealtimeExecution:
        if not isinstance(self._execution, LockstepExecution | RealtimeExecution):
            raise BenchError("the direct way has no bus and no process")
        return self._execution

    @property
    def channel(self) -> str:
        """Channel of the embedded bus, for other clients; not in the direct way."""
        return self._on_bus().channel

    @property
    def process(self) -> Popen[bytes]:
        """The firmware's process; not in the direct way."""
        return self._on_bus().side.process

    @property
    def bus(self) -> can.BusABC:
        """The test's own python-can bus; opened on first use."""
        if self._bus is None:
            self._bus = self.attach()
        return self._bus

    def attach(self) -> can.BusABC:
        """Return a new python-can bus for the test.

        In the direct way the bench's time advances while the bus receives, and its timeouts are
        simulated seconds.
        """
        if isinstance(self._execution, DirectExecution):
            bus = VirtualTimeBus(self, self._ring)
            self._attached.append(bus)
            return bus
        return self._on_bus().attach()

    def tester(self, is_securing: bool = False) -> Tester:
        """Return a diagnostic tester (UDS) for the firmware, like that of `rrins diag`.

        In virtual time the bench's time advances while it waits for a response.

        Parameters
        ----------
        is_securing : bool
            Whether it may unlock the computer if a request needs it.
        """
        if isinstance(self._execution, RealtimeExecution):
            return Tester(Target(channel=self.channel), is_securing)
        medium = BenchTransport(self, self._ring)
        return Tester(BenchTarget(medium=medium), is_securing)

    def write_log(self, path: Path) -> int:
        """Write the recorded frames as a candump log; return their number."""
        return self._ring.write_log(path, "rrins")

    def close(self) -> None:
        """Stop everything. Idempotent.

        Raises
        ------
        BenchError
            If a process had died and no earlier call reported it.
        """
        for bus in self._attached:
            bus.shutdown()
        self._execution.close()
        self._ends.close()
        if self._execution.died and not self._reported:
            self._reported = self._execution.died
            raise BenchError(self._reported)
