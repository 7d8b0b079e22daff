"""The wire between the two sides: its timing, and faults on it.

The wire is part of the hardware process, whatever bus carries the frames, and of a direct run: so
one scenario is the same in every way to run it. In virtual time an epoch looks like this::

    t             hardware's frames go to its controller
    t + T/2       the firmware's deadline: frames arrived by now are in its epoch; it sends its own
    t + T         the hardware's next epoch: frames arrived by now are in it

Frames after a deadline are delivered late, in the next epoch.
"""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from rrins.dbc.codec import load
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.wire.controller import ControllerWatch
from rrins.host_tools.wire.effects import ANY_IDENTIFIER, BABBLE_IDENTIFIER, FRAMES, Node
from rrins.host_tools.wire.fault_kinds import FaultKind
from rrins.host_tools.wire.fault_server import WireFaultServer
from rrins.host_tools.wire.faults import WireFault, WireFaults
from rrins.host_tools.wire.timing import WireModel

_HARDWARE, _FIRMWARE, _BABBLER = 0, 1, 2
_NODES = ("hardware", "firmware", "babbler")
_BUS_OFF_ERRORS = 32  # in a row, of 8 each, take a transmitter off the bus


class NodeSummary(TypedDict):
    """A node: its error counters, and its share of the load."""

    state: str
    tec: int
    rec: int
    errors: int
    bus_offs: int
    load: float


class MessageSummary(TypedDict):
    """A message: frames sent, its load, and times from the request for a frame."""

    sent: int
    load: float
    worst_delay_us: float  #: to the start of the frame
    worst_response_us: float  #: to its end


class WireSummary(TypedDict):
    """A run's wire statistics; loads are fractions of 1."""

    bitrate: int
    load: float
    worst_window_load: float  #: of windows of 100 ms
    nodes: dict[str, NodeSummary]
    messages: dict[str, MessageSummary]


class Wire:
    """The wire of a run.

    Parameters
    ----------
    period_ns : int
        Length of an epoch.
    faults : tuple of WireFault
        Of the scenario.
    seed : int
    bitrate : int or None
        In bit/s; None for an ideal wire, which takes no time.

    Attributes
    ----------
    faults : WireFaults
    fault_server : WireFaultServer
        Injects faults on FAULT_COMMAND.
    """

    def __init__(
        self, period_ns: int, faults: tuple[WireFault, ...], seed: int, bitrate: int | None
    ) -> None:
        self._period_ns = period_ns
        self._model = None if bitrate is None else WireModel(bitrate, _NODES)
        self._controller = None if self._model is None else ControllerWatch(self._model, _FIRMWARE)
        self.faults = WireFaults(faults, seed, has_timing=self._model is not None)
        self.fault_server = WireFaultServer(self.faults, period_ns)
        self._is_cut = False
        self._scratch = frame_array(FRAMES)
        self._to_firmware = frame_array(FRAMES)
        self._to_hardware = frame_array(FRAMES)
        self._held_for_firmware = 0
        self._held_for_hardware = 0
        self._out = frame_array(FRAMES)
        self._out_times_ns = np.zeros(FRAMES, dtype=np.int64)
        self._out_nodes = np.zeros(FRAMES, dtype=np.int64)
        self._out_receivers = np.zeros(FRAMES, dtype=np.int64)

    @property
    def is_ideal(self) -> bool:
        """Whether frames pass as they are: no timing, and no fault now or to come."""
        return self._model is None and self.faults.is_idle()

    def clear_until(self, epoch: int) -> int:
        """Return the epoch up to which all frames pass as they are, if no fault is put in."""
        return epoch if self.faults.acts(epoch) else self.same_until(epoch)

    def same_until(self, epoch: int) -> int:
        """Return the epoch up to which the same faults act, with no report.

        Until then `rrins.host_tools.wire.effects.affect` may take the place of `up` and `down`; in
        `epoch` it may not if that is what is returned.
        """
        if self._model is not None:
            return epoch
        until = self.faults.same_until(epoch)
        if until <= epoch:
            return epoch
        return min(until, self.fault_server.quiet_until(epoch, self.faults.acting(epoch)))

    def has_power(self, epoch: int) -> bool:
        """Return whether the firmware has power in an epoch."""
        return self.faults.has_power(epoch)

    def up(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return the frames that the firmware receives in an epoch, given the hardware's."""
        acts = self.faults.acts(epoch)
        if self._model is None and not acts and not self.fault_server.is_awake:
            return frames, count
        active = self.faults.active(epoch)
        passed = self._apply(Node.HARDWARE, frames, count, epoch, acts)
        if self._model is None:
            self._to_firmware[:passed] = self._scratch[:passed]
            arrived = passed
        else:
            arrived = self._transmit_up(self._model, active, passed, epoch)
        arrived = self.fault_server.report(active, epoch, self._to_firmware, arrived)
        return self._to_firmware, arrived

    def _transmit_up(
        self, model: WireModel, active: list[WireFault], passed: int, epoch: int
    ) -> int:
        start_ns = epoch * self._period_ns
        self._play(model, active, start_ns)
        model.submit(_HARDWARE, self._scratch, passed, start_ns)
        self._held_for_firmware = self._run(
            model, start_ns + self._period_ns // 2, self._held_for_firmware
        )
        arrived, self._held_for_firmware = self._held_for_firmware, 0
        assert self._controller is not None
        return arrived + self._controller.tell(self._to_firmware[arrived:])

    def down(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return the frames that the hardware receives in the next epoch, given the firmware's."""
        self.fault_server.receive(frames, count, epoch)
        acts = self.faults.acts(epoch)
        if self._model is None and not acts:
            return frames, count
        passed = self._apply(Node.FIRMWARE, frames, count, epoch, acts)
        if self._model is None:
            self._to_hardware[:passed] = self._scratch[:passed]
            return self._to_hardware, passed
        deadline_ns = epoch * self._period_ns + self._period_ns // 2
        self._model.submit(_FIRMWARE, self._scratch, passed, deadline_ns)
        end_ns = (epoch + 1) * self._period_ns
        self._held_for_firmware = self._run(self._model, end_ns, self._held_for_firmware)
        arrived, self._held_for_hardware = self._held_for_hardware, 0
        return self._to_hardware, arrived

    def _apply(self, sender: Node, frames: FrameArray, count: int, epoch: int, acts: bool) -> int:
        """Write a side's frames, after faults, to the scratch array."""
        if acts:
            return self.faults.apply(sender, frames, count, epoch, self._scratch)
        self._scratch[:count] = frames[:count]
        return count

    def statistics(self) -> WireSummary | None:
        """Return what the wire's model counted; None for an ideal wire."""
        if self._model is None:
            return None
        found = self._model.statistics()
        elapsed_ns = max(1, found["elapsed_ns"])
        codec = load()
        names = {codec.frame_id(one.name): one.name for one in codec.facts.messages}
        return {
            "bitrate": self._model.bitrate,
            "load": found["load"],
            "worst_window_load": found["worst_window_load"],
            "nodes": {
                name: {
                    "state": node["state"],
                    "tec": node["tec"],
                    "rec": node["rec"],
                    "errors": node["errors"],
                    "bus_offs": node["bus_offs"],
                    "load": node["busy_ns"] / elapsed_ns,
                }
                for name, node in found["nodes"].items()
            },
            "messages": {
                names.get(identifier, f"0x{identifier:03X}"): {
                    "sent": row["sent"],
                    "load": row["busy_ns"] / elapsed_ns,
                    "worst_delay_us": row["worst_delay_ns"] / 1000,
                    "worst_response_us": row["worst_response_ns"] / 1000,
                }
                for identifier, row in sorted(found["identifiers"].items())
            },
        }

    def _run(self, model: WireModel, until_ns: int, for_firmware: int) -> int:
        """Run the model; sort what was received by receiver. Returns frames for the firmware."""
        count = model.run(
            until_ns, self._out, self._out_times_ns, self._out_nodes, self._out_receivers
        )
        receivers = self._out_receivers[:count]
        frames = self._out[:count]
        for_hardware = self._held_for_hardware
        self._held_for_hardware = _append(
            self._to_hardware, for_hardware, frames[receivers >> _HARDWARE & 1 == 1]
        )
        return _append(self._to_firmware, for_firmware, frames[receivers >> _FIRMWARE & 1 == 1])

    def _play(self, model: WireModel, active: list[WireFault], start_ns: int) -> None:
        """Pass to the model the faults that it simulates."""
        cut = any(fault.kind == FaultKind.CUT for fault in active)
        if cut != self._is_cut:
            self._is_cut = cut
            model.cut(cut)
        for fault in active:
            if fault.kind == FaultKind.BABBLE:
                noise = frame_array(max(1, fault.parameter))
                noise["can_id"], noise["length"] = BABBLE_IDENTIFIER, 8
                model.submit(_BABBLER, noise, len(noise), start_ns)
            elif fault.kind in (FaultKind.CORRUPT_WIRE, FaultKind.BUS_OFF):
                self._fail(model, fault)

    @staticmethod
    def _fail(model: WireModel, fault: WireFault) -> None:
        nodes = {
            Node.ANY: (_HARDWARE, _FIRMWARE),
            Node.HARDWARE: (_HARDWARE,),
            Node.FIRMWARE: (_FIRMWARE,),
        }[fault.node]
        times = _BUS_OFF_ERRORS if fault.kind == FaultKind.BUS_OFF else 1
        for node in nodes:
            if model.has_order(node):
                continue
            if fault.identifier == ANY_IDENTIFIER:
                model.fail_next(node=node, times=times)
            else:
                model.fail_next(fault.identifier, node, times)


def _append(array: FrameArray, count: int, frames: FrameArray) -> int:
    """Append frames to the first `count` of an array, as many as fit; return the new count."""
    end = min(len(array), count + len(frames))
    array[count:end] = frames[: end - count]
    return end
