"""The command `rrins monitor`."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_messages
from rrins.host_tools.cli.options import (
    BIT_RATE,
    POSITIVE,
    Bus,
    Number,
    channel_option,
    flag,
    gathered,
    interface_option,
    option,
)
from rrins.host_tools.cli.output import print_results
from rrins.host_tools.monitor.opening import opening_screen
from rrins.host_tools.monitor.sort_orders import ORDERS

if TYPE_CHECKING:
    from rrins.host_tools.bus.address import Address
    from rrins.host_tools.monitor.dialogue import Dialogue
    from rrins.host_tools.monitor.watch import Watch

_ONCE_S = 2.0
_POLL_S = 0.05
_SWITCH_S = 0.0005
_NO_SCREEN = ("", "dumb", "unknown")


@click.command()
@gathered(
    "bus",
    Bus,
    interface_option,
    channel_option,
    option("--bitrate", "Bit rate of the bus, for the load computation.", BIT_RATE),
)
@option(
    "--filter needle",
    "Show only messages and signals whose name contains this.",
    None,
    "",
    show_default=False,
    shell_complete=complete_messages,
)
@option("--sort order", "Sort order.", ORDERS, "id")
@option(
    "--refresh refresh_hz",
    "Screen refreshes per second; choose fewer on a slow connection.",
    Number(0.2, 10),
    4,
)
@flag("--once", "Print the state once and exit.")
@flag("--json as_json", "Print the state once, as a JSON object.")
@option(
    "--for for_s",
    f"Watch for this many seconds, then print once.  [default: {_ONCE_S:g}]",
    POSITIVE,
)
def monitor(
    bus: Bus,
    needle: str,
    order: str,
    refresh_hz: float,
    once: bool,
    as_json: bool,
    for_s: float | None,
) -> None:
    """Watch a bus: decoded messages with rates and ages, bus load, mode, faults.

    The monitor only listens and never delays the embedded bus. Without a terminal it prints the
    state once. Press ? for the keys.
    """
    is_once = once or as_json or for_s is not None
    if is_once or not _has_screen():
        _print_once(*_watch(bus), needle, order, as_json, for_s or _ONCE_S)
        return
    with opening_screen(f"rrins monitor: connecting to {bus} …  Ctrl-C stops") as hand_over:
        address, watch, dialogue = _watch(bus)
        from rrins.host_tools.monitor.screen.app import run_screen

        # Frames must be received while the same interpreter draws the screen.
        sys.setswitchinterval(_SWITCH_S)
        run_screen(address, watch, needle, order, refresh_hz, hand_over, dialogue)


def _watch(bus: Bus) -> tuple[Address, Watch, Dialogue]:
    """Return the bus, what collects its frames and its diagnosis; loading that takes seconds."""
    from rrins.host_tools.diag.trace import Trace
    from rrins.host_tools.monitor.dialogue import Dialogue
    from rrins.host_tools.monitor.watch import Watch
    from rrins.host_tools.xcp.trace import MeasuredData

    address = bus.address()
    watch = Watch(bus.bitrate, is_wall_time=not address.is_embedded)
    return address, watch, Dialogue(watch, Trace(), MeasuredData())


def _has_screen() -> bool:
    """Return whether there is a terminal that can show the screen."""
    is_terminal = sys.stdin.isatty() and sys.stdout.isatty()
    return is_terminal and os.environ.get("TERM", "") not in _NO_SCREEN


def _print_once(
    address: Address,
    watch: Watch,
    dialogue: Dialogue,
    needle: str,
    order: str,
    as_json: bool,
    for_s: float,
) -> None:
    from rrins.host_tools.monitor.estimates import Estimates
    from rrins.host_tools.monitor.once import as_dict, table_of
    from rrins.host_tools.monitor.receiver import Receiver

    receiver, estimates = Receiver(address, watch), Estimates()
    try:
        until_s = time.monotonic() + for_s
        while time.monotonic() < until_s and not watch.has_ended:
            time.sleep(_POLL_S)
            estimates.note(watch.state())
            dialogue.look()
        state = watch.state()
        dialogue.look()
    finally:
        receiver.close()
    where = str(address)
    values = as_dict(where, state, needle, order, estimates, dialogue) if as_json else {}
    print_results(as_json, values, table_of(where, state, needle, order, dialogue))
