"""The contract as one record, so that a compiled step reads ``contract.sync.epoch``.

The record has a field for each message of the DBC, named after it in lower case; it holds
`message` (a `MessageLayout`) and, for each signal, a field of its name (a `SignalLayout`).
Messages that differ only in a trailing number (``SENSOR_1`` …) form one array.
The record's *type* follows the DBC's names, its *values* the DBC's bit positions: compiled code
that is cached on disk stays valid when a bit position changes.
"""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING, cast, overload

import numpy as np

from rrins.compiled.record import Record, Records
from rrins.dbc.codec import Codec, SignalLayout, load
from rrins.dbc.e2e import MessageLayout
from rrins.dbc.facts import ContractError

SENSOR_GROUPS = 16
"""Sensor groups with frames in the DBC: the most sensors of one kind that a RIMU can have."""

_NUMBERED = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")


class MessageSignals(Record):
    """A message: the protection of its frames, and a `SignalLayout` per signal, by name."""

    message: MessageLayout

    if TYPE_CHECKING:

        def __getattr__(self, signal: str) -> SignalLayout: ...
        @overload
        def __getitem__(self, number: int) -> MessageSignals: ...
        @overload
        def __getitem__(self, signal: str) -> SignalLayout: ...
        def __getitem__(self, key: int | str) -> Record: ...


class Contract(Record):
    """The whole contract; its fields are generated from the DBC (see the module)."""

    if TYPE_CHECKING:

        def __getattr__(self, message: str) -> MessageSignals: ...
        def __getitem__(self, message: str) -> MessageSignals: ...


def _families(codec: Codec) -> dict[str, list[str]]:
    """Return the messages by field: numbered ones in order, others alone."""
    numbered: dict[str, dict[int, str]] = {}
    families: dict[str, list[str]] = {}
    for message in codec.facts.messages:
        match = _NUMBERED.fullmatch(message.name)
        if match is None:
            families[message.name.lower()] = [message.name]
        else:
            members = numbered.setdefault(match["stem"].lower(), {})
            members[int(match["number"])] = message.name
    for stem, members in numbered.items():
        if sorted(members) != list(range(1, len(members) + 1)):
            raise ContractError(
                f"the messages {stem.upper()}_n are not numbered consecutively from 1"
            )
        families[stem] = [members[number] for number in sorted(members)]
    return families


def _message_dtype(codec: Codec, names: list[str]) -> np.dtype[np.void]:
    signals = codec.signal_names(names[0])
    for name in names[1:]:
        if codec.signal_names(name) != signals:
            raise ContractError(f"{name} and {names[0]} have different signals")
    layouts = ((name, SignalLayout.dtype) for name in signals)
    return np.dtype((np.record, [("message", MessageLayout.dtype), *layouts]))


def _fill(record: MessageSignals, codec: Codec, name: str) -> None:
    record["message"] = codec.messages[codec.message_index(name)]
    for signal in codec.signal_names(name):
        record[signal] = codec.signals[codec.signal_index(name, signal)]


def contract_of(codec: Codec) -> Records[Contract]:
    """Return the contract of a codec: an array of one record (see the module).

    Pass compiled functions the array, not its record: numba recognises an array's type in half a
    microsecond, that of so large a record in sixty.
    """
    families = _families(codec)
    fields: list[tuple[object, ...]] = []
    for field, names in families.items():
        dtype = _message_dtype(codec, names)
        fields.append((field, dtype) if len(names) == 1 else (field, dtype, (len(names),)))
    array = np.zeros(1, dtype=np.dtype((np.record, fields)))
    contract = array[0]
    for field, names in families.items():
        if len(names) == 1:
            _fill(contract[field], codec, names[0])
        else:
            for index, name in enumerate(names):
                _fill(contract[field][index], codec, name)
    if contract["sensor"].shape != (SENSOR_GROUPS,):
        raise ContractError(f"the DBC needs the messages SENSOR_1 to SENSOR_{SENSOR_GROUPS}")
    return cast(Records[Contract], array)


@functools.cache
def load_contract() -> Records[Contract]:
    """Return the contract of the project's DBC."""
    return contract_of(load())
