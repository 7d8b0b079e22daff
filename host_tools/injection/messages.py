"""Faults as command messages: FAULT_COMMAND and HARDWARE_FAULT_COMMAND."""

from __future__ import annotations

import can

from rrins.dbc.contract import MessageSignals, load_contract
from rrins.dbc.decimals import to_decimal
from rrins.dbc.e2e import COUNTER_MODULUS, fill
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultAction
from rrins.host_tools.bus.port import message_of_frame
from rrins.host_tools.hardware.fault_protocol import packed
from rrins.host_tools.injection.errors import InjectionError
from rrins.host_tools.scenario.fault_tables import FaultOfHardware, FaultOnWire
from rrins.host_tools.wire.fault_server import SHARE_STEPS

LiveFault = FaultOnWire | FaultOfHardware

_MILLISECONDS_HZ = 1000
"""Rate at which an epoch lasts one millisecond, which gives delays in ms."""


def plain_command(action: FaultAction, of_hardware: bool, counter: int = 0) -> can.Message:
    """Return a command that names no fault: CLEAR or REPORT."""
    name = "hardware_fault_command" if of_hardware else "fault_command"
    return _message(name, counter, action=int(action))


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
    is_put_in = action == FaultAction.INJECT
    if isinstance(fault, FaultOnWire):
        return _on_wire(action, fault, counter, is_put_in)
    target = fault.target + 1
    part = {"kind": int(fault.hardware_kind), "target": target}
    name = "hardware_fault_command"
    if not is_put_in:
        return [_message(name, counter, action=int(action), **part)]
    layout = load_contract()[0][name]
    messages = []
    if fault.period_s is not None:
        digits, exponent = to_decimal(fault.duty, layout["value"], layout["exponent"])
        messages.append(
            _message(
                name,
                counter,
                action=int(FaultAction.CYCLE),
                value=digits,
                exponent=exponent,
                duration_ms=_milliseconds("a period of", fault.period_s, layout),
                **part,
            )
        )
    digits, exponent = to_decimal(fault.value, layout["value"], layout["exponent"])
    messages.append(
        _message(
            name,
            counter + len(messages),
            action=int(action),
            value=digits,
            exponent=exponent,
            duration_ms=_duration_ms(fault, layout),
            **part,
        )
    )
    return messages


def _on_wire(
    action: FaultAction, fault: FaultOnWire, counter: int, is_put_in: bool
) -> list[can.Message]:
    layout = load_contract()[0]["fault_command"]
    wire_fault = fault.fault(_MILLISECONDS_HZ)
    frames = {
        "kind": int(wire_fault.kind),
        "node": int(wire_fault.node),
        "identifier": wire_fault.identifier,
    }
    if not is_put_in:
        return [_message("fault_command", counter, action=int(action), **frames)]
    messages = []
    if fault.probability != 1:
        share = round(fault.probability * SHARE_STEPS)
        if share == 0:
            raise InjectionError(
                f"probability {fault.probability:g}: the minimum of a live fault is 1/{SHARE_STEPS}"
            )
        messages.append(
            _message(
                "fault_command", counter, action=int(FaultAction.SHARE), parameter=share, **frames
            )
        )
    longest = int(layout["parameter"]["raw_maximum"])
    if wire_fault.parameter > longest:
        raise InjectionError(
            f"delay of {fault.delay_s:g} s: the maximum of a live fault is {longest / 1000:g} s"
        )
    messages.append(
        _message(
            "fault_command",
            counter + len(messages),
            action=int(action),
            parameter=wire_fault.parameter,
            duration_ms=_duration_ms(fault, layout),
            **frames,
        )
    )
    return messages


def _duration_ms(fault: LiveFault, layout: MessageSignals) -> int:
    if fault.for_s is None:
        return 0
    return _milliseconds("for", fault.for_s, layout)


def _milliseconds(what: str, seconds: float, layout: MessageSignals) -> int:
    milliseconds = max(1, round(seconds * 1000))
    longest = int(layout["duration_ms"]["raw_maximum"])
    if milliseconds > longest:
        raise InjectionError(
            f"{what} {seconds:g} s: a live fault lasts at most {longest / 1000:g} s, or until it "
            "is removed"
            if what == "for"
            else f"{what} {seconds:g} s: at most {longest / 1000:g} s for a live fault"
        )
    return milliseconds


def _message(name: str, counter: int, **raws: int) -> can.Message:
    layout = load_contract()[0][name]
    frames = frame_array(1)
    fill(frames[0], layout.message, packed(layout, **raws), counter % COUNTER_MODULUS)
    return message_of_frame(frames[0])
