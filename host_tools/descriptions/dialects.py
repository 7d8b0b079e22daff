"""The bus contract in the dialects of other tools: DBC, ARXML, KCD and SYM."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import cantools
from cantools.database.can import Database
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from rrins.dbc.codec import Codec, load
from rrins.host_tools.descriptions.names import unit_name
from rrins.host_tools.files import write_text

if TYPE_CHECKING:
    from cantools.database import Message, Signal

_BASE_TYPE_BITS = (8, 16, 32, 64)
_ENCODINGS = MappingProxyType({"uint": "NONE", "sint": "2C"})


def write_dialect(path: Path) -> None:
    """Write the contract in the dialect that the ending of a path names.

    Raises
    ------
    RehearsalError
        If it cannot be written.
    """
    texts = {".dbc": _dbc, ".arxml": _arxml, ".kcd": _kcd, ".sym": _sym}
    write_text(path, texts[path.suffix.lower()]())


def _dbc() -> str:
    return resources.files("rrins.dbc").joinpath("rrins.dbc").read_text(encoding="utf-8")


def _kcd() -> str:
    return str(load().database.as_kcd_string())


def _sym() -> str:
    """Return the contract as SYM: names of signals are unique, and cut to 32 letters."""
    database = cantools.database.load_string(_dbc(), database_format="dbc")
    assert isinstance(database, Database)
    for message in database.messages:
        for signal in message.signals:
            signal.name = unique_name(message, signal)
    database.refresh()
    return str(database.as_sym_string())


def unique_name(message: Message, signal: Signal) -> str:
    """Return the name of a signal where it must be unique in the whole file."""
    return f"{message.name}_{signal.name}"


@dataclass(frozen=True)
class _Signal:
    """A signal as ARXML describes it."""

    name: str
    signal: Signal
    low: int  #: raw
    high: int
    unit: str

    @property
    def base_type(self) -> str:
        bits = next(bits for bits in _BASE_TYPE_BITS if bits >= self.signal.length)
        return f"{'sint' if self.signal.is_signed else 'uint'}{bits}"


@dataclass(frozen=True)
class _Protection:
    """The end-to-end protection of a message: places in bits."""

    message: Message
    data_id: int
    crc: int
    counter: int


def _arxml() -> str:
    codec = load()
    messages = codec.database.messages
    nodes = codec.database.nodes
    return _template().render(
        bits_per_s=codec.bits_per_s,
        messages=messages,
        nodes=nodes,
        signals=[*_signals(codec)],
        units=[
            {"name": unit_name(text), "text": text}
            for text in sorted({s.unit for m in messages for s in m.signals if s.unit})
        ],
        base_types=[
            {"name": f"{kind}{bits}", "bits": bits, "encoding": encoding}
            for kind, encoding in _ENCODINGS.items()
            for bits in _BASE_TYPE_BITS
        ],
        groups=[*_groups(codec)],
        protections=[*_protections(codec)],
        elements=[
            ("CAN-CLUSTER", "cluster/CAN"),
            *(("ECU-INSTANCE", f"ecu/{node.name}") for node in nodes),
            *(("CAN-FRAME", f"frame/{message.name}") for message in messages),
            *(("I-SIGNAL-I-PDU", f"pdu/{message.name}") for message in messages),
        ],
    )


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("rrins.host_tools.descriptions", "."), undefined=StrictUndefined
    )
    return environment.get_template("bus.arxml.j2")


def _signals(codec: Codec) -> Iterator[_Signal]:
    for message in codec.database.messages:
        for signal in message.signals:
            row = codec.signals[codec.signal_index(message.name, signal.name)]
            yield _Signal(
                unique_name(message, signal),
                signal,
                int(row["raw_minimum"]),
                int(row["raw_maximum"]),
                unit_name(signal.unit or ""),
            )


def _groups(codec: Codec) -> Iterator[dict[str, object]]:
    """Yield what each node sends and receives."""
    for node in codec.database.nodes:
        sent = [one.name for one in codec.database.messages if node.name in one.senders]
        heard = [one.name for one in codec.database.messages if node.name in one.receivers]
        yield {"node": node.name, "direction": "OUT", "messages": sent}
        yield {"node": node.name, "direction": "IN", "messages": heard}


def _protections(codec: Codec) -> Iterator[_Protection]:
    for message in codec.database.messages:
        if codec.is_protected(message.name):
            places = {signal.name: int(signal.start) for signal in message.signals}
            data_id = int(codec.messages[codec.message_index(message.name)]["data_id"])
            yield _Protection(message, data_id, places["crc"], places["alive_counter"])
