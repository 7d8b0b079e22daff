"""Client that injects faults into a running rehearsal and waits for the answer."""

from __future__ import annotations

import random
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Unpack

import can

from rrins.dbc.e2e import COUNTER_MODULUS
from rrins.dbc.values import FaultAction, FaultRefusal
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import BusError
from rrins.host_tools.injection.errors import InjectionError
from rrins.host_tools.injection.fault_report import (
    ActiveFault,
    Answer,
    FaultReader,
    FaultReport,
    Place,
    fault_keys,
    fault_words,
)
from rrins.host_tools.injection.messages import LiveFault, fault_commands, plain_command
from rrins.host_tools.scenario.fault_tables import FaultOfHardware, FaultOnWire
from rrins.host_tools.scenario.scenario import fault_of

if TYPE_CHECKING:
    from rrins.host_tools.scenario.typed_keys import FaultKeys, FaultKind

PATIENCE_S = 5.0
"""Longest wait for an answer, in wall clock time."""

_SEND_S = 5.0
_REFUSALS = {
    FaultRefusal.UNKNOWN: "the hardware on this bus does not know this fault",
    FaultRefusal.NO_ROOM: "no room for another fault; remove one first",
    FaultRefusal.NO_SUCH_TARGET: "the hardware on this bus has no such axis or sensor",
    FaultRefusal.OUT_OF_RANGE: "its value is out of range",
    FaultRefusal.NOT_ACTIVE: "is not active",
}


class FaultClient(Closing):
    """A client on the bus that injects and removes faults.

    Parameters
    ----------
    address : Address
    patience_s : float
        Longest wait for an answer.

    Raises
    ------
    BusError
        If there is no such bus.
    """

    def __init__(self, address: Address, patience_s: float = PATIENCE_S) -> None:
        self._address = address
        self._patience_s = patience_s
        self._counter = random.randrange(COUNTER_MODULUS)
        self._reader = FaultReader()
        options = {"host": "never", "name": "inject", "role": "observer"}
        self._bus = open_bus(address, **(options if address.is_embedded else {}))
        self._bus.set_filters(
            [{"can_id": number, "can_mask": 0x7FF} for number in self._reader.identifiers]
        )

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def inject(
        self, fault: FaultKind | Mapping[str, object] | LiveFault, **keys: Unpack[FaultKeys]
    ) -> tuple[ActiveFault, FaultReport]:
        """Inject a fault; return it as it became active, and a report of all active faults.

        Parameters
        ----------
        fault : str, mapping or LiveFault
            Its kind, such as ``"gyro_bias"``, or the keys of a scenario's `[[faults]]`.
        **keys
            Keys of its kind: ``sensor=3``, ``bias_dph=20``, ``for_s=60``.

        Raises
        ------
        ScenarioError
            If a key is wrong.
        InjectionError
            If nobody answers, or the fault is refused.
        """
        fault = _fault(fault, keys)
        counter = self._next_counter(2)
        report = self._ask(fault, fault_commands(FaultAction.INJECT, fault, counter))
        wanted = fault_keys(fault)
        found = [active for active in report.faults if wanted.items() <= active.keys.items()]
        if not found:
            raise InjectionError(f"{fault.kind}: accepted, but not among the active faults")
        return max(found, key=lambda active: active.first_epoch), report

    def remove(
        self, fault: FaultKind | Mapping[str, object] | LiveFault, **keys: Unpack[FaultKeys]
    ) -> FaultReport:
        """Remove a fault; return a report of the remaining ones.

        Parameters
        ----------
        fault, **keys
            As of `inject`; the kind and where it acts decide.

        Raises
        ------
        ScenarioError
            If a key is wrong.
        InjectionError
            If nobody answers, or there is no such fault.
        """
        fault = _fault(fault, keys)
        return self._ask(fault, fault_commands(FaultAction.REMOVE, fault, self._next_counter()))

    def clear(self) -> FaultReport:
        """Remove all faults; return the now empty report.

        Raises
        ------
        InjectionError
            If nobody answers.
        """
        return self._exchange(*self._plain(FaultAction.CLEAR))

    def report(self) -> FaultReport:
        """Return a report of the active faults.

        Raises
        ------
        InjectionError
            If nobody answers.
        """
        return self._exchange(*self._plain(FaultAction.REPORT))

    def _next_counter(self, messages: int = 1) -> int:
        counter = self._counter
        self._counter = (counter + messages) % COUNTER_MODULUS
        return counter

    def _plain(self, action: FaultAction) -> tuple[list[can.Message], list[can.Message]]:
        counter = self._next_counter()
        return [plain_command(action, False, counter)], [plain_command(action, True, counter)]

    def _ask(self, fault: LiveFault, commands: list[can.Message]) -> FaultReport:
        wire, hardware = self._plain(FaultAction.REPORT)
        if isinstance(fault, FaultOnWire):
            wire = commands
        else:
            hardware = commands
        try:
            return self._exchange(wire, hardware)
        except _RefusedError as error:
            words = fault_words(fault_keys(fault))
            raise InjectionError(f"{words}: {error}; see `rrins inject list`") from error

    def _exchange(self, wire: list[can.Message], hardware: list[can.Message]) -> FaultReport:
        wanted: dict[Place, int] = {
            "wire": wire[-1].data[1] & 0xF,
            "hardware": hardware[-1].data[1] & 0xF,
        }
        try:
            for message in (*wire, *hardware):
                self._bus.send(message, timeout=_SEND_S)
            answers = self._await(wanted)
        except can.CanError as error:
            raise BusError(f"bus {self._address}: {error}") from error
        for answer in answers.values():
            if answer.refusal != FaultRefusal.NONE:
                raise _RefusedError(_REFUSALS[answer.refusal])
        status = answers["hardware"].status
        return FaultReport(
            epoch=status["epoch"],
            rate_hz=status["rate"],
            faults=(*(answers["hardware"].faults or ()), *(answers["wire"].faults or ())),
            affected_frames=answers["wire"].status["affected_frames"],
        )

    def _await(self, wanted: dict[Place, int]) -> dict[Place, Answer]:
        """Return the answers to the commands with these counters."""
        answers: dict[Place, Answer] = {}
        deadline = time.monotonic() + self._patience_s
        while len(answers) < len(wanted):
            left_s = deadline - time.monotonic()
            message = self._bus.recv(left_s) if left_s > 0 else None
            if message is None:
                raise InjectionError(
                    f"bus {self._address}: no emulated hardware answered within "
                    f"{self._patience_s:g} s; is a rehearsal running on it?"
                )
            answer = self._reader.feed(message)
            if answer is None or answer.counter != wanted[answer.place]:
                continue
            if answer.faults is None:
                raise InjectionError(
                    f"bus {self._address}: frames of the answer were lost; see `rrins inject list`"
                )
            answers[answer.place] = answer
        return answers


def _fault(
    fault: FaultKind | Mapping[str, object] | LiveFault, keys: Mapping[str, object]
) -> LiveFault:
    """Return the fault that is meant; it begins at once."""
    if isinstance(fault, FaultOnWire | FaultOfHardware):
        values = fault.model_dump(exclude_unset=True)
    else:
        values = {"kind": fault} if isinstance(fault, str) else dict(fault)
    if values.get("at_s"):
        raise InjectionError(f"at_s: {values['at_s']}, but a live fault begins at once")
    return fault_of({**values, **keys})


class _RefusedError(InjectionError):
    """A command was answered, but refused."""
