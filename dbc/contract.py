"""The contract as one record, so that a compiled step reads ``contract.sync.epoch``.

For every message of the DBC the record has a field of the message's name in lower case; it holds
`message` (a row of dtype `dbc.e2e.MESSAGE`) and one row of dtype `dbc.codec.SIGNAL` for each
signal. Messages that differ by a number at the end only (``SENSOR_1`` …) become one array.
The record's *type* follows the DBC's names, its *values* the DBC's bit positions: compiled code
that is kept on disk stays right when a bit moves.
"""

from __future__ import annotations

import functools
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.codec import SIGNAL, Codec, ContractError, load
from dbc.e2e import MESSAGE

SENSOR_GROUPS = 16
"""Sensor groups that the DBC has frames for: the most sensors of one kind that a RIMU can have."""

_NUMBERED = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")


def _families(codec: Codec) -> dict[str, list[str]]:
    """Return the messages by field: numbered ones in order of their numbers, others alone."""
    numbered: dict[str, dict[int, str]] = {}
    families: dict[str, list[str]] = {}
    for message in codec.database.messages:
        match = _NUMBERED.fullmatch(message.name)
        if match is None:
            families[message.name.lower()] = [message.name]
        else:
            members = numbered.setdefault(match["stem"].lower(), {})
            members[int(match["number"])] = message.name
    for stem, members in numbered.items():
        if sorted(members) != list(range(1, len(members) + 1)):
            raise ContractError(
                f"the messages {stem.upper()}_n are not numbered from 1 without gap"
            )
        families[stem] = [members[number] for number in sorted(members)]
    return families


def _message_dtype(codec: Codec, names: list[str]) -> np.dtype[Any]:
    signals = [signal.name for signal in codec.database.get_message_by_name(names[0]).signals]
    for name in names[1:]:
        if [s.name for s in codec.database.get_message_by_name(name).signals] != signals:
            raise ContractError(f"{name} has not the signals of {names[0]}")
    return np.dtype((np.record, [("message", MESSAGE), *((name, SIGNAL) for name in signals)]))


def _fill(record: Any, codec: Codec, name: str) -> None:
    record["message"] = codec.messages[codec.message_index(name)]
    for signal in codec.database.get_message_by_name(name).signals:
        record[signal.name] = codec.signals[codec.signal_index(name, signal.name)]


def contract_of(codec: Codec) -> NDArray[Any]:
    """Return the contract of a codec: an array of one record (see the module).

    The array, not its record, is what a compiled function takes: numba recognises an array's type
    in half a microsecond, that of so large a record in sixty.
    """
    families = _families(codec)
    fields: list[Any] = []
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
    return array


@functools.cache
def load_contract() -> NDArray[Any]:
    """Return the contract of the project's own DBC."""
    return contract_of(load())
