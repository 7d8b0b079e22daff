"""Packing and unpacking of signals, by tables read from the DBC at program start.

A message's payload is one 64-bit word (see `rrins.dbc.frame`). A signal is a row of the table
`Codec.signals`: shift, length, sign, byte order, scale, offset. The compiled functions here take
such a row, so no code contains a bit position; steps keep the *index* of the signals they need,
looked up by name once at start.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import cantools.database
import numpy as np
from cantools.database import Message, Signal
from cantools.database.can import Database
from cantools.errors import Error as CantoolsError

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import F8, I8, U1, Record, Whole
from rrins.dbc.e2e import MessageLayout


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


_NO_PROFILE, _P01A = 0, 1  # of the attribute E2EProfile


class ContractError(Exception):
    """The DBC cannot serve as the contract: it is unreadable, incomplete or inconsistent."""


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
    spare = np.uint64(64 - signal.length)
    left = (bits >> np.uint64(signal.shift)) << spare
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
def encode_wrapped(word: np.uint64, signal: SignalLayout, physical: float) -> np.uint64:
    """Return the payload word with a value inserted modulo the signal's whole range.

    For a value that wraps around, such as an angle over several turns.
    """
    return pack(word, signal, np.int64(np.rint((physical - signal.offset) / signal.scale)))


@compiled
def unwrapped(value: float, near: float, span: float) -> float:
    """Return the value nearest to `near` that differs from `value` by whole spans."""
    return value + span * np.rint((near - value) / span)


@compiled
def span_of(signal: SignalLayout) -> float:
    """Return the whole range of a signal's field, in its unit."""
    return signal.scale * 2.0 ** np.float64(signal.length)


@compiled
def decode(word: np.uint64, signal: SignalLayout) -> float:
    """Return the value of `signal` in a payload word, in the signal's unit."""
    return to_physical(unpack(word, signal), signal)


@compiled
def encode(word: np.uint64, signal: SignalLayout, physical: float) -> np.uint64:
    """Return the payload word with a value, in the signal's unit, inserted."""
    return pack(word, signal, to_raw(physical, signal))


def _shift(signal: Signal) -> int:
    """Return the offset of the signal's least significant bit from the word's."""
    if signal.byte_order == "little_endian":
        return int(signal.start)
    # Motorola: `start` is the most significant bit, counted 7..0, 15..8, … over the bytes.
    byte, bit = divmod(int(signal.start), 8)
    return 8 * (7 - byte) + bit - (signal.length - 1)


def _raw_limits(signal: Signal) -> tuple[int, int]:
    """Return the smallest and largest raw integer: the field's, narrowed by the stated range."""
    if signal.is_signed:
        low, high = -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    else:
        low, high = 0, (1 << min(signal.length, 63)) - 1
    if signal.minimum is not None and signal.maximum is not None:
        stated = sorted(
            round((limit - signal.offset) / signal.scale)
            for limit in (signal.minimum, signal.maximum)
        )
        low, high = max(low, stated[0]), min(high, stated[1])
    return low, high


class Codec:
    """The contract, ready for use.

    Parameters
    ----------
    database : cantools.database.can.Database
        The DBC as cantools reads it.

    Attributes
    ----------
    database : cantools.database.can.Database
        For everything that is not in a hot path: names, comments, value tables.
    signals : Records[SignalLayout]
        All signals of all messages.
    messages : Records[MessageLayout]
        Identifier, protection and cycle time of each message, by `message_index`.

    Raises
    ------
    ContractError
        When a message exceeds eight bytes, a signal is floating point or multiplexed, or an E2E
        attribute is missing, unknown or inconsistent with the other.
    """

    def __init__(self, database: Database) -> None:
        self.database = database
        self._message_rows: dict[str, int] = {}
        self._signal_rows: dict[tuple[str, str], int] = {}
        self._send_types: dict[str, str] = {}
        self._choices: dict[tuple[str, str], Mapping[int, str]] = {}
        signals: list[tuple[object, ...]] = []
        messages: list[tuple[object, ...]] = []
        for message in database.messages:
            self._check(message)
            self._message_rows[message.name] = len(messages)
            self._send_types[message.name] = self._named(message, "GenMsgSendType", "Cyclic")
            for signal in message.signals:
                self._signal_rows[message.name, signal.name] = len(signals)
                signals.append(self._signal_row(signal))
            messages.append(self._message_row(message))
        self.signals = SignalLayout.array(signals)
        self.messages = MessageLayout.array(messages)

    @staticmethod
    def _check(message: Message) -> None:
        if message.length > 8:
            raise ContractError(f"{message.name}: {message.length} bytes; a classic frame has 8")
        for signal in message.signals:
            if signal.is_float or signal.is_multiplexer or signal.multiplexer_ids:
                raise ContractError(
                    f"{message.name}.{signal.name}: float and multiplexed signals are not supported"
                )

    @staticmethod
    def _signal_row(signal: Signal) -> tuple[float, ...]:
        return (
            signal.scale,
            signal.offset,
            *_raw_limits(signal),
            _shift(signal),
            signal.length,
            signal.is_signed,
            signal.byte_order == "big_endian",
        )

    def _message_row(self, message: Message) -> tuple[int, ...]:
        attributes = message.dbc.attributes if message.dbc else {}
        profile = attributes.get("E2EProfile")
        data_id = attributes.get("E2EDataID")
        if profile is None or data_id is None:
            raise ContractError(f"{message.name}: needs E2EProfile and E2EDataID")
        if (int(profile.value), int(data_id.value) != 0) not in (
            (_NO_PROFILE, False),
            (_P01A, True),
        ):
            raise ContractError(
                f"{message.name}: needs E2EProfile P01A and an E2EDataID, or None and 0"
            )
        return (message.frame_id, int(data_id.value), message.length, message.cycle_time or 0)

    @staticmethod
    def _named(message: Message, attribute: str, default: str) -> str:
        """Return the name of a message's value of an attribute that is an enumeration."""
        given = message.dbc.attributes.get(attribute) if message.dbc else None
        return default if given is None else str(given.definition.choices[int(given.value)])

    @property
    def bits_per_s(self) -> int:
        """Bit rate of the bus: the DBC's attribute Baudrate."""
        assert self.database.dbc is not None
        return int(self.database.dbc.attributes["Baudrate"].value)

    def is_protected(self, message: str) -> bool:
        """Return whether a message has E2E protection; diagnostic messages have none."""
        return bool(self.messages[self.message_index(message)].data_id)

    def counts_epochs(self, message: str) -> bool:
        """Return whether a message's counter is the epoch, rather than its transmissions."""
        described = self.database.get_message_by_name(message)
        return self._named(described, "E2ECounter", "None") == "Epoch"

    def send_type(self, message: str) -> str:
        """Return when a message is sent: Cyclic, IfActive (cyclic at times) or Event."""
        return self._send_types[message]

    def valid_if(self, message: str, signal: str) -> str | None:
        """Return the signal of the same message without which a signal means nothing; or None."""
        self.signal_index(message, signal)
        described = self.database.get_message_by_name(message).get_signal_by_name(signal)
        given = described.dbc.attributes.get("ValidIf") if described.dbc else None
        return None if given is None else str(given.value)

    def message_index(self, message: str) -> int:
        """Return the row of a message in `messages`."""
        try:
            return self._message_rows[message]
        except KeyError:
            raise ContractError(f"the DBC has no message {message}") from None

    def signal_index(self, message: str, signal: str) -> int:
        """Return the row of a signal in `signals`."""
        try:
            return self._signal_rows[message, signal]
        except KeyError:
            raise ContractError(f"the DBC has no signal {message}.{signal}") from None

    def frame_id(self, message: str) -> int:
        """Return a message's identifier."""
        return int(self.messages[self.message_index(message)].can_id)

    def value(self, message: str, signal: str, name: str) -> int:
        """Return the raw value of a name in a signal's value table."""
        choices = self.choices(message, signal)
        for raw, choice in choices.items():
            if choice == name:
                return raw
        raise ContractError(f"{message}.{signal} has no value named {name}")

    def choices(self, message: str, signal: str) -> Mapping[int, str]:
        """Return a signal's value table, raw value to name."""
        self.signal_index(message, signal)
        found = self._choices.get((message, signal))
        if found is None:
            choices = self.database.get_message_by_name(message).get_signal_by_name(signal).choices
            found = {int(raw): str(name) for raw, name in (choices or {}).items()}
            self._choices[message, signal] = found
        return found


@functools.cache
def load(path: Path | None = None) -> Codec:
    """Return the codec of a DBC file; by default of the project's.

    Raises
    ------
    ContractError
        When the file cannot be read or is unsuitable (see `Codec`).
    """
    try:
        if path is None:
            text = resources.files(__package__).joinpath("rrins.dbc").read_text(encoding="utf-8")
        else:
            text = path.read_text(encoding="utf-8")
        database = cantools.database.load_string(text, database_format="dbc")
    except (OSError, UnicodeDecodeError, CantoolsError) as error:
        raise ContractError(f"cannot read the DBC {path or 'rrins.dbc'}: {error}") from error
    assert isinstance(database, Database)
    return Codec(database)
