"""Faults that a test puts into a bench."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from rrins.dbc.values import FaultAction, FaultRefusal
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.injection.messages import LiveFault, fault_commands, plain_command
from rrins.host_tools.scenario.fault_tables import FaultOnWire
from rrins.host_tools.scenario.scenario import fault_of
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.sending import FrameSender
from rrins.host_tools.testing.virtual_time import Execution

FaultKeys = Mapping[str, str | float | None]
"""Parameters of a fault in a scenario's `[[faults]]`, except its kind and `at_s`."""

_WIRE_COMMAND, _HARDWARE_COMMAND = "FAULT_COMMAND", "HARDWARE_FAULT_COMMAND"


def _checked(kind: str, keys: FaultKeys) -> LiveFault:
    if "at_s" in keys:
        raise ScenarioError("fault: at_s: a live fault begins at once")
    return fault_of({"kind": kind} | {key: v for key, v in keys.items() if v is not None})


class BenchFaults:
    """The faults of a bench: of its own wire and hardware, in real time by commands on the bus.

    Parameters
    ----------
    execution : Execution
    sender : FrameSender
    """

    def __init__(self, execution: Execution, sender: FrameSender) -> None:
        self._execution = execution
        self._sender = sender

    def inject(self, kind: str, keys: FaultKeys) -> None:
        """Put a fault in; see `Bench.inject`."""
        fault = _checked(kind, keys)
        wire, fault_server = self._execution.wire, self._execution.fault_server
        if wire is None or fault_server is None:
            self._command(FaultAction.INJECT, fault)
            return
        rate_hz = self._execution.scenario.rate_hz
        if isinstance(fault, FaultOnWire):
            planned = fault.fault(rate_hz)
            first = self._execution.epoch
            last = -1 if planned.last_epoch < 0 else first + planned.last_epoch
            refusal = wire.fault_server.inject(
                dataclasses.replace(planned, first_epoch=first, last_epoch=last)
            )
        else:
            _, last = fault.epochs(rate_hz)
            refusal = fault_server.inject(
                fault.hardware_kind, fault.target, fault.value, last + 1, fault.cycle(rate_hz)
            )
        if refusal != FaultRefusal.NONE:
            raise BenchError(f"{kind}: {refusal.name}")

    def remove(self, kind: str, keys: FaultKeys) -> None:
        """Take a fault out again; see `Bench.remove_fault`."""
        fault = _checked(kind, keys)
        wire, fault_server = self._execution.wire, self._execution.fault_server
        if wire is None or fault_server is None:
            self._command(FaultAction.REMOVE, fault)
            return
        if isinstance(fault, FaultOnWire):
            planned = fault.fault(self._execution.scenario.rate_hz)
            refusal = wire.fault_server.remove(
                planned.kind, planned.node, planned.identifier, self._execution.epoch
            )
        else:
            refusal = fault_server.remove(fault.hardware_kind, fault.target)
        if refusal != FaultRefusal.NONE:
            raise BenchError(f"{kind}: {refusal.name}")

    def clear(self) -> None:
        """Take out all faults."""
        wire, fault_server = self._execution.wire, self._execution.fault_server
        if wire is None or fault_server is None:
            for of_hardware in (False, True):
                counter = self._sender.next_counter(
                    _HARDWARE_COMMAND if of_hardware else _WIRE_COMMAND
                )
                self._sender.send_frame(plain_command(FaultAction.CLEAR, of_hardware, counter))
        else:
            wire.faults.clear()
            fault_server.clear()

    def _command(self, action: FaultAction, fault: LiveFault) -> None:
        name = _WIRE_COMMAND if isinstance(fault, FaultOnWire) else _HARDWARE_COMMAND
        counter = self._sender.next_counter(name)
        self._sender.send_commands(name, fault_commands(action, fault, counter))
