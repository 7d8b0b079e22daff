"""Diagnosis in a trace: ISO-TP messages (ISO 15765-2) put together from frames that others sent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.network_frame import single
from rrins.host_tools.diag.words import Words, request_words, response_words

Sender = Literal["tool", "tool to all", "computer"]

_FIRST, _CONSECUTIVE = 0x1, 0x2  # high nibble of the first byte; a flow control carries no data
_CAN_DL = 8


@dataclass(frozen=True)
class Message:
    """A message, or as much of it as came."""

    sender: Sender
    payload: bytes
    words: Words
    is_whole: bool = True

    @property
    def text(self) -> str:
        """The message in words."""
        return self.words.text

    @property
    def is_warning(self) -> bool:
        """Whether it is a refusal, or incomplete."""
        return self.words.is_refusal or not self.is_whole


@dataclass
class _Reception:
    """A message of several frames that is not complete yet."""

    length: int
    data: bytes
    number: int = 0  # of the last consecutive frame


class Trace:
    """Puts messages together from the frames of a bus, in their order."""

    def __init__(self) -> None:
        self._senders: dict[int, Sender] = {
            table.request_id(): "tool",
            table.functional_id(): "tool to all",
            table.response_id(): "computer",
        }
        self._open: dict[Sender, _Reception] = {}
        self._asked: dict[int, str] = {}

    @property
    def identifiers(self) -> tuple[int, ...]:
        """CAN identifiers of diagnostic frames."""
        return tuple(self._senders)

    def forget(self) -> None:
        """Forget what has begun: frames are missing."""
        self._open.clear()
        self._asked.clear()

    def add(self, can_id: int, data: bytes) -> list[Message]:
        """Take the next frame; return what it completes, or what it breaks off.

        Frames of other identifiers, and those that ISO-TP ignores, complete nothing.
        """
        sender = self._senders.get(can_id)
        if sender is None or not data:
            return []
        return list(self._messages(sender, data))

    def _messages(self, sender: Sender, data: bytes) -> Iterator[Message]:
        kind = data[0] >> 4
        payload = single(data)
        length = int.from_bytes(data[:2], "big") & 0x0FFF
        begins = kind == _FIRST and len(data) == _CAN_DL <= length
        if payload is not None or begins:
            yield from self._broken_off(sender)
        if payload is not None:
            yield self._complete(sender, payload)
        elif begins:
            self._open[sender] = _Reception(length, data[2:])
        elif kind == _CONSECUTIVE and sender in self._open:
            yield from self._continue(sender, data)

    def _continue(self, sender: Sender, data: bytes) -> Iterator[Message]:
        reception = self._open[sender]
        reception.number = (reception.number + 1) & 0x0F
        if data[0] & 0x0F != reception.number:
            yield from self._broken_off(sender)
            return
        reception.data = (reception.data + data[1:])[: reception.length]
        if len(reception.data) == reception.length:
            del self._open[sender]
            yield self._complete(sender, reception.data)

    def _broken_off(self, sender: Sender) -> Iterator[Message]:
        reception = self._open.pop(sender, None)
        if reception is not None:
            came = f"{len(reception.data)} of {reception.length} bytes"
            words = Words("incomplete", "incomplete", f"incomplete message: {came}")
            yield Message(sender, reception.data, words, is_whole=False)

    def _complete(self, sender: Sender, payload: bytes) -> Message:
        if sender == "computer":
            return Message(sender, payload, response_words(payload, self._asked))
        words = request_words(payload)
        self._asked[payload[0]] = words.name
        return Message(sender, payload, words)
