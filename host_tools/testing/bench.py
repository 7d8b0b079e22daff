"""A bench: a whole rehearsal in the hands of a test, the same in each of the three ways."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

import can

from dbc.e2e import COUNTER_MODULUS, counter_of
from dbc.frame import frame_array
from dbc.values import FaultAction, FaultRefusal
from host_tools.diag.target import Target
from host_tools.diag.tester import Tester
from host_tools.errors import ScenarioError
from host_tools.fault_tables import FaultOnWire
from host_tools.injection.messages import Fault, fault_commands, plain_command
from host_tools.port import frame_of_message
from host_tools.results import east_north_m
from host_tools.scenario import Scenario, fault_of
from host_tools.testing.errors import BenchError
from host_tools.testing.medium import BenchMedium, BenchTarget
from host_tools.testing.realtime import RealtimeWorld
from host_tools.testing.recording import FrameRing, Values
from host_tools.testing.virtual_bus import VirtualTimeBus
from host_tools.testing.watcher import Watcher
from host_tools.testing.worlds import DirectWorld, LockstepWorld, World

Maker = Callable[[Scenario, FrameRing, Path, float], World]

WAYS: dict[str, Maker] = {
    "direct": lambda scenario, ring, file, patience_s: DirectWorld(scenario, ring),
    "lockstep": LockstepWorld,
    "realtime": RealtimeWorld,
}
"""The ways to run a bench, by name."""


@dataclasses.dataclass(frozen=True)
class Navigation:
    """Where the firmware says to be: the last NAV_* frames."""

    time_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    velocity_east_mps: float
    velocity_north_mps: float
    velocity_up_mps: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float


@dataclasses.dataclass(frozen=True)
class Truth(Navigation):
    """Where the vehicle really is, and the true angles of the turntable's axes."""

    inner_deg: float
    outer_deg: float


class EastNorth(NamedTuple):
    """A pair of figures."""

    east: float
    north: float


def _checked(kind: str, keys: dict[str, Any]) -> Fault:
    if "at_s" in keys:
        raise ScenarioError("fault: at_s: a live fault begins at once")
    return fault_of({"kind": kind} | {key: v for key, v in keys.items() if v is not None})


class Bench(Watcher):
    """A rehearsal that a test drives.

    Parameters
    ----------
    scenario : Scenario
    scenario_file : Path
        The same scenario, for processes to load.
    way : {"direct", "lockstep", "realtime"}
    patience_s : float
        Longest silence of a process, by the clock on the wall; 0 waits for ever.

    Attributes
    ----------
    scenario : Scenario
    way : str
    """

    def __init__(
        self, scenario: Scenario, scenario_file: Path, way: str = "direct", patience_s: float = 60.0
    ) -> None:
        if way not in WAYS:
            raise BenchError(f"way is {way!r} and may be {', '.join(WAYS)}")
        self.scenario = scenario
        self.way = way
        self._counters: dict[int, int] = {}
        self._bus: can.BusABC | None = None
        self._attached: list[VirtualTimeBus] = []
        ring = FrameRing()
        super().__init__(WAYS[way](scenario, ring, scenario_file, patience_s), ring)

    # ---- what a test does to it

    def inject(self, kind: str, **keys: Any) -> None:
        """Put in a fault from the next epoch on; in real time as soon as the command arrives.

        The same fault again takes the place of the one that is active.

        Parameters
        ----------
        kind : str
            On the wire drop, delay, duplicate, reorder, corrupt_wire, corrupt, wrong_counter,
            babble, silence, bus_off, cut or stale; of the hardware axis_stall, axis_runaway,
            encoder_stuck, encoder_offset, gyro_ or accelerometer_ stuck, bias, noise or absent.
        **keys
            As in a scenario's `[[faults]]`, but `at_s`. Of all: `for_s`; without it until it is
            taken out. On the wire: `message`, `node`, `probability`, `delay_s`, `bit`,
            `frames_per_epoch`. Of the hardware: `axis`, `rate_dps`, `offset_deg`; `sensor`,
            `bias_dph`, `bias_ug`, `angle_random_walk_deg_per_sqrt_h`,
            `white_noise_ug_per_sqrt_hz`.

        Raises
        ------
        ScenarioError
            For a fault that there is not.
        BenchError
            For one that cannot be put in: too many, or of what this hardware has not.
        """
        fault = _checked(kind, keys)
        wire, desk = self._world.wire, self._world.desk
        if wire is None or desk is None:
            self._command(FaultAction.INJECT, fault)
            return
        rate_hz = self.scenario.rate_hz
        if isinstance(fault, FaultOnWire):
            planned = fault.fault(rate_hz)
            first = self._world.epoch
            last = -1 if planned.last_epoch < 0 else first + planned.last_epoch
            refusal = wire.desk.inject(
                dataclasses.replace(planned, first_epoch=first, last_epoch=last)
            )
        else:
            _, last = fault.epochs(rate_hz)
            refusal = desk.inject(fault.hardware_kind, fault.target, fault.value, last + 1)
        if refusal != FaultRefusal.NONE:
            raise BenchError(f"{kind}: {refusal.name}")

    def remove_fault(self, kind: str, **keys: Any) -> None:
        """Take a fault out again, from the next epoch on.

        Parameters
        ----------
        kind : str
        **keys
            What says which one: `message` and `node`, `axis`, or `sensor`, as it was put in.

        Raises
        ------
        ScenarioError
            For a fault that there is not.
        BenchError
            When there is none such; not in real time.
        """
        fault = _checked(kind, keys)
        wire, desk = self._world.wire, self._world.desk
        if wire is None or desk is None:
            self._command(FaultAction.REMOVE, fault)
            return
        if isinstance(fault, FaultOnWire):
            said = fault.fault(self.scenario.rate_hz)
            refusal = wire.desk.remove(said.kind, said.node, said.identifier, self._world.epoch)
        else:
            refusal = desk.remove(fault.hardware_kind, fault.target)
        if refusal != FaultRefusal.NONE:
            raise BenchError(f"{kind}: {refusal.name}")

    def clear_faults(self) -> None:
        """Take out all faults, on the wire and of the hardware, those of the scenario too."""
        wire, desk = self._world.wire, self._world.desk
        if wire is None or desk is None:
            for of_hardware in (False, True):
                name = "HARDWARE_FAULT_COMMAND" if of_hardware else "FAULT_COMMAND"
                counter = self._count_up(self._contract.can_id(name))
                self.send_frame(plain_command(FaultAction.CLEAR, of_hardware, counter))
        else:
            wire.faults.clear()
            desk.clear()

    def _command(self, action: FaultAction, fault: Fault) -> None:
        on_wire = isinstance(fault, FaultOnWire)
        can_id = self._contract.can_id("FAULT_COMMAND" if on_wire else "HARDWARE_FAULT_COMMAND")
        for message in fault_commands(action, fault, self._count_up(can_id)):
            self._counters[can_id] = message.data[1] & 0xF
            self.send_frame(message)

    def send(self, message_name: str, **values: Any) -> None:
        """Send a message of the contract, with the right counter and CRC.

        It comes just before the next epoch; in real time at once. Signals that are not given are
        0. Giving `crc` or `alive_counter` sends a wrong one.

        Raises
        ------
        BenchError
            For a message or signal that the DBC has not, or a value out of range.
        """
        can_id = self._contract.can_id(message_name)
        if self._contract.is_sent_every_epoch(message_name):
            counter = self._world.epoch % COUNTER_MODULUS
        else:
            counter = self._count_up(can_id)
        self._world.put(self._contract.encode(message_name, values, counter), 1)

    def send_frame(self, message: can.Message) -> None:
        """Send any classic frame, as it is; see `send` for when it comes."""
        if message.is_fd:
            raise BenchError("a bench carries classic frames only")
        frames = frame_array(1)
        frame_of_message(frames[0], message)
        self._world.put(frames, 1)

    def _count_up(self, can_id: int) -> int:
        """Return the next own counter of a message, not one that another sender is about to use."""
        self._world.catch_up()
        counter = (self._counters.get(can_id, -1) + 1) % COUNTER_MODULUS
        others = self._ring.find(can_id)[0][-3:]
        near = {int(counter_of(frame["data"])) for frame in others}
        near |= {(seen + 1) % COUNTER_MODULUS for seen in near}
        near.discard(self._counters.get(can_id, -1))
        while counter in near:
            counter = (counter + 1) % COUNTER_MODULUS
        self._counters[can_id] = counter
        return counter

    # ---- truth and navigation

    @property
    def truth(self) -> Truth:
        """Where the vehicle really is after the last epoch; not in real time."""
        record = self._world.truth()
        inner, outer = (math.degrees(angle) for angle in record["axis_angle"])
        east, north, up = (float(v) for v in record["velocity_n"])
        return Truth(
            time_s=int(record["epoch"]) * self.scenario.period_ns / 1e9,
            lat_deg=math.degrees(record["latitude"]),
            lon_deg=math.degrees(record["longitude"]),
            height_m=float(record["height"]),
            velocity_east_mps=east,
            velocity_north_mps=north,
            velocity_up_mps=up,
            roll_deg=math.degrees(record["roll"]),
            pitch_deg=math.degrees(record["pitch"]),
            heading_deg=math.degrees(record["heading"]) % 360.0,
            inner_deg=inner,
            outer_deg=outer,
        )

    @property
    def navigation(self) -> Navigation | None:
        """Where the firmware says to be, in the last NAV_* frames; None before there are any."""
        names = ("NAV_LATITUDE", "NAV_LONGITUDE", "NAV_HEIGHT", "NAV_VELOCITY", "NAV_ATTITUDE")
        values: Values = {}
        for name in reversed(names):  # time and epoch are those of the latitude
            last = self.last(name)
            if last is None:
                return None
            values |= last
        return Navigation(
            time_s=values["time_s"],
            lat_deg=values["latitude_deg"],
            lon_deg=values["longitude_deg"],
            height_m=values["height"],
            velocity_east_mps=values["velocity_east"],
            velocity_north_mps=values["velocity_north"],
            velocity_up_mps=values["velocity_up"],
            roll_deg=values["roll_deg"],
            pitch_deg=values["pitch_deg"],
            heading_deg=values["heading_deg"],
        )

    def errors_m(self) -> EastNorth:
        """Return how far the firmware's last position is off the truth of its epoch.

        Raises
        ------
        BenchError
            In real time, and before navigation.
        """
        ours = self.navigation
        if ours is None:
            raise BenchError("the firmware has not navigated yet")
        true = self._world.truth_at(round(ours.time_s * 1e9))
        east, north = east_north_m(
            math.radians(ours.lat_deg),
            math.radians(ours.lon_deg),
            true["latitude"],
            true["longitude"],
            true["height"],
        )
        return EastNorth(float(east), float(north))

    # ---- the bus and processes behind it

    def _on_bus(self) -> LockstepWorld | RealtimeWorld:
        if not isinstance(self._world, LockstepWorld | RealtimeWorld):
            raise BenchError("in the direct way there is no bus and no process")
        return self._world

    @property
    def channel(self) -> str:
        """Channel of the embedded bus, for others to attach to; not in the direct way."""
        return self._on_bus().channel

    @property
    def process(self) -> Popen[bytes]:
        """The firmware's process; not in the direct way."""
        return self._on_bus().side.process

    @property
    def bus(self) -> can.BusABC:
        """A python-can bus of the test's own; opened when first asked for."""
        if self._bus is None:
            self._bus = self.attach()
        return self._bus

    def attach(self) -> can.BusABC:
        """Return a new python-can bus of the test's own.

        In the direct way the bench's time passes while the bus receives, and its timeouts are
        simulated seconds.
        """
        if isinstance(self._world, DirectWorld):
            bus = VirtualTimeBus(self, self._ring)
            self._attached.append(bus)
            return bus
        return self._on_bus().attach()

    def tester(self, is_securing: bool = False) -> Tester:
        """Return a diagnostic tester (UDS) for the firmware, as `rrins diag` uses it.

        In virtual time the bench's time passes while it waits for a response.

        Parameters
        ----------
        is_securing : bool
            Whether it may unlock the computer where a request needs that.
        """
        if isinstance(self._world, RealtimeWorld):
            return Tester(Target(channel=self.channel), is_securing)
        medium = BenchMedium(self, self._ring)
        return Tester(BenchTarget(medium=medium), is_securing)

    def write_log(self, path: Path) -> int:
        """Write the frames that are remembered as a candump log; return how many."""
        return self._ring.write_log(path, "rrins")

    def close(self) -> None:
        """End everything. Idempotent.

        Raises
        ------
        BenchError
            When a process had died and no call of the test has said so.
        """
        for bus in self._attached:
            bus.shutdown()
        self._world.close()
        if self._world.died and not self._told:
            self._told = self._world.died
            raise BenchError(self._told)
