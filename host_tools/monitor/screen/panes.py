"""The panes of the screen: each shows lines of text that are made elsewhere."""

from __future__ import annotations

import textwrap
from typing import ClassVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.geometry import Size
from textual.message import Message
from textual.widget import Widget

from host_tools.monitor.listing import Row
from host_tools.monitor.state import BusState, MessageState, SignalState
from host_tools.monitor.table import (
    detail_head,
    signal_head,
    signal_lines,
    table_head,
    table_lines,
)

_COMMENT_LINES = 2


class Lines(Widget):
    """Lines of text; it is as high as they are many unless the style says something else."""

    DEFAULT_CSS = "Lines { height: auto; width: 1fr; }"

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self._text = Text()

    @property
    def plain(self) -> str:
        """What is shown, without its style."""
        return self._text.plain

    def show(self, text: Text) -> None:
        """Show other lines."""
        grows = text.plain.count("\n") != self._text.plain.count("\n")
        self._text = text
        self.refresh(layout=grows)

    def render(self) -> Text:
        """Return the lines."""
        return self._text

    def get_content_width(self, container: Size, viewport: Size) -> int:
        """Return the columns that the lines take: all there are."""
        return container.width

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """Return how many lines there are."""
        return self._text.plain.count("\n") + 1


class Choice(Widget, can_focus=True):
    """Lines of which one is pointed at; the view follows it."""

    DEFAULT_CSS = "Choice { height: 1fr; width: 1fr; }"

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)", show=False),
        Binding("down,j", "move(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown", "page(1)", show=False),
        Binding("home", "move(-100000)", show=False),
        Binding("end", "move(100000)", show=False),
    ]

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self.cursor = 0
        self._top = 0

    @property
    def count(self) -> int:
        """How many lines there are to choose from."""
        raise NotImplementedError

    def in_view(self, height: int) -> range:
        """Return the lines that are in view when so many are, with the one pointed at."""
        self.cursor = max(0, min(self.cursor, self.count - 1))
        self._top = min(self._top, self.cursor, max(0, self.count - height))
        self._top = max(self._top, self.cursor - height + 1, 0)
        return range(self._top, min(self.count, self._top + height))

    def action_move(self, by: int) -> None:
        """Point at another line."""
        self.cursor = max(0, min(self.cursor + by, self.count - 1))
        self.moved()
        self.refresh()

    def action_page(self, by: int) -> None:
        """Point at a line that is a page away."""
        self.action_move(by * max(1, self.size.height - 2))

    def moved(self) -> None:
        """Take note that another line is pointed at."""


class MessageTable(Choice):
    """The table of messages. The same message stays pointed at when the order changes."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "open", show=False)]

    class Opened(Message):
        """A message was asked for in detail."""

    def __init__(self) -> None:
        super().__init__("messages")
        self._state: BusState | None = None
        self._rows: list[Row] = []
        self._order = ""
        self._key: tuple[str, bool] | None = None

    @property
    def count(self) -> int:
        """How many messages there are."""
        return len(self._rows)

    @property
    def chosen(self) -> Row | None:
        """The row that is pointed at."""
        return self._rows[self.cursor] if self.cursor < len(self._rows) else None

    def show(self, state: BusState, rows: list[Row], order: str) -> None:
        """Show other rows."""
        self._state, self._rows, self._order = state, rows, order
        keys = [_key(row) for row in rows]
        if self._key in keys:
            self.cursor = keys.index(self._key)
        self.cursor = max(0, min(self.cursor, len(rows) - 1))
        self.refresh()

    def moved(self) -> None:
        """Keep which message it is."""
        self._key = None if self.chosen is None else _key(self.chosen)

    def action_open(self) -> None:
        """Ask for the detail of a message."""
        if self.chosen is not None:
            self.moved()
            self.post_message(self.Opened())

    def render(self) -> Text:
        """Return titles and rows; how many are in view stands in the titles."""
        if self._state is None:
            return Text()
        width, height = self.size.width, self.size.height - 1
        shown = self.in_view(height)
        cursor = self.cursor if self._rows else None
        lines = table_lines(self._state, self._rows, shown, cursor, width)
        head = table_head(self._rows, width, self._order)
        if len(shown) < self.count:
            note = f" {shown.start + 1}-{shown.stop} of {self.count}"
            head = Text(head.plain[: width - len(note)] + note, style="underline", no_wrap=True)
        return Text("\n").join([head, *lines])


def _key(row: Row) -> tuple[str, bool]:
    return row.message.hexadecimal, row.message.is_remote


class Detail(Choice):
    """All signals of one message."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,backspace,left,enter", "close", show=False)
    ]

    class Closed(Message):
        """The detail is no longer wanted."""

    def __init__(self) -> None:
        super().__init__("detail")
        self._state: BusState | None = None
        self._message: MessageState | None = None
        self._signals: list[SignalState] = []
        self._plotted: list[str] = []

    @property
    def count(self) -> int:
        """How many signals there are."""
        return len(self._signals)

    @property
    def chosen(self) -> SignalState | None:
        """The signal that is pointed at."""
        return self._signals[self.cursor] if self.cursor < len(self._signals) else None

    def show(self, state: BusState, message: MessageState | None, plotted: list[str]) -> None:
        """Show a message; the signals that are plotted have a mark."""
        self._state, self._message, self._plotted = state, message, plotted
        name = None if message is None else message.name
        self._signals = [] if name is None else state.signals(name)
        self.refresh()

    def point_at(self, signal: str | None) -> None:
        """Point at a signal by its name; at the first one for None."""
        names = [found.name for found in self._signals]
        self.cursor = names.index(signal) if signal in names else 0

    def action_close(self) -> None:
        """Go back to the table."""
        self.post_message(self.Closed())

    def render(self) -> Text:
        """Return what is known of the message and its signals; the last lines tell of one."""
        if self._state is None or self._message is None:
            return Text()
        width = self.size.width
        head = detail_head(self._state, self._message, width)
        if not self._signals:
            return Text("\n").join(head)
        shown = self.in_view(max(1, self.size.height - len(head) - 1 - _COMMENT_LINES))
        lines = signal_lines(self._signals, shown, self.cursor, self._plotted, width)
        comment = textwrap.wrap(self._signals[self.cursor].comment, width)[:_COMMENT_LINES]
        return Text("\n").join([*head, signal_head(width), *lines, *map(Text, comment)])
