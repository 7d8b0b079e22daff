"""The command `rrins`: the table of its commands, and how an error ends."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final, NoReturn

import click
from click.shell_completion import CompletionItem

from host_tools.errors import RehearsalError
from host_tools.interruption import INTERRUPTED

_GC_THRESHOLD = 50_000
"""Objects between two collections: a start makes hundreds of thousands that stay."""


@dataclass(frozen=True)
class _Entry:
    """A command: the module that has it, imported when it is asked for, and its line of help."""

    module: str
    line: str


_RUN = {
    "rehearse": _Entry("host_tools.commands", "Run both sides as two processes on one bus."),
    "simulate": _Entry("host_tools.commands", "Run both sides in one process, without a bus."),
    "firmware": _Entry("host_tools.commands", "Run the navigation computer alone."),
    "hardware": _Entry("host_tools.commands", "Run the emulated RIMU and turntable alone."),
    "inject": _Entry("host_tools.injection.command", "Put a fault into a rehearsal under way."),
    "scenarios": _Entry("host_tools.commands", "List the built-in scenarios; show one."),
    "bench": _Entry("host_tools.commands", "Measure what a rehearsal costs on this machine."),
}
_LOOK = {
    "monitor": _Entry("host_tools.monitor.command", "Watch a bus, decoded, on a screen."),
    "diag": _Entry("host_tools.diag.command", "Look into the navigation computer, by UDS."),
    "record": _Entry("host_tools.logs.command", "Record a bus to a log file."),
    "replay": _Entry("host_tools.logs.command", "Replay a log, or navigate it again."),
    "export": _Entry("host_tools.logs.command", "Write a log as Parquet or CSV tables."),
    "plot": _Entry("host_tools.logs.command", "Draw signals of a log over time."),
    "socketcand": _Entry("host_tools.commands", "Offer the embedded bus to socketcand clients."),
}
_PLAN = {
    "scheme": _Entry("host_tools.rotation.command", "Analyse and search rotation schemes."),
    "motion": _Entry("host_tools.motion.command", "Look at a vehicle's motion; write the truth."),
    "reproduce": _Entry("host_tools.experiments.command", "Run the paper's experiments."),
}
_SECTIONS: Final = {"Run": _RUN, "Look": _LOOK, "Plan": _PLAN}
_COMMANDS: Final = _RUN | _LOOK | _PLAN


class _Group(click.Group):
    """A group that imports a command when it is run, and ends a user's error in one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, imported from its module."""
        if cmd_name not in _COMMANDS:
            return None
        command = getattr(import_module(_COMMANDS[cmd_name].module), cmd_name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, a section for each purpose."""
        width = max(map(len, _COMMANDS))
        for title, entries in _SECTIONS.items():
            with formatter.section(title):
                rows = [(name.ljust(width), entry.line) for name, entry in entries.items()]
                formatter.write_dl(rows)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the commands that begin like this, and what else may stand there."""
        begun = [
            CompletionItem(name, help=entry.line)
            for name, entry in sorted(_COMMANDS.items())
            if name.startswith(incomplete)
        ]
        return begun + click.Command.shell_complete(self, ctx, incomplete)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except RehearsalError as error:
            _fail(str(error), error.exit_status)
        except KeyboardInterrupt:
            _fail("stopped by the user", INTERRUPTED)
        except _contract_errors() as error:
            _fail(str(error), RehearsalError.exit_status)


def _contract_errors() -> tuple[type[Exception], ...]:
    """Return what a DBC that cannot serve raises: nothing, unless the codec has been imported."""
    codec = sys.modules.get("dbc.codec")
    return () if codec is None else (codec.ContractError,)


def _fail(message: str, exit_status: int) -> NoReturn:
    """Say in one line what went wrong and end."""
    click.echo(f"rrins: {message}", err=True)
    sys.exit(exit_status)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rrins", prog_name="rrins")
def rrins() -> None:
    """Rehearse a redundant rotational inertial navigation system before its hardware exists.

    A firmware process navigates and turns the table; a hardware process produces the sensor
    frames; one CAN bus lies between them.
    """
    logging.basicConfig(format="rrins: %(message)s", level=logging.WARNING)


def _leave_out_asammdf(arguments: Sequence[str]) -> None:
    """Spare python-can asammdf, and pandas with it, unless a file of it is named.

    Wherever asammdf is installed, python-can imports it with itself, a third of all that a start
    imports. Formats go by a file's ending.
    """
    if not any(".mf4" in argument.lower() for argument in arguments):
        sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]


def main() -> None:
    """Run the command line."""
    gc.set_threshold(_GC_THRESHOLD)
    _leave_out_asammdf(sys.argv[1:])
    try:
        rrins(prog_name="rrins")
    finally:
        gc.freeze()  # the interpreter's last collections would take half a second
