"""Output shared by the commands."""

from __future__ import annotations

import click


def print_note(text: str) -> None:
    """Print a note to standard error, separate from the results."""
    click.echo(f"rrins: {text}", err=True)
