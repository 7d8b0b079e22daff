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


def complete_scenarios(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Return the built-in scenarios whose names start with `incomplete`; a file may be one, too."""
    from rrins.host_tools.scenario.scenario import names

    built_in = [CompletionItem(name) for name in names() if name.startswith(incomplete)]
    return [*built_in, CompletionItem(incomplete, type="file")]
