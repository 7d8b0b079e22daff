"""Options shared by several commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from rrins.host_tools.cli.numbers import BIT_RATE

Command = Callable[..., Any]
"""A function that click turns into a command."""

Option = Callable[[Command], Command]
"""A decorator that adds one or more options to a command."""


def together(*options: Option) -> Option:
    """Return one decorator that applies several, in order."""

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
timestamps_option = click.option(
    "--timestamps",
    type=click.Choice(["bus", "unix"]),
    default="bus",
    show_default=True,
    help="Time of frames of the embedded bus: simulated, or seconds since 1970.",
)
bus_options = together(
    click.option(
        "--interface", default="rrins", show_default=True, help="python-can interface name."
    ),
    click.option("--channel", help="Channel of the interface.  [default: rrins0]"),
    click.option("--bitrate", type=BIT_RATE, help="Bit rate, if the interface sets it."),
)
