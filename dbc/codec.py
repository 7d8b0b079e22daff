"""Packing and unpacking of signals, by tables read from the DBC at program start.

A message's payload is one 64-bit word (see `rrins.dbc.frame`). A signal is a row of the table
`Codec.signals`: shift, length, sign, byte order, scale, offset. The compiled functions here take
such a row, so no code contains a bit position; steps keep the *index* of the signals they need,
looked up by name once at start.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rrins.compiled.code_folder import code_folder, name_of_code
from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import F8, I8, U1, Record, Whole
from rrins.dbc.e2e import MessageLayout
from rrins.dbc.facts import SOURCE, ContractError, Facts, read_dbc

if TYPE_CHECKING:
    from cantools.database.can import Database


class SignalLayout(Record):
    """A signal: position, length and scaling of its bits in the payload."""

    scale: F8
    offset: F8
    raw_minimum: I8
    raw_maximum: I8
    shift: U1  #: of the least significant bit, in the word as its byte order reads it
    length: U1
    signed: U1
    big_endian: U1


@compiled_with(inline="always")
def _swapped(word: np.uint64) -> np.uint64:
    swapped = np.uint64(0)
    for k in range(8):
        byte = (word >> np.uint64(8 * k)) & np.uint64(0xFF)
        swapped |= byte << np.uint64(56 - 8 * k)
    return swapped


@compiled
def unpack(word: np.uint64, signal: SignalLayout) -> int:
    """Return the raw integer (int64) of a signal in a payload word."""
    bits = _swapped(np.uint64(word)) if signal.big_endian else np.uint64(word)
    return _field(bits >> np.uint64(signal.shift), signal)


@compiled_with(inline="always")
def _field(bits: np.uint64, signal: SignalLayout) -> int:
    """Return the number in the lowest bits, as many as the signal has."""
    spare = np.uint64(64 - signal.length)
    left = bits << spare
    if signal.signed:
        return int(np.int64(left) >> np.int64(spare))
    return int(np.int64(left >> spare))


@compiled
def pack(word: np.uint64, signal: SignalLayout, raw: Whole) -> np.uint64:
    """Return the payload word (uint64) with `raw` inserted as `signal`.

    Bits of `raw` above the signal's length are dropped.
    """
    mask = (~np.uint64(0)) >> np.uint64(64 - signal.length)
    shift = np.uint64(signal.shift)
    bits = _swapped(np.uint64(word)) if signal.big_endian else np.uint64(word)
    field = np.uint64(np.int64(raw)) & mask  # a negative number in two's complement
    bits = (bits & ~(mask << shift)) | (field << shift)
    return _swapped(bits) if signal.big_endian else bits


@compiled
def to_physical(raw: Whole, signal: SignalLayout) -> float:
    """Return the value of a raw integer in the signal's unit."""
    return raw * signal.scale + signal.offset


@compiled
def to_raw(physical: float, signal: SignalLayout) -> int:
    """Return the raw integer nearest to a value, limited to the signal's range."""
    scaled = np.rint((physical - signal.offset) / signal.scale)
    if not scaled > signal.raw_minimum:  # maps NaN to the minimum, too
        return int(np.int64(signal.raw_minimum))
    if scaled >= signal.raw_maximum:
        return int(np.int64(signal.raw_maximum))
    return int(np.int64(scaled))


@compiled
def to_raw_wrapped(physical: float, signal: SignalLayout) -> int:
    """Return the raw integer nearest to a value, modulo the signal's whole range.

    For a value that wraps around, such as an angle over several turns.
    """
    raw = np.int64(np.rint((physical - signal.offset) / signal.scale))
    return _field(np.uint64(raw), signal)


@compiled
def encode_wrapped(word: np.uint64, signal: SignalLayout, physical: float) -> np.uint64:
    """Return the payload word with a value inserted modulo the signal's whole range."""
    return pack(word, signal, to_raw_wrapped(physical, signal))


@compiled
def quantised(physical: float, signal: SignalLayout) -> float:
    """Return what `decode` makes of a value that `encode` has inserted."""
    return to_physical(to_raw(physical, signal), signal)


@compiled
def quantised_wrapped(physical: float, signal: SignalLayout) -> float:
    """Return what `decode` makes of a value that `encode_wrapped` has inserted."""
    return to_physical(to_raw_wrapped(physical, signal), signal)


@compiled
def unwrapped(value: float, near: float, span: float) -> float:
    """Return the value nearest to `near` that differs from `value` by whole spans."""
    return value + span * np.rint((near - value) / span)


@compiled
def span_of(signal: SignalLayout) -> float:
    """Return the whole range of a signal's field, in its unit."""
    return signal.scale * np.float64(np.uint64(1) << np.uint64(signal.length))


@compiled
def decode(word: np.uint64, signal: SignalLayout) -> float:
    """Return the value of `signal` in a payload word, in the signal's unit."""
    return to_physical(unpack(word, signal), signal)


@compiled
def encode(word: np.uint64, signal: SignalLayout, physical: float) -> np.uint64:
    """Return the payload word with a value, in the signal's unit, inserted."""
    return pack(word, signal, to_raw(physical, signal))


class Codec:
    """The contract, ready for use.

    Parameters
    ----------
    facts : Facts
    read : Callable
        Returns the DBC as cantools reads it.

    Attributes
    ----------
    facts : Facts
    signals : Records[SignalLayout]
        All signals of all messages.
    messages : Records[MessageLayout]
        Identifier, protection and cycle time of each message, by `message_index`.
    """

    def __init__(self, facts: Facts, read: Callable[[], Database]) -> None:
        self.facts, self._read = facts, read
        self._messages = {message.name: k for k, message in enumerate(facts.messages)}
        every = [(message.name, each) for message in facts.messages for each in message.signals]
        self._signals = {(message, each.name): k for k, (message, each) in enumerate(every)}
        self._signal_facts = [each for _, each in every]
        self.signals = SignalLayout.array([tuple(each.layout) for _, each in every])
        self.messages = MessageLayout.array([tuple(one.layout) for one in facts.messages])

    @functools.cached_property
    def database(self) -> Database:
        """The DBC as cantools reads it, for comments, units and what else no step needs."""
        return self._read()

    @property
    def bits_per_s(self) -> int:
        """Bit rate of the bus: the DBC's attribute Baudrate."""
        return self.facts.bits_per_s

    def is_protected(self, message: str) -> bool:
        """Return whether a message has E2E protection; diagnostic messages have none."""
        return bool(self.messages[self.message_index(message)].data_id)

    def counts_epochs(self, message: str) -> bool:
        """Return whether a message's counter is the epoch, rather than its transmissions."""
        return self.facts.messages[self.message_index(message)].counts_epochs

    def send_type(self, message: str) -> str:
        """Return when a message is sent: Cyclic, IfActive (cyclic at times) or Event."""
        return self.facts.messages[self.message_index(message)].send_type

    def signal_names(self, message: str) -> list[str]:
        """Return the names of a message's signals, in the order of the DBC."""
        return [each.name for each in self.facts.messages[self.message_index(message)].signals]

    def valid_if(self, message: str, signal: str) -> str | None:
        """Return the signal of the same message without which a signal means nothing; or None."""
        return self._signal_facts[self.signal_index(message, signal)].valid_if

    def message_index(self, message: str) -> int:
        """Return the row of a message in `messages`."""
        try:
            return self._messages[message]
        except KeyError:
            raise ContractError(f"the DBC has no message {message}") from None

    def signal_index(self, message: str, signal: str) -> int:
        """Return the row of a signal in `signals`."""
        try:
            return self._signals[message, signal]
        except KeyError:
            raise ContractError(f"the DBC has no signal {message}.{signal}") from None

    def frame_id(self, message: str) -> int:
        """Return a message's identifier."""
        return int(self.messages[self.message_index(message)].can_id)

    def value(self, message: str, signal: str, name: str) -> int:
        """Return the raw value of a name in a signal's value table."""
        for raw, choice in self._signal_facts[self.signal_index(message, signal)].choices:
            if choice == name:
                return raw
        raise ContractError(f"{message}.{signal} has no value named {name}")

    def choices(self, message: str, signal: str) -> Mapping[int, str]:
        """Return a signal's value table, raw value to name."""
        return dict(self._signal_facts[self.signal_index(message, signal)].choices)


def codec_of(database: Database) -> Codec:
    """Return the codec of a DBC as cantools has read it."""
    return Codec(Facts.of(database), lambda: database)


def _own_facts(text: str, read: Callable[[], Database]) -> Facts:
    """Return the facts of the project's DBC: kept beside compiled code, as parsing takes longer."""
    folder = code_folder()
    name = name_of_code("dbc.codec.facts", text + SOURCE)
    kept = None if folder is None else folder.load(name)
    if kept is not None:
        return Facts.of_json(kept)
    facts = Facts.of(read())
    if folder is not None:
        folder.save(name, facts.to_json())
    return facts


@functools.cache
def load(path: Path | None = None) -> Codec:
    """Return the codec of a DBC file; by default of the project's.

    Raises
    ------
    ContractError
        When the file cannot be read or is unsuitable (see `Facts.of`).
    """
    source = str(path or "rrins.dbc")
    try:
        if path is None:
            text = resources.files(__package__).joinpath("rrins.dbc").read_text(encoding="utf-8")
        else:
            text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ContractError(f"cannot read the DBC {source}: {error}") from error
    read = functools.partial(read_dbc, text, source)
    return Codec(Facts.of(read()) if path else _own_facts(text, read), read)
