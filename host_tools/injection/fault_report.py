"""Reports of active faults, read from the bus."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import can

from rrins.dbc.codec import load, to_physical
from rrins.dbc.contract import MessageSignals, load_contract
from rrins.dbc.decimals import from_decimal
from rrins.dbc.e2e import crc_holds
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultRefusal
from rrins.host_tools.bus.port import frame_of_message
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.fault_kinds import (
    TARGETS,
    HardwareFault,
    NumberedKind,
    Parameter,
)
from rrins.host_tools.hardware.fault_protocol import unpacked
from rrins.host_tools.injection.messages import LiveFault
from rrins.host_tools.wire.effects import ANY_IDENTIFIER, Node
from rrins.host_tools.wire.fault_kinds import FaultKind, from_number

Place = Literal["wire", "hardware"]
Raws = dict[str, int]
"""Raw values of a message's signals."""

FaultKeys = dict[str, str | int | float]
"""The keys of a fault in a scenario's `[[faults]]`."""

_NAMING = {"kind", "message", "node", *(target.key for target in TARGETS.values())}
_MILLISECONDS_HZ = 1000
_PREFIX: dict[Place, str] = {"wire": "", "hardware": "hardware_"}


@dataclass(frozen=True)
class ActiveFault:
    """An active fault."""

    place: Place
    keys: FaultKeys  #: its keys in a scenario's `[[faults]]`, without times
    first_epoch: int  #: epoch in which it began, modulo 2**24
    duration_ms: int  #: total duration; 0 if it lasts until removed

    @property
    def words(self) -> str:
        """The fault in words."""
        return fault_words(self.keys)


def fault_keys(fault: LiveFault) -> FaultKeys:
    """Return the keys that identify a fault: its kind and what fails."""
    keys = fault.model_dump(include=_NAMING)
    return {key: value for key, value in keys.items() if value not in (None, "any")}


def fault_words(keys: FaultKeys) -> str:
    """Return a fault's keys in words, its kind first."""
    rest = [
        f"{key} {value:.6g}" if isinstance(value, float) else f"{key} {value}"
        for key, value in keys.items()
        if key != "kind"
    ]
    return f"{keys['kind']} ({', '.join(rest)})" if rest else str(keys["kind"])


@dataclass(frozen=True)
class FaultReport:
    """A report of all active faults."""

    epoch: int  #: epoch of the report, modulo 2**24
    rate_hz: int  #: epochs per second
    faults: tuple[ActiveFault, ...]
    affected_frames: int  #: frames affected on the wire since power-on

    def seconds(self, epoch: int) -> float:
        """Return the simulated time of an epoch, s."""
        return epoch / self.rate_hz

    def as_dict(self) -> JsonObject:
        """Return the report as plain values."""
        return {
            "epoch": self.epoch,
            "time_s": self.seconds(self.epoch),
            "active_faults": len(self.faults),
            "kinds": sorted({fault.keys["kind"] for fault in self.faults}),
            "faults": [self.fault_as_dict(fault) for fault in self.faults],
            "affected_frames": self.affected_frames,
        }

    def fault_as_dict(self, fault: ActiveFault) -> JsonObject:
        """Return a fault with the keys of `[[faults]]`, its place, first epoch and duration."""
        return (
            {"of": fault.place}
            | fault.keys
            | {
                "since_epoch": fault.first_epoch,
                "at_s": self.seconds(fault.first_epoch),
                "for_s": fault.duration_ms / 1000 if fault.duration_ms else None,
            }
        )


@dataclass(frozen=True)
class Answer:
    """The end of a report: which command it answers, and the refusal, if any.

    `faults` is None if parts of the report are missing.
    """

    place: Place
    counter: int
    refusal: FaultRefusal
    faults: tuple[ActiveFault, ...] | None
    status: Raws


class FaultReader:
    """Assembles reports from the messages of a bus."""

    def __init__(self) -> None:
        contract = load_contract()[0]
        self._layouts: dict[int, tuple[Place, str, MessageSignals]] = {}
        for place, prefix in _PREFIX.items():
            for part in ("active", "times", "cycle", "status"):
                if f"{prefix}fault_{part}" not in (contract.dtype.names or ()):
                    continue
                layout = contract[f"{prefix}fault_{part}"]
                self._layouts[int(layout["message"]["can_id"])] = (place, part, layout)
        self._parts: dict[Place, dict[str, dict[int, Raws]]] = {
            place: {"active": {}, "times": {}, "cycle": {}} for place in _PREFIX
        }
        self._probability = contract["fault_active"]["probability"]
        self._frame = frame_array(1)

    @property
    def identifiers(self) -> list[int]:
        """Identifiers of the messages that reports consist of."""
        return list(self._layouts)

    def feed(self, message: can.Message) -> Answer | None:
        """Process a message; return an answer if the message completes a report."""
        known = self._layouts.get(message.arbitration_id)
        if known is None or message.is_extended_id or message.is_remote_frame:
            return None
        place, part, layout = known
        frame_of_message(self._frame[0], message)
        if not crc_holds(self._frame[0], layout.message):
            return None
        raws = unpacked(layout, self._frame[0]["data"])
        if part == "status":
            return self._answer(place, raws)
        if raws["number"] == 0 and part == "active":
            for parts in self._parts[place].values():
                parts.clear()
        self._parts[place][part][raws["number"]] = raws
        return None

    def _answer(self, place: Place, status: Raws) -> Answer:
        active, times, cycles = self._parts[place].values()
        numbers = range(status["active_faults"])
        faults = None
        if all(
            k in active and k in times and (k in cycles or not active[k].get("intermittent"))
            for k in numbers
        ):
            faults = tuple(self._fault(place, active[k], times[k], cycles.get(k)) for k in numbers)
        try:
            refusal = FaultRefusal(status["refusal"])
        except ValueError:
            refusal = FaultRefusal.UNKNOWN
        return Answer(place, status["answers"], refusal, faults, status)

    def _fault(self, place: Place, active: Raws, times: Raws, cycle: Raws | None) -> ActiveFault:
        keys = self._wire_keys(active) if place == "wire" else _hardware_keys(active)
        if cycle is not None:
            keys["period_s"] = cycle["period_ms"] / 1000
            keys["duty"] = round(cycle["on_ms"] / cycle["period_ms"], 6)
        return ActiveFault(place, keys, times["first_epoch"], times["duration_ms"])

    def _wire_keys(self, active: Raws) -> FaultKeys:
        keys: FaultKeys = {"kind": _name(FaultKind, active["kind"])}
        if active["identifier"] != ANY_IDENTIFIER:
            keys["message"] = _message_name(active["identifier"])
        if active["node"] != Node.ANY:
            keys["node"] = _name(Node, active["node"])
        parameter = _parameter_of(FaultKind, active["kind"])
        value = from_number(parameter, active["parameter"], _MILLISECONDS_HZ)
        if parameter is not None and value is not None:
            keys[parameter.key] = value
        probability = float(to_physical(active["probability"], self._probability))
        if probability < 1:
            keys["probability"] = round(probability, 6)
        return keys


def _hardware_keys(active: Raws) -> FaultKeys:
    kind, target = active["kind"], active["target"]
    keys: FaultKeys = {"kind": _name(HardwareFault, kind)}
    key = HardwareFault(kind).target if kind in set(HardwareFault) else None
    if key is not None and key.names:
        keys[key.key] = dict(enumerate(key.names, 1)).get(target, str(target))
    elif key is not None and target:
        keys[key.key] = target
    parameter = _parameter_of(HardwareFault, kind)
    if parameter is not None:
        keys[parameter.key] = from_decimal(active["value"], active["exponent"])
    return keys


def _parameter_of(kinds: type[NumberedKind], number: int) -> Parameter | None:
    return kinds(number).parameter if number in set(kinds) else None


def _name(table: type[IntEnum], raw: int) -> str:
    try:
        return str(table(raw).name.lower())
    except ValueError:
        return str(raw)


def _message_name(identifier: int) -> str:
    for message in load().database.messages:
        if message.frame_id == identifier:
            return str(message.name)
    return f"0x{identifier:03X}"
