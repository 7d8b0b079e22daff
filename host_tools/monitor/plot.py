"""A signal's history as a small plot of dots, from the smallest to the largest value.

Of libraries, plotext draws such a span with gaps, and takes 15 to 27 ms for 130 columns, where this
takes 0.4 ms.
"""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.tally import BINS
from rrins.host_tools.monitor.wording import clipped, number_words, value_with_unit

SPANS = ("1 min", "10 min", "100 min")
"""Time span of the histories, by level."""

ROWS = 3
"""Lines of the curve."""

HEIGHT = ROWS + 1
"""Lines of a plot, with its title."""

LEVELS = 4 * ROWS
"""Heights that the curve can tell apart: a character is two dots wide and four high."""

_DOTS = ((0x40, 0x04, 0x02, 0x01), (0x80, 0x20, 0x10, 0x08))
"""Bits of a braille pattern: left and right column, from the bottom."""

_BLANK = 0x2800
_LABEL_WIDTH = 14
_MOST_CHARACTERS = BINS

Bin = tuple[float, float] | None
"""Smallest and largest value; None without one."""


def columns_of(bins: Sequence[Bin], columns: int) -> list[Bin]:
    """Return the smallest and largest value of each of `columns` equal parts of a history."""
    found: list[Bin] = []
    for column in range(columns):
        start = column * len(bins) // columns
        end = max(start + 1, (column + 1) * len(bins) // columns)
        part = [pair for pair in bins[start:end] if pair is not None]
        spans = (min(low for low, _ in part), max(high for _, high in part)) if part else None
        found.append(spans)
    return found


def curve(columns: Sequence[Bin], low: float, high: float) -> list[str]:
    """Return `ROWS` lines of braille dots: each column from its smallest to its largest value.

    Two columns share a character. A column of None is blank; where all values are the same, the
    curve runs in the middle.
    """
    cells = [[_BLANK] * ((len(columns) + 1) // 2) for _ in range(ROWS)]
    for number, pair in enumerate(columns):
        if pair is None:
            continue
        bottom, top = (_level(value, low, high) for value in pair)
        for level in range(bottom, top + 1):
            cells[ROWS - 1 - level // 4][number // 2] |= _DOTS[number % 2][level % 4]
    return ["".join(" " if cell == _BLANK else chr(cell) for cell in row) for row in cells]


def _level(value: float, low: float, high: float) -> int:
    """Return the height of a value, 0 to `LEVELS` - 1."""
    if high <= low:
        return LEVELS // 2
    return min(LEVELS - 1, max(0, round((value - low) / (high - low) * (LEVELS - 1))))


def plot(state: BusState, message: str, signal: str, level: int, width: int) -> Text:
    """Return a plot of `HEIGHT` lines, newest value at the right.

    Parameters
    ----------
    state : BusState
    message, signal : str
    level : int
        Level of the history, see `SPANS`.
    width : int
        Columns of the screen.
    """
    described = state.signal(message, signal)
    bins = state.history(message, signal, level)
    columns = 2 * max(1, min(_MOST_CHARACTERS, width - _LABEL_WIDTH - 1))
    found = [pair for pair in bins if pair is not None]
    now = value_with_unit(described)
    title = f"{message}.{signal}  now {now}  last {SPANS[level]}"
    lines = [Text(clipped(title, width), style="bold", no_wrap=True)]
    if not found:
        return Text("\n").join([*lines, *(Text() for _ in range(ROWS))])
    low, high = min(low for low, _ in found), max(high for _, high in found)
    labels = [number_words(high, described.decimals), "", number_words(low, described.decimals)]
    for label, part in zip(labels, curve(columns_of(bins, columns), low, high), strict=True):
        lines.append(Text(f"{clipped(label, _LABEL_WIDTH):>{_LABEL_WIDTH}}|{part}", no_wrap=True))
    return Text("\n").join(lines)
