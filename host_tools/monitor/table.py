"""The table of messages, line by line, and the detail of one message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.text import Text

from rrins.host_tools.monitor.listing import MessageRow
from rrins.host_tools.monitor.state import BusState, MessageState, SignalState
from rrins.host_tools.monitor.wording import (
    age_words,
    clipped,
    hexadecimal_words,
    number_words,
    rate_words,
    value_with_unit,
    value_words,
)
from rrins.host_tools.rounding import unit_words

WIDE = 110
"""Minimum width to show each kind of error, and values with their names."""

_EXTENDED_WIDTH = 10
_STANDARD_WIDTH = 5
_ATTENTION = "bold yellow"


@dataclass(frozen=True)
class _Column:
    title: str
    width: int
    is_right: bool = False

    def cell(self, text: str) -> str:
        text = clipped(text, self.width)
        return text.rjust(self.width) if self.is_right else text.ljust(self.width)


def _columns(rows: Sequence[MessageRow], width: int) -> list[_Column]:
    has_extended = any(row.message.is_extended for row in rows)
    columns = [
        _Column("", 2),
        _Column("id", _EXTENDED_WIDTH if has_extended else _STANDARD_WIDTH),
        _Column("name", 18),
        _Column("rate/s", 7, is_right=True),
        _Column("age", 6, is_right=True),
    ]
    if width >= WIDE:
        columns += [_Column(title, 5, is_right=True) for title in ("lost", "turn", "crc")]
    else:
        columns.append(_Column("errors", 7, is_right=True))
    taken = sum(column.width + 1 for column in columns) - 1
    return [*columns, _Column("values", max(0, width - taken - 1))]


def table_head(rows: Sequence[MessageRow], width: int, order: str) -> Text:
    """Return the column titles; the sort column is marked."""
    titled = {"id": "id", "name": "name", "rate": "rate/s", "errors": "errors"}[order]
    cells = [
        column.cell(f"{column.title}*" if column.title == titled else column.title)
        for column in _columns(rows, width)
    ]
    return Text(_joined(cells)[:width].ljust(width), style="underline", no_wrap=True)


def table_lines(
    state: BusState, rows: Sequence[MessageRow], shown: range, cursor: int | None, width: int
) -> list[Text]:
    """Return the lines of some of the rows.

    Parameters
    ----------
    state : BusState
    rows : sequence of MessageRow
    shown : range
        Rows to show.
    cursor : int, optional
        Selected row.
    width : int
        Columns of the screen.
    """
    columns = _columns(rows, width)
    lines = []
    for number in shown:
        row = rows[number]
        cells = _cells(state, row, width)
        cells[0] = (">" if number == cursor else " ") + cells[0]
        joined = _joined([column.cell(cell) for column, cell in zip(columns, cells, strict=True)])
        style = "reverse" if number == cursor else _ATTENTION if is_marked(row.message) else ""
        lines.append(Text(joined[:width].ljust(width), style=style, no_wrap=True))
    return lines


def _joined(cells: Sequence[str]) -> str:
    return cells[0] + " ".join(cells[1:])


def is_marked(message: MessageState) -> bool:
    """Return whether a message needs attention and gets an exclamation mark."""
    return message.is_silent or message.has_recent_errors or not message.is_sound_or_unknown


def _cells(state: BusState, row: MessageRow, width: int) -> list[str]:
    message = row.message
    cells = [
        "!" if is_marked(message) else " ",
        message.hexadecimal,
        message.label,
        "silent" if message.is_silent else rate_words(message.rate_hz),
        age_words(message.age_s),
    ]
    if width >= WIDE:
        cells += [str(message.lost), str(message.out_of_turn), str(message.crc_errors)]
    else:
        cells.append(str(message.errors))
    return [*cells, _values(state, row, has_names=width >= WIDE or row.is_chosen)]


def _values(state: BusState, row: MessageRow, has_names: bool) -> str:
    message = row.message
    if message.name is None:
        return hexadecimal_words(message.data)
    values = []
    for name in row.signals:
        words = value_with_unit(state.signal(message.name, name))
        values.append(f"{name}={words}" if has_names else words)
    return "  ".join(values)


def detail_head(state: BusState, message: MessageState, width: int) -> list[Text]:
    """Return the description of a message, three lines."""
    period = "" if message.period_s is None else f"  every {message.period_s * 1e3:.3f} ms"
    rate = "silent" if message.is_silent else rate_words(message.rate_hz)
    wrong = "" if message.is_sound_or_unknown else " WRONG"
    lines = [
        f"{message.hexadecimal} {message.label}  {state.description(message)}",
        f"frames {message.count}  rate/s {rate}{period}  age {age_words(message.age_s)}",
        f"lost {message.lost}  turn {message.out_of_turn}  crc {message.crc_errors}"
        f"  last frame{wrong} {hexadecimal_words(message.data)}",
    ]
    styles = ("bold", "", _ATTENTION if wrong else "")
    return [
        Text(clipped(line, width), style=style, no_wrap=True)
        for line, style in zip(lines, styles, strict=True)
    ]


_MARK_WIDTH = 3
_UNIT_WIDTH = 6
_NAME_WIDTH = 24


def signal_head(width: int) -> Text:
    """Return the titles of the signals' columns."""
    return Text(_signal_line(("", "signal", "value", "unit", "min", "max"), width), "underline")


def signal_lines(
    signals: Sequence[SignalState],
    shown: range,
    cursor: int | None,
    plotted: Sequence[str],
    width: int,
) -> list[Text]:
    """Return the lines of some signals; plotted ones are marked."""
    lines = []
    for number in shown:
        signal = signals[number]
        mark = (">" if number == cursor else " ") + ("p " if signal.name in plotted else "  ")
        value = value_words(signal)
        if signal.text is not None:
            value = f"{signal.text} ({number_words(signal.value, 0)})"
        low = number_words(signal.low, signal.decimals)
        high = number_words(signal.high, signal.decimals)
        line = _signal_line((mark, signal.name, value, unit_words(signal.unit), low, high), width)
        lines.append(Text(line, style="reverse" if number == cursor else "", no_wrap=True))
    return lines


def _signal_line(cells: tuple[str, str, str, str, str, str], width: int) -> str:
    """Return a line of six cells; the three numbers share the remaining width."""
    mark, name, value, unit, low, high = cells
    left = max(0, width - _MARK_WIDTH - _NAME_WIDTH - _UNIT_WIDTH - 4)
    outer = min(14, left // 3)
    inner = min(34, left - 2 * outer)
    parts = (
        clipped(name, _NAME_WIDTH).ljust(_NAME_WIDTH),
        clipped(value, inner).rjust(inner),
        clipped(unit, _UNIT_WIDTH).ljust(_UNIT_WIDTH),
        clipped(low, outer).rjust(outer),
        clipped(high, outer).rjust(outer),
    )
    return (mark.ljust(_MARK_WIDTH) + " ".join(parts))[:width].ljust(width)
