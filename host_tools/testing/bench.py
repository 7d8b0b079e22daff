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
from host_tools.errors import ScenarioError
from host_tools.fault_tables import FaultOnWire
from host_tools.faults import FaultAction
from host_tools.injection import fault_command
from host_tools.port import frame_of_message
from host_tools.results import east_north_m
from host_tools.scenario import Scenario, fault_of
from host_tools.testing.errors import BenchError
from host_tools.testing.realtime import RealtimeWorld
from host_tools.testing.recording import FrameRing, Values
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
        ring = FrameRing()
        super().__init__(WAYS[way](scenario, ring, scenario_file, patience_s), ring)

    # ---- what a test does to it

    def inject(
        self,
        kind: str,
        *,
        message: str | None = None,
        node: str = "any",
        for_s: float | None = None,
        delay_s: float | None = None,
        bit: int | None = None,
        frames_per_epoch: int | None = None,
        probability: float | None = None,
    ) -> None:
        """Put a fault on the wire from the next epoch on; in real time as soon as it arrives.

        Parameters
        ----------
        kind : str
            drop, delay, duplicate, reorder, corrupt_wire, corrupt, wrong_counter, babble, silence,
            bus_off or cut.
        message : str, optional
            Which frames; all of the node without it.
        node : {"any", "firmware", "hardware"}
            Whose frames.
        for_s : float, optional
            How long; without it until `clear_faults`.
        delay_s : float, optional
            Of a delay.
        bit : int, optional
            Of the payload, for corrupt; a random one without it.
        frames_per_epoch : int, optional
            For babble.
        probability : float, optional
            Share of the frames that are hit, not in real time.

        Raises
        ------
        ScenarioError
            For a fault that there is not.
        """
        given = {
            "message": message,
            "for_s": for_s,
            "delay_s": delay_s,
            "bit": bit,
            "frames_per_epoch": frames_per_epoch,
            "probability": probability,
        }
        checked = fault_of(
            {"kind": kind, "node": node} | {k: v for k, v in given.items() if v is not None}
        )
        wire = self._world.wire
        if wire is None:
            self._command(FaultAction.INJECT, checked)
            return
        if not isinstance(checked, FaultOnWire):
            raise ScenarioError(f"{kind}: can be in a scenario only")
        fault = checked.fault(self.scenario.rate_hz)
        first = self._world.epoch
        last = -1 if fault.last_epoch < 0 else first + fault.last_epoch
        wire.faults.add(dataclasses.replace(fault, first_epoch=first, last_epoch=last))

    def clear_faults(self) -> None:
        """Take all faults off the wire, those of the scenario too."""
        wire = self._world.wire
        if wire is None:
            self._command(FaultAction.CLEAR)
        else:
            wire.faults.clear()

    def _command(self, action: FaultAction, fault: Any = None) -> None:
        counter = self._count_up(self._contract.can_id("FAULT_COMMAND"))
        self.send_frame(fault_command(action, fault, counter))

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
        """A python-can bus of the test's own on the channel; opened when first asked for."""
        if self._bus is None:
            self._bus = self._on_bus().attach()
        return self._bus

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
        self._world.close()
        if self._world.died and not self._told:
            self._told = self._world.died
            raise BenchError(self._told)
