"""Groups of commands that say what a mistyped word may have meant."""

from __future__ import annotations

import difflib

import click

_WHOLE = 1000  # letters of a command's help; click cuts it at 45


class Group(click.Group):
    """A group of commands; a word that is none of them is answered with those most like it."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, each with the whole first sentence of its help."""
        with formatter.section("Commands"):
            names = self.list_commands(ctx)
            commands = [(name, self.get_command(ctx, name)) for name in names]
            formatter.write_dl(
                [(name, one.get_short_help_str(_WHOLE)) for name, one in commands if one]
            )

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the first word names, and the words behind it.

        Raises
        ------
        click.UsageError
            When there is no such command.
        """
        word, known = args[0], self.list_commands(ctx)
        is_option = word.startswith("-")
        if word in known or is_option or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        near = difflib.get_close_matches(word, known, 3)
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        raise click.UsageError(f"No such command {word!r}.{hint}", ctx)
