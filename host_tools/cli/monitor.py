"""The command `rrins monitor`."""

from __future__ import annotations

import json
import os
import sys
import time
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_messages
from rrins.host_tools.cli.numbers import BIT_RATE, NumberRange
from rrins.host_tools.monitor.opening import opening_screen
from rrins.host_tools.monitor.sort_orders import ORDERS

if TYPE_CHECKING:
    from rrins.host_tools.bus.port import Address
    from rrins.host_tools.monitor.watch import Watch

DEFAULT_CHANNEL = "rrins0"

_EMBEDDED = "rrins"
_ONCE_S = 2.0
_POLL_S = 0.05
_SWITCH_S = 0.0005
_NO_SCREEN = ("", "dumb", "unknown")


@click.command()
@click.option(
    "--interface", default=_EMBEDDED, show_default=True, help="python-can interface name."
)
@click.option("--channel", help=f"Channel of the interface.  [default: {DEFAULT_CHANNEL}]")
@click.option("--bitrate", type=BIT_RATE, help="Bit rate of the bus, for the load computation.")
@click.option(
    "--filter",
    "needle",
    default="",
    help="Show only messages and signals whose name contains this.",
    shell_complete=complete_messages,
)
@click.option(
    "--sort",
    "order",
    type=click.Choice(ORDERS),
    default="id",
    show_default=True,
    help="Sort order.",
)
@click.option(
    "--refresh",
    "refresh_hz",
    type=NumberRange(0.2, 10),
    default=4,
    show_default=True,
    help="Screen refreshes per second; choose fewer on a slow connection.",
)
@click.option("--once", is_flag=True, help="Print the state once and exit.")
@click.option("--json", "as_json", is_flag=True, help="Print the state once, as a JSON object.")
@click.option(
    "--for",
    "for_s",
    type=NumberRange(min=0, min_open=True),
    help=f"Watch for this many seconds, then print once.  [default: {_ONCE_S:g}]",
)
def monitor(
    interface: str,
    channel: str | None,
    bitrate: int | None,
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
    if channel is None and interface == _EMBEDDED:
        channel = DEFAULT_CHANNEL
    is_once = once or as_json or for_s is not None
    if is_once or not _has_screen():
        address, watch = _watch(interface, channel, bitrate)
        _print_once(address, watch, needle, order, as_json, for_s or _ONCE_S)
        return
    name = interface if channel is None else f"{interface}:{channel}"
    with opening_screen(f"rrins monitor: connecting to {name} …  Ctrl-C stops") as hand_over:
        address, watch = _watch(interface, channel, bitrate)
        from rrins.host_tools.monitor.screen.app import run_screen

        # Frames must be received while the same interpreter draws the screen.
        sys.setswitchinterval(_SWITCH_S)
        run_screen(address, watch, needle, order, refresh_hz, hand_over)


def _watch(interface: str, channel: str | None, bitrate: int | None) -> tuple[Address, Watch]:
    """Return the bus and what collects its frames; loading that takes seconds."""
    from rrins.host_tools.monitor.watch import Watch
    from rrins.host_tools.runs.rehearsal import default_address

    address = default_address(interface, channel, bitrate)
    return address, Watch(bitrate, is_wall_time=not address.is_embedded)


def _has_screen() -> bool:
    """Return whether there is a terminal that can show the screen."""
    is_terminal = sys.stdin.isatty() and sys.stdout.isatty()
    return is_terminal and os.environ.get("TERM", "") not in _NO_SCREEN


def _print_once(
    address: Address, watch: Watch, needle: str, order: str, as_json: bool, for_s: float
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
        state = watch.state()
    finally:
        receiver.close()
    if as_json:
        click.echo(json.dumps(as_dict(str(address), state, needle, order, estimates)))
    else:
        click.echo("\n".join(table_of(str(address), state, needle, order)))
