"""Shell completion shared by several commands."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem


def complete_messages(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Return the messages of the DBC whose names start with `incomplete`, in any case."""
    from rrins.dbc.codec import load

    begun = incomplete.upper()
    messages = sorted(load().database.messages, key=lambda message: message.name)
    return [
        CompletionItem(message.name, help=message.comment)
        for message in messages
        if message.name.startswith(begun)
    ]
