"""A signal's history as a small plot of block characters."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.tally import BINS
from rrins.host_tools.monitor.wording import clipped, number_words

SPANS = ("1 min", "10 min", "100 min")
"""Time span of the histories, by level."""

ROWS = 3
"""Lines of the curve."""

HEIGHT = ROWS + 1
"""Lines of a plot, with its title."""

_EIGHTHS = " ▁▂▃▄▅▆▇█"
_LABEL_WIDTH = 14
_MOST_COLUMNS = BINS

Bins = Sequence[tuple[float, float] | None]


def columns_of(bins: Bins, columns: int) -> list[float | None]:
    """Return the mid-range value of each of `columns` equal parts of a history."""
    middles: list[float | None] = []
    for column in range(columns):
        part = bins[column * len(bins) // columns : (column + 1) * len(bins) // columns]
        found = [pair for pair in part if pair is not None]
        if found:
            middles.append((min(low for low, _ in found) + max(high for _, high in found)) / 2)
        else:
            middles.append(None)
    return middles


def curve(values: Sequence[float | None], low: float, high: float) -> list[str]:
    """Return `ROWS` lines in which each value is a column, blank for None.

    The lowest value is an eighth of a line high, to distinguish it from a missing one.
    """
    steps = 8 * ROWS - 1
    heights = [
        0
        if value is None
        else 1 + round((value - low) / (high - low) * steps)
        if high > low
        else 4 * ROWS
        for value in values
    ]
    return [
        "".join(_EIGHTHS[min(8, max(0, height - 8 * row))] for height in heights)
        for row in reversed(range(ROWS))
    ]


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
    columns = max(1, min(_MOST_COLUMNS, width - _LABEL_WIDTH - 1))
    found = [pair for pair in bins if pair is not None]
    unit = f" {described.unit}" if described.unit else ""
    now = described.text or number_words(described.value, described.decimals) + unit
    title = f"{message}.{signal}  now {now}  last {SPANS[level]}"
    lines = [Text(clipped(title, width), style="bold", no_wrap=True)]
    if not found:
        return Text("\n").join([*lines, *(Text() for _ in range(ROWS))])
    low, high = min(low for low, _ in found), max(high for _, high in found)
    labels = [number_words(high, described.decimals), "", number_words(low, described.decimals)]
    for label, part in zip(labels, curve(columns_of(bins, columns), low, high), strict=True):
        lines.append(Text(f"{clipped(label, _LABEL_WIDTH):>{_LABEL_WIDTH}}|{part}", no_wrap=True))
    return Text("\n").join(lines)
