"""Reports of active faults, read from the bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import can
import numpy as np

from dbc.codec import load, to_physical, unpack
from dbc.contract import load_contract
from dbc.decimals import from_decimal
from dbc.e2e import crc_holds
from dbc.frame import frame_array
from dbc.values import FaultRefusal
from host_tools.faults import ANY_IDENTIFIER, FaultKind, Node
from host_tools.hardware.fault_values import VALUES
from host_tools.hardware.faults import HardwareFault
from host_tools.injection.messages import Fault
from host_tools.port import frame_of_message

Place = Literal["wire", "hardware"]
Raws = dict[str, int]

_PREFIX: dict[Place, str] = {"wire": "", "hardware": "hardware_"}


@dataclass(frozen=True)
class ActiveFault:
    """A fault that is active.

    Attributes
    ----------
    place : {"wire", "hardware"}
    keys : dict
        What a scenario's `[[faults]]` would say of it, without its times.
    first_epoch : int
        Since when, modulo 2**24.
    duration_ms : int
        How long in all; 0 until it is taken out.
    """

    place: Place
    keys: dict[str, Any]
    first_epoch: int
    duration_ms: int

    @property
    def words(self) -> str:
        """What it is, in words."""
        return words_of(self.keys)


def keys_of(fault: Fault) -> dict[str, Any]:
    """Return those of a fault's keys that say which one it is: its kind and what fails."""
    keys = fault.model_dump(include={"kind", "message", "node", "axis", "sensor"})
    return {key: value for key, value in keys.items() if value not in (None, "any")}


def words_of(keys: dict[str, Any]) -> str:
    """Return a fault's keys in words, its kind first."""
    rest = [
        f"{key} {value:.6g}" if isinstance(value, float) else f"{key} {value}"
        for key, value in keys.items()
        if key != "kind"
    ]
    return f"{keys['kind']} ({', '.join(rest)})" if rest else str(keys["kind"])


@dataclass(frozen=True)
class FaultReport:
    """What is active.

    Attributes
    ----------
    epoch : int
        Modulo 2**24.
    rate_hz : int
    faults : tuple of ActiveFault
    affected_frames : int
        On the wire, since power-on.
    """

    epoch: int
    rate_hz: int
    faults: tuple[ActiveFault, ...]
    affected_frames: int

    def seconds(self, epoch: int) -> float:
        """Return the simulated time of an epoch, s."""
        return epoch / self.rate_hz

    def as_dict(self) -> dict[str, Any]:
        """Return the report in plain values."""
        return {
            "epoch": self.epoch,
            "time_s": self.seconds(self.epoch),
            "active_faults": len(self.faults),
            "kinds": sorted({fault.keys["kind"] for fault in self.faults}),
            "faults": [self.fault_as_dict(fault) for fault in self.faults],
            "affected_frames": self.affected_frames,
        }

    def fault_as_dict(self, fault: ActiveFault) -> dict[str, Any]:
        """Return a fault as a table `[[faults]]` has it, and where and since which epoch it is."""
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
    """A report's end: whose command it answers, and why that was refused if it was.

    `faults` is None when not all of the report has come.
    """

    place: Place
    counter: int
    refusal: FaultRefusal
    faults: tuple[ActiveFault, ...] | None
    status: Raws


class FaultReader:
    """Puts reports together from the messages of a bus."""

    def __init__(self) -> None:
        contract = load_contract()[0]
        self._kinds: dict[int, tuple[Place, str, Any]] = {}
        for place, prefix in _PREFIX.items():
            for part in ("active", "times", "status"):
                layout = contract[f"{prefix}fault_{part}"]
                self._kinds[int(layout["message"]["can_id"])] = (place, part, layout)
        self._parts: dict[Place, dict[str, dict[int, Raws]]] = {
            place: {"active": {}, "times": {}} for place in _PREFIX
        }
        self._probability = contract["fault_active"]["probability"]
        self._frame = frame_array(1)

    @property
    def identifiers(self) -> list[int]:
        """Identifiers of the messages that are of interest."""
        return list(self._kinds)

    def take(self, message: can.Message) -> Answer | None:
        """Take a message; return what it ends, if it ends a report."""
        known = self._kinds.get(message.arbitration_id)
        if known is None or message.is_extended_id or message.is_remote_frame:
            return None
        place, part, layout = known
        frame_of_message(self._frame[0], message)
        if not crc_holds(self._frame[0], layout["message"]):
            return None
        word = np.uint64(self._frame[0]["data"])
        raws = {
            name: int(unpack(word, layout[name]))
            for name in layout.dtype.names
            if name != "message"
        }
        if part == "status":
            return self._answer(place, raws)
        if raws["number"] == 0 and part == "active":
            for parts in self._parts[place].values():
                parts.clear()
        self._parts[place][part][raws["number"]] = raws
        return None

    def _answer(self, place: Place, status: Raws) -> Answer:
        active, times = self._parts[place]["active"], self._parts[place]["times"]
        numbers = range(status["active_faults"])
        faults = None
        if all(k in active and k in times for k in numbers):
            faults = tuple(self._fault(place, active[k], times[k]) for k in numbers)
        try:
            refusal = FaultRefusal(status["refusal"])
        except ValueError:
            refusal = FaultRefusal.UNKNOWN
        return Answer(place, status["answers"], refusal, faults, status)

    def _fault(self, place: Place, active: Raws, times: Raws) -> ActiveFault:
        keys = self._keys_on_wire(active) if place == "wire" else _keys_of_hardware(active)
        return ActiveFault(place, keys, times["first_epoch"], times["duration_ms"])

    def _keys_on_wire(self, active: Raws) -> dict[str, Any]:
        keys: dict[str, Any] = {"kind": _name(FaultKind, active["kind"])}
        if active["identifier"] != ANY_IDENTIFIER:
            keys["message"] = _message_name(active["identifier"])
        if active["node"] != Node.ANY:
            keys["node"] = _name(Node, active["node"])
        parameter = active["parameter"]
        if active["kind"] == FaultKind.DELAY:
            keys["delay_s"] = parameter / 1000
        elif active["kind"] == FaultKind.BABBLE:
            keys["frames_per_epoch"] = parameter
        elif active["kind"] == FaultKind.CORRUPT and parameter:
            keys["bit"] = parameter - 1
        probability = float(to_physical(active["probability"], self._probability))
        if probability < 1:
            keys["probability"] = round(probability, 6)
        return keys


def _keys_of_hardware(active: Raws) -> dict[str, Any]:
    keys: dict[str, Any] = {"kind": _name(HardwareFault, active["kind"])}
    target = active["target"]
    if active["kind"] < HardwareFault.GYRO_STUCK:
        keys["axis"] = {1: "inner", 2: "outer"}.get(target, str(target))
    elif target:
        keys["sensor"] = target
    value = VALUES.get(active["kind"])  # type: ignore[call-overload]
    if value is not None:
        keys[value.key] = from_decimal(active["value"], active["exponent"])
    return keys


def _name(table: Any, raw: int) -> str:
    try:
        return str(table(raw).name.lower())
    except ValueError:
        return str(raw)


def _message_name(identifier: int) -> str:
    for message in load().database.messages:
        if message.frame_id == identifier:
            return str(message.name)
    return f"0x{identifier:03X}"
