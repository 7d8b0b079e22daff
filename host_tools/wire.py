"""What lies between the two sides besides the transport: the wire's timing, and faults on it.

The wire is part of the hardware process, whatever bus carries the frames, and of a direct run: so
one scenario is the same in every way to run it. In virtual time an epoch looks like this::

    t             hardware's frames go to its controller
    t + T/2       the firmware's deadline: what has come by now is in its epoch; its own frames go
    t + T         the hardware's next epoch: what has come by now is in it

What comes after a deadline is handed over in the next epoch, late.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dbc.codec import load
from dbc.frame import FrameArray, frame_array
from host_tools.bus.timing import WireModel
from host_tools.controller import ControllerWatch
from host_tools.fault_desk import FaultDesk
from host_tools.faults import ANY_IDENTIFIER, Fault, FaultKind, Faults, Node, babble

_CAPACITY = 4096
_HARDWARE, _FIRMWARE, _BABBLER = 0, 1, 2
_NODES = ("hardware", "firmware", "babbler")
_BUS_OFF_ERRORS = 32  # in a row, of 8 each, take a transmitter off the bus


class Wire:
    """The wire of a run.

    Parameters
    ----------
    period_ns : int
        Length of an epoch.
    faults : tuple of Fault
        Of the scenario.
    seed : int
    bitrate : int or None
        In bit/s; None for an ideal wire, which takes no time.

    Attributes
    ----------
    faults : Faults
    desk : FaultDesk
        Puts in faults, as FAULT_COMMANDs ask for.
    """

    def __init__(
        self, period_ns: int, faults: tuple[Fault, ...], seed: int, bitrate: int | None
    ) -> None:
        self._period_ns = period_ns
        self._model = None if bitrate is None else WireModel(bitrate, _NODES)
        self._controller = None if self._model is None else ControllerWatch(self._model, _FIRMWARE)
        self.faults = Faults(faults, seed, has_timing=self._model is not None)
        self.desk = FaultDesk(self.faults, period_ns)
        self._is_cut = False
        self._scratch = frame_array(_CAPACITY)
        self._to_firmware = frame_array(_CAPACITY)
        self._to_hardware = frame_array(_CAPACITY)
        self._held_for_firmware = 0
        self._held_for_hardware = 0
        self._out = frame_array(_CAPACITY)
        self._out_times_ns = np.zeros(_CAPACITY, dtype=np.int64)
        self._out_nodes = np.zeros(_CAPACITY, dtype=np.int64)
        self._out_receivers = np.zeros(_CAPACITY, dtype=np.int64)

    @property
    def is_ideal(self) -> bool:
        """Whether frames pass as they are: no timing, and no fault now or to come."""
        return self._model is None and self.faults.is_idle()

    def up(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the firmware gets in an epoch, given what the hardware sends in it."""
        acts = self.faults.acts(epoch)
        if self._model is None and not acts and not self.desk.is_awake:
            return frames, count
        active = self.faults.active(epoch)
        passed = self._apply(Node.HARDWARE, frames, count, epoch, acts)
        if self._model is None:
            self._to_firmware[:passed] = self._scratch[:passed]
            arrived = passed
        else:
            arrived = self._transmit_up(self._model, active, passed, epoch)
        arrived = self.desk.report(active, epoch, self._to_firmware, arrived)
        return self._to_firmware, arrived

    def _transmit_up(self, model: WireModel, active: list[Fault], passed: int, epoch: int) -> int:
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
        """Return what the hardware gets in the epoch after, given what the firmware sends in it."""
        self.desk.take(frames, count, epoch)
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
        """Put into the scratch array what the faults leave of a side's frames."""
        if acts:
            return self.faults.apply(sender, frames, count, epoch, self._scratch)
        self._scratch[:count] = frames[:count]
        return count

    def statistics(self) -> dict[str, Any] | None:
        """Return what the wire's model counted; None for an ideal wire.

        Returns
        -------
        dict
            `bitrate`, `load` and `worst_window_load` (shares of 1, the window 100 ms), `nodes` (by
            name: state, error counters, share of the load), `messages` (by name: frames sent, load,
            `worst_delay_us` from the request to the start of the frame, `worst_response_us` to its
            end).
        """
        if self._model is None:
            return None
        found = self._model.statistics()
        elapsed_ns = max(1, found["elapsed_ns"])
        names = {m.frame_id: m.name for m in load().database.messages}
        return {
            "bitrate": self._model.bitrate,
            "load": found["load"],
            "worst_window_load": found["worst_window_load"],
            "nodes": {
                name: {key: node[key] for key in ("state", "tec", "rec", "errors", "bus_offs")}
                | {"load": node["busy_ns"] / elapsed_ns}
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

    def _play(self, model: WireModel, active: list[Fault], start_ns: int) -> None:
        """Let the model play the faults that are its own."""
        cut = any(fault.kind == FaultKind.CUT for fault in active)
        if cut != self._is_cut:
            self._is_cut = cut
            model.cut(cut)
        for fault in active:
            if fault.kind == FaultKind.BABBLE:
                noise = np.concatenate(babble(max(1, fault.parameter)))
                model.submit(_BABBLER, noise, len(noise), start_ns)
            elif fault.kind in (FaultKind.CORRUPT_WIRE, FaultKind.BUS_OFF):
                self._fail(model, fault)

    @staticmethod
    def _fail(model: WireModel, fault: Fault) -> None:
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
