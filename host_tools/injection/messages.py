"""Faults as the commands that put them in: FAULT_COMMAND and HARDWARE_FAULT_COMMAND."""

from __future__ import annotations

from typing import Any

import can
import numpy as np

from dbc.codec import pack
from dbc.contract import load_contract
from dbc.decimals import to_decimal
from dbc.e2e import COUNTER_MODULUS, fill
from dbc.frame import frame_array
from dbc.values import FaultAction
from host_tools.fault_desk import SHARE_STEPS
from host_tools.fault_tables import FaultOfAxis, FaultOfSensor, FaultOnWire
from host_tools.injection.errors import InjectionError
from host_tools.port import message_of_frame

Fault = FaultOnWire | FaultOfAxis | FaultOfSensor

_MILLISECONDS_HZ = 1000
"""The rate at which an epoch is a millisecond: delays in ms."""


def plain_command(action: FaultAction, of_hardware: bool, counter: int = 0) -> can.Message:
    """Return the command that names no fault: CLEAR or REPORT."""
    name = "hardware_fault_command" if of_hardware else "fault_command"
    return _message(name, counter, action=int(action))


def fault_commands(action: FaultAction, fault: Fault, counter: int = 0) -> list[can.Message]:
    """Return the messages that put a fault in or take it out; the last one is the command.

    Parameters
    ----------
    action : FaultAction
        INJECT, or REMOVE, which looks at what fails and how only, not at values and times.
    fault : FaultOnWire, FaultOfAxis or FaultOfSensor
        `at_s` means nothing here: a live fault begins at once.
    counter : int
        Of transmissions, that of the first message.

    Raises
    ------
    InjectionError
        For what the messages cannot say: a share, a delay or a time out of their range.
    """
    is_put_in = action == FaultAction.INJECT
    if isinstance(fault, FaultOnWire):
        return _on_wire(action, fault, counter, is_put_in)
    target = fault.target + 1
    raws = {"action": int(action), "kind": int(fault.hardware_kind), "target": target}
    if is_put_in:
        layout = load_contract()[0]["hardware_fault_command"]
        raws["value"], raws["exponent"] = to_decimal(
            fault.value, layout["value"], layout["exponent"]
        )
        raws["duration_ms"] = _duration_ms(fault, layout)
    return [_message("hardware_fault_command", counter, **raws)]


def _on_wire(
    action: FaultAction, fault: FaultOnWire, counter: int, is_put_in: bool
) -> list[can.Message]:
    layout = load_contract()[0]["fault_command"]
    said = fault.fault(_MILLISECONDS_HZ)
    frames = {"kind": int(said.kind), "node": int(said.node), "identifier": said.identifier}
    if not is_put_in:
        return [_message("fault_command", counter, action=int(action), **frames)]
    messages = []
    if fault.probability != 1:
        share = round(fault.probability * SHARE_STEPS)
        if share == 0:
            raise InjectionError(
                f"probability {fault.probability:g}: a live fault hits 1 of {SHARE_STEPS} at least"
            )
        messages.append(
            _message(
                "fault_command", counter, action=int(FaultAction.SHARE), parameter=share, **frames
            )
        )
    longest = int(layout["parameter"]["raw_maximum"])
    if said.parameter > longest:
        raise InjectionError(
            f"delay of {fault.delay_s:g} s: a live one is {longest / 1000:g} s at most"
        )
    messages.append(
        _message(
            "fault_command",
            counter + len(messages),
            action=int(action),
            parameter=said.parameter,
            duration_ms=_duration_ms(fault, layout),
            **frames,
        )
    )
    return messages


def _duration_ms(fault: Fault, layout: Any) -> int:
    if fault.for_s is None:
        return 0
    duration_ms = max(1, round(fault.for_s * 1000))
    longest = int(layout["duration_ms"]["raw_maximum"])
    if duration_ms > longest:
        raise InjectionError(
            f"for {fault.for_s:g} s: a live fault lasts {longest / 1000:g} s at most, or until it "
            "is taken out"
        )
    return duration_ms


def _message(name: str, counter: int, **raws: int) -> can.Message:
    layout = load_contract()[0][name]
    word = np.uint64(0)
    for signal, raw in raws.items():
        word = np.uint64(pack(word, layout[signal], np.int64(raw)))
    frames = frame_array(1)
    fill(frames[0], layout["message"], word, counter % COUNTER_MODULUS)
    return message_of_frame(frames[0])
