"""`rrins socketcand`: serve the embedded bus to socketcand clients."""

from __future__ import annotations

from typing import Literal

import click

from rrins.host_tools.cli.options import PORT, embedded_channel_option, option, timestamps_option
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
