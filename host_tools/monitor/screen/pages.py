"""Pages that cover the whole screen: help, and the list of troubles."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import Screen

from host_tools.monitor.screen.panes import Lines

HELP = """\
KEYS
  Up Down PgUp PgDn Home End   point at a message, or a signal
  Enter    all signals of the message; Enter or Esc: back
  /        show what has this in the name of a message or signal; Esc: show all
           message.signal asks for both, such as axis.angle
  s        order: by identifier, name, rate, errors
  p        plot a signal, or no longer; of a message the first that has a unit
  w        what the plots cover: 1, 10 or 100 minutes
  f        freeze what is shown; frames are still taken; f again goes on
  t        all troubles, one by one
  z        set the monitor's counts, min, max and plots to nothing
  q        quit (Ctrl-C as well)

COLUMNS
  !        silent, an error lately, or the last frame has a wrong CRC
  rate/s   frames a second; "silent" after five periods without one
  age      since the last frame
  errors   of those frames: lost, turn and crc together
  lost     frames that the alive counter shows to be missing
  turn     frames that came twice, late, or with the counter of another epoch
  crc      frames with a wrong CRC or length; their values are not shown

TIME
  Rates, ages, plots and load are in the bus's own time, in a rehearsal
  simulated time; × is bus time over time on the wall. Load counts bits, stuff
  bits included. "lately" is the last 2.5 s of bus time, or the time since the
  last picture of the screen where that is longer.
"""


class Page(Screen[None]):
    """Text on the whole screen, until a key closes it.

    Parameters
    ----------
    text : callable
        What to show; asked again while it is shown.
    """

    CSS = "Page Lines { width: 1fr; } Page VerticalScroll { scrollbar-size-vertical: 1; }"

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,enter,question_mark,t,backspace", "close", show=False)
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
        """Show what there is to show now."""
        text = self._ask()
        if text != self.lines.plain:
            self.lines.show(Text(text))

    def action_close(self) -> None:
        """Go back."""
        self.app.pop_screen()
