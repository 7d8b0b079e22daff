"""Faults as command messages: FAULT_COMMAND and HARDWARE_FAULT_COMMAND."""

from __future__ import annotations

import can

from rrins.dbc.contract import MessageSignals, load_contract
from rrins.dbc.decimals import to_decimal
from rrins.dbc.e2e import COUNTER_MODULUS, fill
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultAction
from rrins.host_tools.bus.port import message_of_frame
from rrins.host_tools.hardware.fault_protocol import largest_of, packed
from rrins.host_tools.injection.errors import InjectionError
from rrins.host_tools.scenario.fault_tables import FaultOfHardware, FaultOnWire
from rrins.host_tools.wire.fault_server import SHARE_STEPS

LiveFault = FaultOnWire | FaultOfHardware

_Raws = dict[str, int]
"""Raw values of a command's signals."""

_MILLISECONDS_HZ = 1000
"""Rate at which an epoch lasts one millisecond, which gives delays in ms."""


def _layout(of_hardware: bool) -> MessageSignals:
    return load_contract()[0]["hardware_fault_command" if of_hardware else "fault_command"]


def plain_command(action: FaultAction, of_hardware: bool, counter: int = 0) -> can.Message:
    """Return a command that names no fault: CLEAR or REPORT."""
    return _messages(_layout(of_hardware), counter, {"action": action})[0]


def fault_commands(action: FaultAction, fault: LiveFault, counter: int = 0) -> list[can.Message]:
    """Return the messages that inject or remove a fault; the last one is the command.

    Parameters
    ----------
    action : FaultAction
        INJECT, or REMOVE, which uses only the kind and the target, not values and times.
    fault : FaultOnWire or FaultOfHardware
        `at_s` is ignored: a live fault begins at once.
    counter : int
        Alive counter of the first message.

    Raises
    ------
    InjectionError
        If a probability, delay, period or duration is out of the range of the messages.
    """
    layout = _layout(isinstance(fault, FaultOfHardware))
    part: _Raws
    if isinstance(fault, FaultOfHardware):
        part = {"kind": fault.hardware_kind, "target": fault.target + 1}
    else:
        meant = fault.fault(_MILLISECONDS_HZ)
        part = {"kind": meant.kind, "node": meant.node, "identifier": meant.identifier}
    if action != FaultAction.INJECT:
        return _messages(layout, counter, {"action": action} | part)
    if isinstance(fault, FaultOfHardware):
        *before, command = _of_hardware(fault, layout)
    else:
        *before, command = _on_wire(fault, layout)
    if fault.for_s is not None:
        command["duration_ms"] = _milliseconds("for", fault.for_s, layout)
    return _messages(layout, counter, *(part | raws for raws in (*before, command)))


def _of_hardware(fault: FaultOfHardware, layout: MessageSignals) -> list[_Raws]:
    """Return the command of a failure, after that of its cycle."""

    def number(value: float) -> _Raws:
        digits, exponent = to_decimal(value, layout["value"], layout["exponent"])
        return {"value": digits, "exponent": exponent}

    command = {"action": int(FaultAction.INJECT)} | number(fault.value)
    if fault.period_s is None:
        return [command]
    period_ms = _milliseconds("a period of", fault.period_s, layout)
    cycle = {"action": int(FaultAction.CYCLE), "duration_ms": period_ms}
    return [cycle | number(fault.duty), command]


def _on_wire(fault: FaultOnWire, layout: MessageSignals) -> list[_Raws]:
    """Return the command of a fault, after that of its probability."""
    parameter, longest = fault.fault(_MILLISECONDS_HZ).parameter, largest_of(layout, "parameter")
    if parameter > longest:
        raise InjectionError(
            f"{fault.kind} of {parameter / 1000:g} s: the maximum of a live fault is "
            f"{longest / 1000:g} s"
        )
    command = {"action": int(FaultAction.INJECT), "parameter": parameter}
    if fault.probability == 1:
        return [command]
    share = round(fault.probability * SHARE_STEPS)
    if share == 0:
        raise InjectionError(
            f"probability {fault.probability:g}: the minimum of a live fault is 1/{SHARE_STEPS}"
        )
    return [{"action": int(FaultAction.SHARE), "parameter": share}, command]


def _milliseconds(what: str, seconds: float, layout: MessageSignals) -> int:
    milliseconds = max(1, round(seconds * 1000))
    longest = largest_of(layout, "duration_ms")
    if milliseconds > longest:
        limit = f"at most {longest / 1000:g} s"
        raise InjectionError(
            f"{what} {seconds:g} s: a live fault lasts {limit}, or until it is removed"
            if what == "for"
            else f"{what} {seconds:g} s: {limit} for a live fault"
        )
    return milliseconds


def _messages(layout: MessageSignals, counter: int, *commands: _Raws) -> list[can.Message]:
    frames = frame_array(len(commands))
    for k, raws in enumerate(commands):
        fill(frames[k], layout.message, packed(layout, **raws), (counter + k) % COUNTER_MODULUS)
    return [message_of_frame(frame) for frame in frames]
