"""The terminal screen."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from typing import ClassVar

from rich.text import Text
from textual import events
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import Input

from rrins.host_tools.bus.address import Address
from rrins.host_tools.monitor.banner import banner, notices
from rrins.host_tools.monitor.dialogue import Dialogue
from rrins.host_tools.monitor.estimates import Estimates
from rrins.host_tools.monitor.listing import message_rows
from rrins.host_tools.monitor.plot import HEIGHT as PLOT_HEIGHT
from rrins.host_tools.monitor.plot import SPANS, plot
from rrins.host_tools.monitor.receiver import Receiver
from rrins.host_tools.monitor.redundancy import redundancy_page
from rrins.host_tools.monitor.screen.pages import HELP, Page
from rrins.host_tools.monitor.screen.panes import Detail, Lines, MessageTable
from rrins.host_tools.monitor.sort_orders import ORDERS
from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.troubles import troubles_of
from rrins.host_tools.monitor.vitals import vitals_of
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.monitor.wording import clipped

_THEMES = ("textual-ansi", "ansi-dark")  # the terminal's own colours; the name in older textual
_BOTH_HEIGHT = 34  # minimum lines to show table and detail together
_MOST_PLOTS = 4
_TABLE_KEYS = "? help  / filter  s sort  Enter detail  p plot  f freeze  t troubles  q quit"
_DETAIL_KEYS = "? help  Esc back  p plot  w span of plots  f freeze  t troubles  q quit"
_FILTER_KEYS = "Enter apply filter  Esc show all"


class MonitorApp(App[None]):
    """The screen.

    Parameters
    ----------
    bus : str
        Name of the bus.
    watch : Watch
    needle : str
        Filter for messages or signals, see `rrins.host_tools.monitor.listing`.
    order : str
        One of `ORDERS`.
    refresh_hz : float
        Refreshes per second; 0 refreshes only when `look` is called.
    dialogue : Dialogue, optional
        Diagnosis and measured data on the bus.
    """

    TITLE = "rrins monitor"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #banner { height: 7; }
    #notice { height: 1; text-style: reverse; display: none; }
    #filter { height: 1; display: none; }
    #filter Lines { width: 8; }
    #filter Input { border: none; height: 1; padding: 0; width: 1fr; }
    #detail { display: none; }
    #plots { display: none; }
    #keys { height: 1; text-style: reverse; }
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("question_mark", "help", show=False),
        Binding("slash", "filter", show=False),
        Binding("s", "sort", show=False),
        Binding("p", "plot", show=False),
        Binding("w", "span", show=False),
        Binding("f", "freeze", show=False),
        Binding("t", "troubles", show=False),
        Binding("r", "redundancy", show=False),
        Binding("e", "estimator", show=False),
        Binding("d", "diagnosis", show=False),
        Binding("x", "measured", show=False),
        Binding("z", "zero", show=False),
        Binding("q", "quit", show=False),
        Binding("ctrl+c", "quit", show=False, priority=True),
    ]

    def __init__(
        self,
        bus: str,
        watch: Watch,
        needle: str = "",
        order: str = "id",
        refresh_hz: float = 4.0,
        dialogue: Dialogue | None = None,
    ) -> None:
        super().__init__(ansi_color=True)
        self._bus = bus
        self._watch = watch
        self._needle = needle
        self._order = order
        self._refresh_hz = refresh_hz
        self._frozen = False
        self._level = 0
        self._estimates = Estimates()
        self._dialogue = dialogue
        self._plots: list[tuple[str, str]] = []
        self._state = watch.state()
        self._troubles: list[str] = []
        self.banner = Lines("banner")
        self.notice = Lines("notice")
        self.table = MessageTable()
        self.detail = Detail()
        self.plots = Lines("plots")
        self.input = Input()
        self.keys = Lines("keys")

    def compose(self) -> ComposeResult:
        """Lay out the screen."""
        yield self.banner
        yield self.notice
        yield self.table
        yield self.detail
        yield self.plots
        with Horizontal(id="filter"):
            label = Lines("label")
            label.show(Text("filter: "))
            yield label
            yield self.input
        yield self.keys

    def on_mount(self) -> None:
        """Set up the screen and start refreshing."""
        self.theme = next(theme for theme in _THEMES if theme in self.available_themes)
        self.table.focus()
        self.input.value = self._needle
        self.query_one("#filter").display = bool(self._needle)
        if not self.is_headless:
            loop = asyncio.get_running_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, self.exit)
        if self._refresh_hz:
            self.set_interval(1 / self._refresh_hz, self.look)
        self.call_after_refresh(self.look)

    def on_resize(self) -> None:
        """Adapt to the new size."""
        self._arrange()
        self.call_after_refresh(self._show)

    # ---- what is shown

    def look(self) -> None:
        """Take a snapshot of the bus and show it."""
        if not self._frozen:
            self._state = self._watch.state()
            self._estimates.note(self._state)
            if self._dialogue is not None:
                self._dialogue.look()
        self._show()

    def _show(self) -> None:
        state = self._state
        vitals = vitals_of(state)
        self._troubles = troubles_of(state, vitals)
        width = self.size.width
        self.banner.show(banner(self._bus, state, vitals, self._troubles, width))
        notice = "; ".join(notices(state, self._frozen))
        self.notice.display = bool(notice)
        self.notice.show(Text(clipped(notice, width).ljust(width), no_wrap=True))
        rows = message_rows(state, self._needle, self._order)
        self.table.show(state, rows, self._order)
        self._show_detail(state)
        self._show_plots(state)
        self._show_keys()

    def _show_detail(self, state: BusState) -> None:
        row = self.table.chosen
        if not self.detail.display:
            return
        if row is None:
            self._close_detail()
            return
        plotted = [signal for message, signal in self._plots if message == row.message.name]
        self.detail.show(state, row.message, plotted)

    def _show_plots(self, state: BusState) -> None:
        room = max(1, min(_MOST_PLOTS, (self.size.height - 16) // PLOT_HEIGHT))
        shown = self._plots[-room:]
        self.plots.display = bool(shown)
        pictures = [
            plot(state, message, signal, self._level, self.size.width) for message, signal in shown
        ]
        self.plots.show(Text("\n").join(pictures))

    def _show_keys(self) -> None:
        words = _TABLE_KEYS
        if self.focused is self.input:
            words = _FILTER_KEYS
        elif self.focused is self.detail:
            words = _DETAIL_KEYS
        width = self.size.width
        self.keys.show(Text(clipped(f" {words}", width).ljust(width), no_wrap=True))

    def _arrange(self) -> None:
        """Show table and detail together if there is room for both."""
        both = self.size.height >= _BOTH_HEIGHT
        self.table.display = both or not self.detail.display

    # ---- keys

    def action_help(self) -> None:
        """Show what the keys do."""
        self.push_screen(Page(lambda: HELP))

    def action_troubles(self) -> None:
        """Show all troubles."""
        self.push_screen(Page(self._trouble_words))

    def _trouble_words(self) -> str:
        if not self._troubles:
            return "NO TROUBLES"
        listed = "\n".join(f"  {trouble}" for trouble in self._troubles)
        return f"TROUBLES {len(self._troubles)}\n{listed}"

    def action_redundancy(self) -> None:
        """Show what is known of redundant sensors."""
        width = self.size.width
        self.push_screen(Page(lambda: redundancy_page(self._state, self._level, width)))

    def action_estimator(self) -> None:
        """Show what the estimator knows, by what it is aided, and what it found of the sensors."""
        width = self.size.width
        self.push_screen(Page(lambda: self._estimates.page(self._state, self._level, width)))

    def action_diagnosis(self) -> None:
        """Show what a diagnostic tool and the computer say."""
        dialogue = self._dialogue
        if dialogue is not None:
            self.push_screen(Page(lambda: dialogue.page(self.size.width, self.size.height - 2)))

    def action_measured(self) -> None:
        """Show the signals that a tool measures by XCP."""
        dialogue = self._dialogue
        if dialogue is not None:
            self.push_screen(Page(lambda: dialogue.measured_page(self.size.width)))

    def action_freeze(self) -> None:
        """Freeze the screen, or resume."""
        self._frozen = not self._frozen
        self.look()

    def action_sort(self) -> None:
        """Switch to the next sort order."""
        self._order = ORDERS[(ORDERS.index(self._order) + 1) % len(ORDERS)]
        self._show()

    def action_span(self) -> None:
        """Switch the time span of the plots."""
        self._level = (self._level + 1) % len(SPANS)
        self._show()

    def action_zero(self) -> None:
        """Reset the counts."""
        self._watch.reset_counts()
        self.look()

    def action_plot(self) -> None:
        """Plot a signal, or stop plotting it."""
        row = self.table.chosen
        if row is None or row.message.name is None or not row.signals:
            return
        described = [self._state.signal(row.message.name, name) for name in row.signals]
        chosen = next((signal for signal in described if signal.unit), described[0])
        if self.focused is self.detail and self.detail.chosen is not None:
            chosen = self.detail.chosen
        plotted = (row.message.name, chosen.name)
        if plotted in self._plots:
            self._plots.remove(plotted)
        else:
            self._plots = [*self._plots, plotted][-_MOST_PLOTS:]
        self._show()

    # ---- detail

    def on_message_table_opened(self) -> None:
        """Show the selected message."""
        row = self.table.chosen
        self.detail.display = True
        self._arrange()
        self._show_detail(self._state)
        if row is not None:
            self.detail.point_at(row.signals[0] if row.signals else None)
        self.detail.focus()
        self.call_after_refresh(self._show)

    def on_detail_closed(self) -> None:
        """Go back to the table."""
        self._close_detail()
        self.call_after_refresh(self._show)

    def _close_detail(self) -> None:
        self.detail.display = False
        self._arrange()
        self.table.focus()

    # ---- filter

    def action_filter(self) -> None:
        """Edit the filter."""
        self.query_one("#filter").display = True
        self.input.focus()
        self.call_after_refresh(self._show)

    def on_paste(self, event: events.Paste) -> None:
        """Take pasted text as the filter, not as keys; the filter's own field takes it itself."""
        lines = event.text.strip().splitlines()
        if lines and len(self.screen_stack) == 1:
            self.action_filter()
            self.input.value = lines[0]
            self.input.cursor_position = len(lines[0])

    def on_input_changed(self, event: Input.Changed) -> None:
        """Apply the filter while it is being typed."""
        self._needle = event.value
        self._show()

    def on_input_submitted(self) -> None:
        """Keep the filter."""
        self._leave_filter()

    def on_key(self, event: object) -> None:
        """Clear the filter on Escape and show all."""
        if getattr(event, "key", "") == "escape" and self.focused in (self.input, self.table):
            self.input.value = ""
            self._needle = ""
            self._leave_filter()

    def _leave_filter(self) -> None:
        self.query_one("#filter").display = bool(self._needle)
        self.table.display = True
        self._arrange()
        (self.detail if self.detail.display else self.table).focus()
        self.call_after_refresh(self._show)


def has_colours() -> bool:
    """Return whether the terminal has colours, as far as the system knows."""
    try:
        import curses

        curses.setupterm(fd=sys.__stdout__.fileno() if sys.__stdout__ else 1)
        return curses.tigetnum("colors") > 0
    except (ImportError, OSError, ValueError):
        return True
    except curses.error:  # unknown terminal: assume it has
        return True


def run_screen(
    address: Address,
    watch: Watch,
    needle: str,
    order: str,
    refresh_hz: float,
    hand_over: Callable[[], None],
    dialogue: Dialogue | None = None,
) -> None:
    """Show the screen until the user quits it; `hand_over` is called when it takes the terminal.

    Raises
    ------
    BusError
        If the bus cannot be opened.
    """
    if not has_colours():
        os.environ["NO_COLOR"] = "1"
    receiver = Receiver(address, watch)
    try:
        app = MonitorApp(str(address), watch, needle, order, refresh_hz, dialogue)
        hand_over()
        app.run(mouse=False)
    finally:
        receiver.close()
    if app.return_code:
        sys.exit(app.return_code)
