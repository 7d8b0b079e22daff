"""Live faults: the messages FAULT_COMMAND and FAULT_STATUS, for whoever is on the bus."""

from __future__ import annotations

from typing import Any

import can
import numpy as np

from dbc.codec import encode, load, pack
from dbc.contract import load_contract
from dbc.e2e import fill
from dbc.frame import frame_array
from host_tools.errors import RehearsalError
from host_tools.fault_tables import FaultOfAxis, FaultOfSensor, FaultOnWire
from host_tools.faults import FaultAction, FaultKind, Node
from host_tools.port import Address, message_of_frame, open_bus

_STATUS_WAIT_S = 3.0

Fault = FaultOnWire | FaultOfAxis | FaultOfSensor


class InjectionError(RehearsalError):
    """A fault that cannot be commanded live, or nobody who answers."""

    exit_status = 7


def fault_command(action: FaultAction, fault: Fault | None = None, counter: int = 0) -> can.Message:
    """Return the message that asks for a fault.

    Parameters
    ----------
    action : FaultAction
        INJECT and REMOVE need a fault; a removal looks at its kind, node and message only.
    fault : optional
        `at_s` means nothing here: a live fault begins at once.
    counter : int
        Of transmissions.

    Raises
    ------
    InjectionError
        For a fault that the message cannot say: a probability, or a time out of its range.
    """
    message = load_contract()[0]["fault_command"]
    word = pack(np.uint64(0), message["action"], int(action))
    if fault is not None and not isinstance(fault, FaultOnWire):
        raise InjectionError(f"{fault.kind}: can be in a scenario only")
    if fault is not None:
        word = _put_fault(word, message, fault)
    frames = frame_array(1)
    fill(frames[0], message["message"], word, counter)
    return message_of_frame(frames[0])


def _put_fault(word: Any, message: Any, fault: FaultOnWire) -> Any:
    if fault.probability != 1:
        raise InjectionError("a live fault hits every frame: a probability is for scenarios only")
    of_scenario = fault.fault(rate_hz=1000)  # an epoch of a millisecond: delays in ms
    duration_ms = 0 if fault.for_s is None else round(fault.for_s * 1000)
    if duration_ms > int(message["duration_ms"]["raw_maximum"]):
        raise InjectionError(f"{fault.for_s:g} s is longer than a live fault can be told to last")
    word = pack(word, message["kind"], int(of_scenario.kind))
    word = pack(word, message["node"], int(of_scenario.node))
    word = pack(word, message["identifier"], of_scenario.identifier)
    word = pack(word, message["duration_ms"], duration_ms)
    return encode(word, message["parameter"], of_scenario.parameter)


def send_command(address: Address, command: can.Message) -> None:
    """Send a command to the rehearsal that is under way on a bus.

    Raises
    ------
    BusError
        When there is no such bus.
    """
    wishes = {"host": "never", "name": "inject"} if address.is_embedded else {}
    with open_bus(address, **wishes) as bus:
        bus.send(command, timeout=5.0)


def active_faults(address: Address) -> dict[str, Any]:
    """Return what the next FAULT_STATUS on a bus says; no faults when none comes.

    Returns
    -------
    dict
        `kinds` (names), `active_faults`, `affected_frames`.
    """
    database = load().database
    status = database.get_message_by_name("FAULT_STATUS")
    wishes = {"host": "never", "name": "inject", "role": "observer"} if address.is_embedded else {}
    with open_bus(address, **wishes) as bus:
        bus.set_filters([{"can_id": status.frame_id, "can_mask": 0x7FF}])
        message = bus.recv(_STATUS_WAIT_S)
    if message is None:
        return {"kinds": [], "active_faults": 0, "affected_frames": 0}
    values = status.decode(bytes(message.data), decode_choices=False)
    assert isinstance(values, dict)
    mask = int(str(values["active_kinds"]))
    return {
        "kinds": [kind.name.lower() for kind in FaultKind if mask >> kind & 1],
        "active_faults": int(str(values["active_faults"])),
        "affected_frames": int(str(values["affected_frames"])),
    }


NODES = tuple(node.name.lower() for node in Node)
KINDS = tuple(kind.name.lower() for kind in FaultKind if kind is not FaultKind.NONE)
