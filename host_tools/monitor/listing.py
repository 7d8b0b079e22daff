"""Filtering and sorting of the messages to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rrins.host_tools.monitor.sort_orders import ORDERS
from rrins.host_tools.monitor.state import PROTECTION, BusState, MessageState
from rrins.host_tools.rounding import kept

_SortKey = float | tuple[bool, list[tuple[int, str]]]

_KEYS: dict[str, Callable[[MessageState], _SortKey]] = {
    "id": lambda message: 0,  # the order of a state's messages
    "name": lambda message: (message.name is None, _natural(message.label)),
    "rate": lambda message: (
        -(kept(message.rate_hz, 2) or 0.0)
    ),  # rounded, so that jitter does not reorder
    "errors": lambda message: -message.errors,
}

assert tuple(_KEYS) == ORDERS


@dataclass(frozen=True)
class MessageRow:
    """A message to show."""

    message: MessageState
    #: signals to show: those that match the filter, or else all but the protection
    signals: tuple[str, ...]
    is_chosen: bool  #: whether the signals themselves match the filter


def message_rows(state: BusState, needle: str = "", order: str = "id") -> list[MessageRow]:
    """Return the messages that match a filter, in order.

    Parameters
    ----------
    state : BusState
    needle : str
        Part of the name or identifier of a message, or of the name of a signal, which then shows
        only that signal; ``message.signal`` matches both. Case is ignored.
    order : {"id", "name", "rate", "errors"}
    """
    found = [_row(state, message, needle.strip().lower()) for message in state.messages]
    rows = [row for row in found if row is not None]
    return sorted(rows, key=lambda row: _KEYS[order](row.message))


def _row(state: BusState, message: MessageState, needle: str) -> MessageRow | None:
    names = [] if message.name is None else [s.name for s in state.signals(message.name)]
    unprotected = tuple(name for name in names if name not in PROTECTION)
    of_message, dot, of_signal = needle.partition(".")
    titles = (message.label.lower(), message.hexadecimal.lower())
    is_named = any(of_message in title for title in titles)
    if not dot and is_named:
        return MessageRow(message, unprotected, False)
    if dot and not is_named:
        return None
    part = of_signal if dot else needle
    chosen = tuple(name for name in names if part in name.lower())
    return MessageRow(message, chosen, True) if chosen else None


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts SENSOR_10 after SENSOR_9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in name.split("_")]
