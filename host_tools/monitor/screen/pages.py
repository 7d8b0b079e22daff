"""Pages that cover the whole screen: help, troubles, redundancy, estimator, diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import Screen

from rrins.host_tools.monitor.screen.panes import Lines

HELP = """\
KEYS
  Up Down PgUp PgDn Home End   select a message or a signal
  Enter    show all signals of the message; Enter or Esc: back
  /        filter by the name of a message or signal; Esc: show all
           message.signal matches both, such as axis.angle; pasted text
           becomes the filter
  s        sort by identifier, name, rate or errors
  p        plot a signal, or stop; for a message, the first that has a unit
           Each column goes from its smallest to its largest value.
  w        time span of the plots: 1, 10 or 100 minutes
  f        freeze the screen, or resume; frames are still received
  t        list all troubles
  r        redundant sensors: how well they agree, which are left out
  e        estimator: σ, what aids it and what is rejected, sensors' errors
  d        diagnosis: what a tool asks and the computer answers, in words
  x        XCP: the signals that a tool measures, by name
  z        reset the monitor's counts, min, max and plots
  q        quit (or Ctrl-C)

COLUMNS
  !        silent, recent errors, or a wrong CRC in the last frame
  rate/s   frames per second; "silent" after five periods without one
  age      time since the last frame
  errors   sum of lost, turn and crc
  lost     missing frames, by the alive counter
  turn     frames that were repeated, late, or of another epoch
  crc      frames with a wrong CRC or length; their values are not shown

TIME
  Rates, ages, plots and load are in bus time, which is simulated time in a
  rehearsal; × is bus time divided by wall clock time. Load counts bits,
  including stuff bits. "recently" means the last 2.5 s of bus time, or the
  time since the last refresh if that is longer.
"""


class Page(Screen[None]):
    """Text on the whole screen, until a key closes it.

    Parameters
    ----------
    text : callable
        Returns the text to show; called again on each refresh.
    """

    CSS = "Page Lines { width: 1fr; } Page VerticalScroll { scrollbar-size-vertical: 1; }"

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,enter,question_mark,t,r,e,d,backspace", "close", show=False)
    ]

    def __init__(self, text: Callable[[], str]) -> None:
        super().__init__()
        self._ask = text
        self.lines = Lines("page")

    def compose(self) -> ComposeResult:
        """Lay out the page."""
        with VerticalScroll():
            yield self.lines
        hint = Lines("hint")
        hint.show(Text(" Esc back", style="reverse"))
        yield hint

    def on_mount(self) -> None:
        """Show the text and keep it up to date."""
        self.look()
        self.set_interval(0.5, self.look)

    def look(self) -> None:
        """Show the current text."""
        text = self._ask()
        if text != self.lines.plain:
            self.lines.show(Text(text))

    def action_close(self) -> None:
        """Go back."""
        self.app.pop_screen()
