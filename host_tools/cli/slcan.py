"""`rrins slcan`: the embedded bus behind an emulated slcan adapter."""

from __future__ import annotations

from pathlib import Path

import click

from rrins.host_tools.cli.options import PATH, embedded_channel_option, option
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.interruption import heed_sigterm


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
