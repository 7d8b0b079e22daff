"""The panes of the screen: each shows lines of text formatted elsewhere."""

from __future__ import annotations

import textwrap
from typing import ClassVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.geometry import Size
from textual.message import Message
from textual.widget import Widget

from rrins.host_tools.monitor.listing import MessageRow
from rrins.host_tools.monitor.state import BusState, MessageState, SignalState
from rrins.host_tools.monitor.table import (
    detail_head,
    signal_head,
    signal_lines,
    table_head,
    table_lines,
)

_COMMENT_LINES = 2


class Lines(Widget):
    """Lines of text; the widget is as high as its text unless the style says otherwise."""

    DEFAULT_CSS = "Lines { height: auto; width: 1fr; }"

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self._text = Text()

    @property
    def plain(self) -> str:
        """The text shown, without style."""
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
        """Return the width of the lines: that of the container."""
        return container.width

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """Return how many lines there are."""
        return self._text.plain.count("\n") + 1


class Choice(Widget, can_focus=True):
    """Lines of which one is selected; the view follows the selection."""

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
        """Number of lines to choose from."""
        raise NotImplementedError

    def in_view(self, height: int) -> range:
        """Return the range of `height` lines in view, including the selected one."""
        self.cursor = max(0, min(self.cursor, self.count - 1))
        self._top = min(self._top, self.cursor, max(0, self.count - height))
        self._top = max(self._top, self.cursor - height + 1, 0)
        return range(self._top, min(self.count, self._top + height))

    def action_move(self, by: int) -> None:
        """Select another line."""
        self.cursor = max(0, min(self.cursor + by, self.count - 1))
        self.moved()
        self.refresh()

    def action_page(self, by: int) -> None:
        """Select the line one page away."""
        self.action_move(by * max(1, self.size.height - 2))

    def moved(self) -> None:
        """React to a change of the selection."""


class MessageTable(Choice):
    """The table of messages. The selected message stays selected when the order changes."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "open", show=False)]

    class Opened(Message):
        """The detail of a message was requested."""

    def __init__(self) -> None:
        super().__init__("messages")
        self._state: BusState | None = None
        self._rows: list[MessageRow] = []
        self._order = ""
        self._key: tuple[str, bool] | None = None

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self._rows)

    @property
    def chosen(self) -> MessageRow | None:
        """The selected row."""
        return self._rows[self.cursor] if self.cursor < len(self._rows) else None

    def show(self, state: BusState, rows: list[MessageRow], order: str) -> None:
        """Show other rows."""
        self._state, self._rows, self._order = state, rows, order
        keys = [_key(row) for row in rows]
        if self._key in keys:
            self.cursor = keys.index(self._key)
        self.cursor = max(0, min(self.cursor, len(rows) - 1))
        self.refresh()

    def moved(self) -> None:
        """Remember the selected message."""
        self._key = None if self.chosen is None else _key(self.chosen)

    def action_open(self) -> None:
        """Request the detail of a message."""
        if self.chosen is not None:
            self.moved()
            self.post_message(self.Opened())

    def render(self) -> Text:
        """Return titles and rows; the titles show the range in view."""
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


def _key(row: MessageRow) -> tuple[str, bool]:
    return row.message.hexadecimal, row.message.is_remote


class Detail(Choice):
    """All signals of one message."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,backspace,left,enter", "close", show=False)
    ]

    class Closed(Message):
        """The detail was closed."""

    def __init__(self) -> None:
        super().__init__("detail")
        self._state: BusState | None = None
        self._message: MessageState | None = None
        self._signals: list[SignalState] = []
        self._plotted: list[str] = []

    @property
    def count(self) -> int:
        """Number of signals."""
        return len(self._signals)

    @property
    def chosen(self) -> SignalState | None:
        """The selected signal."""
        return self._signals[self.cursor] if self.cursor < len(self._signals) else None

    def show(self, state: BusState, message: MessageState | None, plotted: list[str]) -> None:
        """Show a message; plotted signals are marked."""
        self._state, self._message, self._plotted = state, message, plotted
        name = None if message is None else message.name
        self._signals = [] if name is None else state.signals(name)
        self.refresh()

    def point_at(self, signal: str | None) -> None:
        """Select a signal by its name, or the first one for None."""
        names = [found.name for found in self._signals]
        self.cursor = names.index(signal) if signal in names else 0

    def action_close(self) -> None:
        """Go back to the table."""
        self.post_message(self.Closed())

    def render(self) -> Text:
        """Return the message and its signals; the last lines describe the selected one."""
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
