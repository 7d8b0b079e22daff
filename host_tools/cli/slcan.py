"""`rrins slcan`: the embedded bus behind an emulated slcan adapter."""

from __future__ import annotations

from pathlib import Path

import click

from rrins.host_tools.interruption import heed_sigterm


@click.command()
@click.option("--channel", default="rrins0", show_default=True, help="Channel of the embedded bus.")
@click.option(
    "--link",
    type=click.Path(path_type=Path),
    help="Symbolic link to the pseudo-terminal, for a name that stays the same.",
)
def slcan(channel: str, link: Path | None) -> None:
    """Serve the embedded bus as a serial CAN adapter (slcan, LAWICEL) on a pseudo-terminal.

    For programs with a fixed list of interfaces: open the port it prints, at any baud rate and bit
    rate. One program at a time; start one for each. It ends with the bus or on Ctrl-C.
    """
    from rrins.host_tools.bridges.slcan_bus import serve

    def on_ready(port: str) -> None:
        click.echo(
            f"rrins: channel {channel!r} is an slcan adapter on {port}; Ctrl-C stops", err=True
        )

    def on_end(lost: int) -> None:
        if lost:
            click.echo(f"rrins: {lost} frames were lost: the program read too slowly", err=True)

    heed_sigterm()
    click.echo(f"rrins: {serve(channel, link, on_ready=on_ready, on_end=on_end)}", err=True)
