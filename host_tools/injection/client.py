"""Asks a rehearsal under way for faults, and waits for the answer."""

from __future__ import annotations

import random
import time
from types import TracebackType
from typing import Self

import can

from dbc.e2e import COUNTER_MODULUS
from dbc.values import FaultAction, FaultRefusal
from host_tools.errors import BusError
from host_tools.fault_tables import FaultOnWire
from host_tools.injection.errors import InjectionError
from host_tools.injection.messages import Fault, fault_commands, plain_command
from host_tools.injection.report import (
    ActiveFault,
    Answer,
    FaultReader,
    FaultReport,
    Place,
    keys_of,
    words_of,
)
from host_tools.port import Address, open_bus

PATIENCE_S = 5.0
"""How long an answer is waited for, by the clock on the wall."""

_SEND_S = 5.0
_REFUSALS = {
    FaultRefusal.UNKNOWN: "the hardware on this bus does not know such a fault",
    FaultRefusal.NO_ROOM: "there is no room for another fault; take one out",
    FaultRefusal.NO_SUCH_TARGET: "the hardware on this bus has no such axis or sensor",
    FaultRefusal.OUT_OF_RANGE: "its value is out of range",
    FaultRefusal.NOT_ACTIVE: "is not active",
}


class FaultClient:
    """A place on the bus from which faults are put in and taken out.

    Parameters
    ----------
    address : Address
    patience_s : float
        How long to wait for an answer.

    Raises
    ------
    BusError
        When there is no such bus.
    """

    def __init__(self, address: Address, patience_s: float = PATIENCE_S) -> None:
        self._address = address
        self._patience_s = patience_s
        self._counter = random.randrange(COUNTER_MODULUS)
        self._reader = FaultReader()
        wishes = {"host": "never", "name": "inject", "role": "observer"}
        self._bus = open_bus(address, **(wishes if address.is_embedded else {}))
        self._bus.set_filters(
            [{"can_id": number, "can_mask": 0x7FF} for number in self._reader.identifiers]
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bus.shutdown()

    def inject(self, fault: Fault) -> tuple[ActiveFault, FaultReport]:
        """Put a fault in; return it as it has become active, and all that is active.

        Raises
        ------
        InjectionError
            When nobody answers, or the fault cannot be.
        """
        counter = self._next_counter(2)
        report = self._ask(fault, fault_commands(FaultAction.INJECT, fault, counter))
        wanted = keys_of(fault)
        found = [active for active in report.faults if wanted.items() <= active.keys.items()]
        if not found:
            raise InjectionError(f"{fault.kind}: obeyed, but not among what is active")
        return max(found, key=lambda active: active.first_epoch), report

    def remove(self, fault: Fault) -> FaultReport:
        """Take a fault out; return what is left.

        Raises
        ------
        InjectionError
            When nobody answers, or there is no such fault.
        """
        return self._ask(fault, fault_commands(FaultAction.REMOVE, fault, self._next_counter()))

    def clear(self) -> FaultReport:
        """Take out all faults; return what is left: nothing.

        Raises
        ------
        InjectionError
            When nobody answers.
        """
        return self._exchange(*self._plain(FaultAction.CLEAR))

    def report(self) -> FaultReport:
        """Return what is active.

        Raises
        ------
        InjectionError
            When nobody answers.
        """
        return self._exchange(*self._plain(FaultAction.REPORT))

    def _next_counter(self, messages: int = 1) -> int:
        counter = self._counter
        self._counter = (counter + messages) % COUNTER_MODULUS
        return counter

    def _plain(self, action: FaultAction) -> tuple[list[can.Message], list[can.Message]]:
        counter = self._next_counter()
        return [plain_command(action, False, counter)], [plain_command(action, True, counter)]

    def _ask(self, fault: Fault, commands: list[can.Message]) -> FaultReport:
        wire, hardware = self._plain(FaultAction.REPORT)
        if isinstance(fault, FaultOnWire):
            wire = commands
        else:
            hardware = commands
        try:
            return self._exchange(wire, hardware)
        except _RefusedError as error:
            words = words_of(keys_of(fault))
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
        """Return the answers to the commands with the counters wanted."""
        answers: dict[Place, Answer] = {}
        deadline = time.monotonic() + self._patience_s
        while len(answers) < len(wanted):
            left_s = deadline - time.monotonic()
            message = self._bus.recv(left_s) if left_s > 0 else None
            if message is None:
                raise InjectionError(
                    f"bus {self._address}: no emulated hardware has answered within "
                    f"{self._patience_s:g} s; is a rehearsal running on it?"
                )
            answer = self._reader.take(message)
            if answer is None or answer.counter != wanted[answer.place]:
                continue
            if answer.faults is None:
                raise InjectionError(
                    f"bus {self._address}: frames of the answer are lost; see `rrins inject list`"
                )
            answers[answer.place] = answer
        return answers


class _RefusedError(InjectionError):
    """A command was answered, but not obeyed."""
