"""`rrins socketcand`: serve the embedded bus to socketcand clients."""

from __future__ import annotations

from typing import Literal

import click

from rrins.host_tools.cli.options import timestamps_option
from rrins.host_tools.interruption import heed_sigterm


@click.command()
@click.option("--channel", default="rrins0", show_default=True, help="Channel of the embedded bus.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=29536,
    show_default=True,
    help="TCP port; 0 picks a free one.",
)
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Loopback address to listen on."
)
@timestamps_option
def socketcand(channel: str, port: int, host: str, timestamps: Literal["bus", "unix"]) -> None:
    """Serve the embedded bus to socketcand clients such as SavvyCAN.

    Anyone on this machine can connect while it runs; a beacon on UDP port 42000 shows them where.
    It ends with the bus or on Ctrl-C.
    """
    from rrins.host_tools.bridges.socketcand import serve

    def on_ready(taken: int) -> None:
        click.echo(f"rrins: channel {channel!r} is on {host} port {taken}; Ctrl-C stops", err=True)

    heed_sigterm()
    reason = serve(channel, host, port, timestamps=timestamps, on_ready=on_ready)
    click.echo(f"rrins: {reason}", err=True)
