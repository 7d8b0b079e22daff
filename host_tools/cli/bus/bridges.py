"""`rrins socketcand` and `rrins slcan`: serve the embedded bus to other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from rrins.host_tools.cli.options import (
    PATH,
    PORT,
    embedded_channel_option,
    option,
    timestamps_option,
)
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.interruption import heed_sigterm


@click.command()
@embedded_channel_option
@option("--port", "TCP port; 0 picks a free one.", PORT, 29536)
@option("--host", "Loopback address to listen on.", None, "127.0.0.1")
@timestamps_option
def socketcand(channel: str, port: int, host: str, timestamps: Literal["bus", "unix"]) -> None:
    """Serve the embedded bus to socketcand clients such as SavvyCAN.

    Anyone on this machine can connect while it runs; a beacon on UDP port 42000 shows them where.
    It ends with the bus or on Ctrl-C.
    """
    from rrins.host_tools.bridges.socketcand import serve

    def on_ready(taken: int) -> None:
        print_note(f"channel {channel!r} is on {host} port {taken}; Ctrl-C stops")

    heed_sigterm()
    print_note(serve(channel, host, port, timestamps=timestamps, on_ready=on_ready))


@click.command()
@embedded_channel_option
@option("--link", "Symbolic link to the pseudo-terminal, for a name that stays the same.", PATH)
def slcan(channel: str, link: Path | None) -> None:
    """Serve the embedded bus as a serial CAN adapter (slcan, LAWICEL) on a pseudo-terminal.

    For programs with a fixed list of interfaces: open the port it prints, at any baud rate and bit
    rate. One program at a time; start one for each. It ends with the bus or on Ctrl-C.
    """
    from rrins.host_tools.bridges.slcan_bus import serve

    def on_ready(port: str) -> None:
        print_note(f"channel {channel!r} is an slcan adapter on {port}; Ctrl-C stops")

    def on_end(lost: int) -> None:
        if lost:
            print_note(f"{lost} frames were lost: the program read too slowly")

    heed_sigterm()
    print_note(serve(channel, link, on_ready=on_ready, on_end=on_end))
