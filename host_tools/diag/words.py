"""Diagnostic messages in words: service, identifier, values, negative response."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Field, Layout
from rrins.firmware_py.diagnostics.responses import NEGATIVE, POSITIVE_OFFSET
from rrins.firmware_py.diagnostics.responses import Code as NegativeCode
from rrins.host_tools.diag.advice import code_words
from rrins.host_tools.diag.exchanges import (
    EXTENDED_DATA,
    IDENTIFIERS,
    Bytes,
    Code,
    Constant,
    Exchange,
    Number,
    Part,
    Record,
    Repeated,
    StatusByte,
    exchanges,
)
from rrins.host_tools.diag.trouble_table import TroubleReport
from rrins.host_tools.diag.values import value_text

_MOST_BYTES = 16  # that are shown


class _OtherwiseError(Exception):
    """Data that the table does not describe."""


@dataclass(frozen=True)
class Words:
    """A message in words."""

    name: str  #: of the exchange, or of the service if the table has no such exchange
    service: str
    text: str  #: the name, and what was asked or answered
    is_refusal: bool = False  #: a negative response, but not the one that promises another


def request_words(payload: bytes) -> Words:
    """Return what a request says."""
    for exchange, parts in _candidates(payload, is_response=False):
        try:
            return _worded(exchange, _values(parts, payload))
        except _OtherwiseError:
            continue
    return _unknown(payload, payload[0])


def response_words(payload: bytes, asked: Mapping[int, str]) -> Words:
    """Return what a response says.

    Parameters
    ----------
    payload : bytes
    asked : mapping
        Names of the latest requests by service, for a negative response.
    """
    if payload[0] == NEGATIVE and len(payload) == 3:
        service, code = payload[1:]
        name = asked.get(service) or _service_name(service)
        is_refusal = code != NegativeCode.RESPONSE_PENDING
        how = "refused" if is_refusal else "delayed"
        return Words(name, _service_name(service), f"{name} {how}: {code_words(code)}", is_refusal)
    for exchange, parts in _candidates(payload, is_response=True):
        try:
            return _worded(exchange, _values(parts, payload))
        except _OtherwiseError:
            continue
    return _unknown(payload, payload[0] - POSITIVE_OFFSET)


def _worded(exchange: Exchange, values: Sequence[str]) -> Words:
    name = exchange.name
    return Words(name, exchange.service.name, ": ".join(filter(None, (name, ", ".join(values)))))


def _unknown(payload: bytes, service: int) -> Words:
    name = _service_name(service)
    return Words(name, name, f"{name}: {_hexadecimal(payload)}: not in the diagnostic table")


def _service_name(number: int) -> str:
    known = table.SERVICE_BY_NUMBER.get(number)
    return known.name if known else f"service 0x{number & 0xFF:02X}"


_Found = list[tuple[Exchange, tuple[Part, ...]]]


@functools.cache
def _by_prefix() -> dict[bytes, _Found]:
    """Return the exchanges, with all parts, by the constant bytes with which a message begins."""
    found: dict[bytes, _Found] = {}
    for exchange in exchanges():
        number = exchange.service.number
        sides = [(number, exchange.request)]
        if exchange.response is not None:
            sides.append((number + POSITIVE_OFFSET, exchange.response))
        for first, rest in sides:
            parts = (Constant("service", first), *rest)
            found.setdefault(_prefix(parts), []).append((exchange, parts))
    return found


def _prefix(parts: Sequence[Part]) -> bytes:
    prefix = b""
    for part in parts:
        if not isinstance(part, Constant):
            break
        prefix += part.value.to_bytes(part.size, "big")
    return prefix


def _candidates(payload: bytes, is_response: bool) -> Iterator[tuple[Exchange, tuple[Part, ...]]]:
    """Yield the exchanges whose constants a message has, those with most of them first."""
    known = _by_prefix()
    for length in range(min(len(payload), _longest_prefix()), 0, -1):
        for exchange, parts in known.get(payload[:length], ()):
            if (payload[0] == exchange.service.positive) == is_response:
                yield exchange, parts


@functools.cache
def _longest_prefix() -> int:
    return max(map(len, _by_prefix()))


def _values(parts: Sequence[Part], payload: bytes) -> list[str]:
    """Return the values of all parts in words."""
    found, rest = _read_all(parts, payload)
    if rest:
        raise _OtherwiseError
    return found


def _read_all(parts: Sequence[Part], data: bytes) -> tuple[list[str], bytes]:
    found: list[str] = []
    for part in parts:
        some, data = _read(part, data)
        found += some
    return found, data


def _read(part: Part, data: bytes) -> tuple[list[str], bytes]:
    """Return the words of a part, and the data after it."""
    if isinstance(part, Repeated):
        return _read_repeated(part, data)
    if isinstance(part, Record):
        return _read_record(part.of, data)
    if isinstance(part, Bytes) and part.size is None:
        return ([_hexadecimal(data)] if data else []), b""
    size = _size(part)
    own, rest = data[:size], data[size:]
    if len(own) < size:
        raise _OtherwiseError
    return list(_simple(part, own)), rest


def _size(part: Part) -> int:
    if isinstance(part, Field | Constant | Bytes):
        assert part.size is not None
        return part.size
    return {Code: 3, Number: 2, StatusByte: 1}[type(part)]


def _simple(part: Part, own: bytes) -> Iterator[str]:
    number = int.from_bytes(own, "big")
    if isinstance(part, Field):
        yield _field_words(part, own)
    elif isinstance(part, Bytes):
        yield f"{part.name} {_hexadecimal(own)}"
    elif isinstance(part, Code):
        trouble = table.TROUBLE_BY_NUMBER.get(number)
        yield f"{trouble.name} ({trouble.code})" if trouble else f"0x{number:06X}"
    elif isinstance(part, StatusByte):
        yield TroubleReport(None, 0, number).state
    elif isinstance(part, Number):
        did = table.IDENTIFIER_BY_NUMBER.get(number)
        yield did.name if did else f"0x{number:04X}"


def _field_words(field: Field, own: bytes) -> str:
    words = f"{field.name} {value_text(field, field.unpack(own))}"
    return f"{words} {field.unit}" if field.unit else words


def _read_repeated(part: Repeated, data: bytes) -> tuple[list[str], bytes]:
    found: list[str] = []
    if part.is_counted:
        if not data:
            raise _OtherwiseError
        count, data = data[0], data[1:]
        for _ in range(count):
            some, data = _read_all(part.parts, data)
            found.append(" ".join(some))
        return found, data
    while data:
        some, data = _read_all(part.parts, data)
        found.append(" ".join(some))
    return found, data


def _read_record(of: str, data: bytes) -> tuple[list[str], bytes]:
    size = 2 if of == IDENTIFIERS else 1
    number = int.from_bytes(data[:size], "big")
    name, layout = _record(of, number)
    own, rest = data[size : size + layout.size], data[size + layout.size :]
    if len(own) < layout.size:
        raise _OtherwiseError
    values, _ = _read_all(layout.fields, own)
    words = ", ".join(values)
    return [f"{name} ({words})" if name else words], rest


def _record(of: str, number: int) -> tuple[str, Layout]:
    if of == EXTENDED_DATA and number in table.EXTENDED_DATA:
        return "", table.EXTENDED_DATA[number]
    did = table.IDENTIFIER_BY_NUMBER.get(number)
    if of != IDENTIFIERS or did is None:
        raise _OtherwiseError
    return did.name, did.layout


def _hexadecimal(data: bytes) -> str:
    shown = data[:_MOST_BYTES].hex(" ")
    return shown if len(data) <= _MOST_BYTES else f"{shown} … ({len(data)} bytes)"
