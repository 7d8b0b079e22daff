"""Sending in tests: messages of the contract, and any frames."""

from __future__ import annotations

from collections.abc import Mapping

import can

from rrins.dbc.e2e import COUNTER_MODULUS, counter_of
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.port import frame_of_message
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.recording import Contract, FrameRing, SignalValue
from rrins.host_tools.testing.virtual_time import Execution


class FrameSender:
    """Sends frames of a test, messages with counters of their own.

    Parameters
    ----------
    execution : Execution
    ring : FrameRing
        What was on the bus: counters of other senders are avoided.
    contract : Contract
    """

    def __init__(self, execution: Execution, ring: FrameRing, contract: Contract) -> None:
        self._execution = execution
        self._ring = ring
        self._contract = contract
        self._counters: dict[int, int] = {}

    def send(self, message: str, values: Mapping[str, SignalValue]) -> None:
        """Send a message of the contract, with the right counter and CRC.

        Raises
        ------
        BenchError
            For a message or signal that the DBC has not, or a value out of range.
        """
        self._contract.check_signals(message, list(values))
        if self._contract.counts_epochs(message):
            counter = self._execution.epoch % COUNTER_MODULUS
        else:
            counter = self.next_counter(message)
        self._execution.send(self._contract.encode(message, values, counter), 1)

    def send_frame(self, message: can.Message) -> None:
        """Send a classic frame, as it is."""
        if message.is_fd:
            raise BenchError("a bench carries classic frames only")
        frames = frame_array(1)
        frame_of_message(frames[0], message)
        self._execution.send(frames, 1)

    def send_commands(self, name: str, messages: list[can.Message]) -> None:
        """Send messages of one name that have their counters already."""
        for message in messages:
            self._counters[self._contract.can_id(name)] = message.data[1] & 0xF
            self.send_frame(message)

    def next_counter(self, message: str) -> int:
        """Count up the own counter of a message, not to one that another sender is about to use."""
        can_id = self._contract.can_id(message)
        self._execution.catch_up()
        counter = (self._counters.get(can_id, -1) + 1) % COUNTER_MODULUS
        others = self._ring.find(can_id)[0][-3:]
        near = {int(counter_of(frame["data"])) for frame in others}
        near |= {(seen + 1) % COUNTER_MODULUS for seen in near}
        near.discard(self._counters.get(can_id, -1))
        while counter in near:
            counter = (counter + 1) % COUNTER_MODULUS
        self._counters[can_id] = counter
        return counter
