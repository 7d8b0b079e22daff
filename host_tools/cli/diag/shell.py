"""`rrins diag shell`: the same commands at a prompt, in one persistent session."""

from __future__ import annotations

import cmd
import contextlib
import shlex
import sys
import threading
from collections.abc import Iterator
from typing import Self

import click
from click.shell_completion import ShellComplete

from rrins.firmware_py.diagnostics.access import Session
from rrins.host_tools.cli.diag.options import with_securing_tester
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.closing import Closing
from rrins.host_tools.diag.conversation import PRESENCE_S
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import BusError, RehearsalError
from rrins.host_tools.interruption import INTERRUPTED

_LEAVE = ("exit", "quit", "EOF")


class _Presence(Closing):
    """Keeps the session alive and drains the bus between commands.

    If the bus waits for the tool there is nothing to do: its time stands still between commands.
    """

    def __init__(self, tester: Tester) -> None:
        self._tester = tester
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tester-present", daemon=True)

    def _run(self) -> None:
        while not self._end.wait(PRESENCE_S):
            try:
                self._tester.conversation.keep()
            except RehearsalError:
                return  # the next command reports it

    def __enter__(self) -> Self:
        if not self._tester.conversation.connection.keeps_pace:
            self._thread.start()
        return self

    def close(self) -> None:
        """Stop keeping the session alive."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()


class Shell(cmd.Cmd):
    """An interactive prompt.

    Parameters
    ----------
    tester : Tester
    commands : click.Group
        The available commands.
    is_script : bool
        Whether the commands come from a file; the first failure then ends the shell.

    Attributes
    ----------
    exit_status : int
        Exit status of the last command that failed.
    """

    def __init__(self, tester: Tester, commands: click.Group, is_script: bool) -> None:
        super().__init__()
        self._tester = tester
        self._commands = commands
        self._is_script = is_script
        self.use_rawinput = not is_script
        self.exit_status = 0
        self._matches: list[str] = []
        self._show_session()

    def _show_session(self) -> None:
        conversation = self._tester.conversation
        session = conversation.session
        mark = "" if session == Session.DEFAULT else f" {session.name.lower()}"
        mark += " unlocked" if conversation.is_unlocked else ""
        self.prompt = "" if self._is_script else f"{conversation.connection.where}{mark}> "

    def emptyline(self) -> bool:
        """Do nothing."""
        return False

    def onecmd(self, line: str) -> bool:
        """Run a line; return whether the shell ends."""
        try:
            words = shlex.split(line, comments=True)
        except ValueError as error:
            return self._fail(f"{line}: {error}", click.UsageError.exit_code)
        if not words:
            return False
        if words[0] in _LEAVE:
            return True
        if words[0] == "help":
            words = [*words[1:], "--help"]
        is_last = self._run(words)
        self._show_session()
        return is_last

    def _run(self, words: list[str]) -> bool:
        try:
            self._commands.main(words, prog_name="", standalone_mode=False, obj=self._tester)
        except click.ClickException as error:
            return self._fail(error.format_message(), error.exit_code)
        except click.Abort:
            return self._fail("stopped", INTERRUPTED)
        except KeyboardInterrupt:
            return self._fail("stopped", INTERRUPTED)
        except BusError as error:
            self._fail(str(error), error.exit_status)
            return True
        except RehearsalError as error:
            return self._fail(str(error), error.exit_status)
        return False

    def _fail(self, text: str, exit_status: int) -> bool:
        print_note(text)
        self.exit_status = exit_status
        return self._is_script

    def complete(self, text: str, state: int) -> str | None:  # type: ignore[override]  # one by one
        """Return completion number `state` of the current line."""
        if state == 0:
            with contextlib.suppress(ImportError):
                import readline

                line = readline.get_line_buffer()[: readline.get_endidx()]
                self._matches = list(self.completions(line))
        return self._matches[state] if state < len(self._matches) else None

    def completions(self, line: str) -> Iterator[str]:
        """Yield the completions of the last word of a line."""
        head, _, begun = line.rpartition(" ")
        complete = ShellComplete(self._commands, {"obj": self._tester}, "", "")
        for item in complete.get_completions(head.split(), begun):
            yield item.value if item.value.endswith("=") else f"{item.value} "


@click.command()
@with_securing_tester
@click.pass_context
def shell(context: click.Context, tester: Tester) -> None:
    """Run commands at a prompt, in one session that is kept by TesterPresent.

    Type the commands of `rrins diag` without `rrins diag` and without the bus options. Commands can
    also come from standard input; the first that fails ends the shell with its exit status.
    """
    assert context.parent is not None
    commands = context.parent.command
    assert isinstance(commands, click.Group)
    is_script = not sys.stdin.isatty()
    prompt = Shell(tester, commands, is_script)
    if not is_script:
        with contextlib.suppress(ImportError):
            import readline

            readline.set_completer_delims(" \t\n")
        connection = tester.conversation.connection
        prompt.intro = f"{connection.where}: type help or exit; Tab completes"
        if connection.keeps_pace:
            prompt.intro += (
                "\nThe rehearsal is in lockstep: its time stands still between commands."
            )
    with _Presence(tester):
        while True:
            try:
                prompt.cmdloop()
                break
            except KeyboardInterrupt:
                prompt.intro = ""
                click.echo()
    if is_script and prompt.exit_status:
        raise click.exceptions.Exit(prompt.exit_status)
