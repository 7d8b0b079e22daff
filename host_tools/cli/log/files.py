"""Shared by the commands that read a log file. Heavy modules are imported only when used."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.options import PATH, option
from rrins.host_tools.cli.output import print_note

if TYPE_CHECKING:
    from rrins.host_tools.logs.reader import Log

_MOST_NAMED = 10  # channels in one line

log_argument = click.argument("log", metavar="FILE", type=PATH)
log_channel_option = option(
    "--log-channel", "Use only the frames of this channel of FILE.  [default: all]", metavar="NAME"
)


def print_reading(log: Log) -> None:
    """Print notes on a log that has been read: damage, skipped frames, mixed channels."""
    if log.damage is not None:
        print_note(f"{log.damage}; used what could be read")
    if log.passed_over:
        print_note(f"{log.path}: {log.passed_over} CAN FD frames were skipped")
    if log.is_mixed:
        named = [f"{name} ({count} frames)" for name, count in log.channels.items()]
        counts = ", ".join(named[:_MOST_NAMED])
        if len(named) > _MOST_NAMED:
            counts += f" and {len(named) - _MOST_NAMED} more"
        print_note(f"{log.path}: mixed channels: {counts}; select one with --log-channel")
