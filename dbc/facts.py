"""Facts of the DBC that every start needs: layouts, attributes and value tables.

To parse a DBC takes cantools a quarter of a second, with its import. So what steps and commands
need of the project's own is kept as JSON (`rrins.dbc.codec.load`).
"""

from __future__ import annotations

import json
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from cantools.database import Message, Signal
    from cantools.database.can import Database

SOURCE = Path(__file__).read_text(encoding="utf-8")
"""How facts are read, by which they are kept."""

_NO_PROFILE, _P01A = 0, 1  # of the attribute E2EProfile


class ContractError(Exception):
    """The DBC cannot serve as the contract: it is unreadable, incomplete or inconsistent."""


@dataclass(frozen=True)
class SignalFacts:
    """A signal as the DBC says it."""

    name: str
    layout: tuple[float, ...]  #: values of a `SignalLayout`
    valid_if: str | None  #: signal of the same message without which it means nothing
    choices: tuple[tuple[int, str], ...]  #: value table


@dataclass(frozen=True)
class MessageFacts:
    """A message as the DBC says it."""

    name: str
    layout: tuple[int, ...]  #: values of a `MessageLayout`
    senders: tuple[str, ...]
    send_type: str
    counts_epochs: bool
    signals: tuple[SignalFacts, ...]


@dataclass(frozen=True)
class Facts:
    """The messages that every start needs, and the bus's bit rate."""

    bits_per_s: int
    messages: tuple[MessageFacts, ...]

    @classmethod
    def of(cls, database: Database) -> Facts:
        """Return the facts of a DBC as cantools reads it.

        Raises
        ------
        ContractError
            When a message exceeds eight bytes, a signal is floating point or multiplexed, or an E2E
            attribute is missing, unknown or inconsistent with the other.
        """
        rate = database.dbc.attributes.get("Baudrate") if database.dbc else None
        return cls(
            int(rate.value) if rate is not None else 0,
            tuple(_message_facts(message) for message in database.messages),
        )

    @classmethod
    def of_json(cls, text: bytes) -> Facts:
        """Return facts that were written as JSON."""
        bits_per_s, messages = json.loads(text)
        return cls(
            bits_per_s,
            tuple(
                MessageFacts(
                    name,
                    tuple(layout),
                    tuple(senders),
                    send_type,
                    counts_epochs,
                    tuple(
                        SignalFacts(signal, tuple(bits), valid_if, tuple(map(tuple, choices)))
                        for signal, bits, valid_if, choices in signals
                    ),
                )
                for name, layout, senders, send_type, counts_epochs, signals in messages
            ),
        )

    def to_json(self) -> bytes:
        """Return them as JSON."""
        return json.dumps(astuple(self)).encode()


def _message_facts(message: Message) -> MessageFacts:
    if message.length > 8:
        raise ContractError(f"{message.name}: {message.length} bytes; a classic frame has 8")
    return MessageFacts(
        message.name,
        _message_row(message),
        tuple(message.senders),
        _named(message, "GenMsgSendType", "Cyclic"),
        _named(message, "E2ECounter", "None") == "Epoch",
        tuple(_signal_facts(message, signal) for signal in message.signals),
    )


def _message_row(message: Message) -> tuple[int, ...]:
    attributes = message.dbc.attributes if message.dbc else {}
    profile = attributes.get("E2EProfile")
    data_id = attributes.get("E2EDataID")
    if profile is None or data_id is None:
        raise ContractError(f"{message.name}: needs E2EProfile and E2EDataID")
    if (int(profile.value), int(data_id.value) != 0) not in ((_NO_PROFILE, False), (_P01A, True)):
        raise ContractError(
            f"{message.name}: needs E2EProfile P01A and an E2EDataID, or None and 0"
        )
    return (message.frame_id, int(data_id.value), message.length, message.cycle_time or 0)


def _named(message: Message, attribute: str, default: str) -> str:
    """Return the name of a message's value of an attribute that is an enumeration."""
    given = message.dbc.attributes.get(attribute) if message.dbc else None
    return default if given is None else str(given.definition.choices[int(given.value)])


def _signal_facts(message: Message, signal: Signal) -> SignalFacts:
    if signal.is_float or signal.is_multiplexer or signal.multiplexer_ids:
        raise ContractError(
            f"{message.name}.{signal.name}: float and multiplexed signals are not supported"
        )
    layout = (
        signal.scale,
        signal.offset,
        *_raw_limits(signal),
        _shift(signal),
        signal.length,
        signal.is_signed,
        signal.byte_order == "big_endian",
    )
    valid_if = signal.dbc.attributes.get("ValidIf") if signal.dbc else None
    return SignalFacts(
        signal.name,
        layout,
        None if valid_if is None else str(valid_if.value),
        tuple((int(raw), str(name)) for raw, name in (signal.choices or {}).items()),
    )


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


def read_dbc(text: str, source: str) -> Database:
    """Return the text of a DBC as cantools reads it; `source` is its name in an error.

    Raises
    ------
    ContractError
        When it cannot be read.
    """
    import cantools.database
    from cantools.errors import Error as CantoolsError

    try:
        database = cantools.database.load_string(text, database_format="dbc")
    except CantoolsError as error:
        raise ContractError(f"cannot read the DBC {source}: {error}") from error
    return cast("Database", database)
