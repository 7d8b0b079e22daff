"""`rrins diag shell`: the same commands at a prompt, in one session that is kept."""

from __future__ import annotations

import cmd
import contextlib
import shlex
import sys
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Self

import click
from click.shell_completion import ShellComplete

from firmware_py.diagnostics.access import Session
from host_tools.diag import show
from host_tools.diag.conversation import PRESENCE_S
from host_tools.diag.options import with_securing_tester
from host_tools.diag.tester import Tester
from host_tools.errors import BusError, RehearsalError
from host_tools.interruption import INTERRUPTED

_LEAVE = ("exit", "quit", "EOF")


class _Presence:
    """Keeps the session, and takes what comes, while nothing is asked.

    Where the bus waits for the tool there is nothing to do: its time stands still meanwhile.
    """

    def __init__(self, tester: Tester) -> None:
        self._tester = tester
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tester-present", daemon=True)

    def _run(self) -> None:
        while not self._end.wait(PRESENCE_S):
            try:
                self._tester.keep()
            except RehearsalError:
                return  # the next command will say so

    def __enter__(self) -> Self:
        if not self._tester.connection.keeps_pace:
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()


class Shell(cmd.Cmd):
    """A prompt.

    Parameters
    ----------
    tester : Tester
    commands : click.Group
        What can be typed.
    is_script : bool
        Whether the commands come from a file: the first that fails ends it.

    Attributes
    ----------
    exit_status : int
        Of the last command that failed.
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
        session = self._tester.session
        mark = "" if session == Session.DEFAULT else f" {session.name.lower()}"
        mark += " unlocked" if self._tester.is_unlocked else ""
        self.prompt = "" if self._is_script else f"{self._tester.connection.where}{mark}> "

    def emptyline(self) -> bool:
        """Do nothing."""
        return False

    def onecmd(self, line: str) -> bool:
        """Run a line; return whether it was the last one."""
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
        show.note(text)
        self.exit_status = exit_status
        return self._is_script

    def complete(self, text: str, state: int) -> str | None:  # type: ignore[override]
        """Return the state-th completion of what has been typed."""
        if state == 0:
            with contextlib.suppress(ImportError):
                import readline

                line = readline.get_line_buffer()[: readline.get_endidx()]
                self._matches = list(self.completions(line))
        return self._matches[state] if state < len(self._matches) else None

    def completions(self, line: str) -> Iterator[str]:
        """Yield the words that the last word of a line may become."""
        head, _, begun = line.rpartition(" ")
        complete = ShellComplete(self._commands, {"obj": self._tester}, "", "")
        for item in complete.get_completions(head.split(), begun):
            yield item.value if item.value.endswith("=") else f"{item.value} "


@click.command()
@with_securing_tester
def shell(tester: Tester) -> None:
    """Run commands at a prompt, in one session that is kept by TesterPresent.

    Commands are those of `rrins diag`, without these words and without the options of the bus.
    Lines may come from standard input as well: the first that fails ends the shell with its status.
    """
    from host_tools.diag.command import diag

    is_script = not sys.stdin.isatty()
    prompt = Shell(tester, diag, is_script)
    if not is_script:
        with contextlib.suppress(ImportError):
            import readline

            readline.set_completer_delims(" \t\n")
        prompt.intro = f"{tester.connection.where}: help, exit; Tab completes"
        if tester.connection.keeps_pace:
            prompt.intro += (
                "\nThe rehearsal is in lockstep: its time stands still while nothing is asked."
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
