"""How the processes of both sides are started: as programs of their own, or as forks of a command.

A program of its own imports for most of a second before it does anything. A fork has what the
command has imported. Only a process with one thread is forked safely, which a command is and
somebody's notebook is not; so `rrins rehearse` forks, and whoever else rehearses starts programs.

Forks are made before it is known what they are to do, while the command has no other threads. They
share what programs would: standard output and standard error, the report pipe of each, the bus.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence

from rrins.compiled.compilation import IS_DISABLED
from rrins.compiled.compile_events import signals_deferred
from rrins.compiled.native import engine
from rrins.dbc.contract import load_contract
from rrins.host_tools.closing import Closing
from rrins.host_tools.interruption import INTERRUPTED

Command = Callable[[Sequence[str]], None]
"""Runs a command by the words behind `rrins`; raises SystemExit."""

_SIDES = 2
_LONGEST = 1 << 20  # bytes of a command line
_SIGNALS = {signal.SIGINT, signal.SIGTERM}


def start_program(words: Sequence[str], report_fd: int) -> subprocess.Popen[bytes]:
    """Start a side as a program, with a descriptor for its reports."""
    return subprocess.Popen(
        [sys.executable, "-m", "rrins", *words, "--report-fd", str(report_fd)],
        pass_fds=(report_fd,),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )


class Fork:
    """A fork of this process that waits for its words, with the methods of `subprocess.Popen`.

    Parameters
    ----------
    command : callable
        What it runs.
    """

    def __init__(self, command: Command) -> None:
        self._line, line = socket.socketpair()
        with line, _signals_blocked():
            self._process = multiprocessing.get_context("fork").Process(
                target=_wait_and_run, args=(line, self._line, command), daemon=True
            )
            self._process.start()

    def begin(self, words: Sequence[str], report_fd: int) -> None:
        """Have it run a side, with a descriptor for its reports."""
        with self._line, contextlib.suppress(BrokenPipeError):  # it has been killed
            socket.send_fds(self._line, [json.dumps(list(words)).encode()], [report_fd])

    def dismiss(self) -> None:
        """Let it end without having done anything."""
        self._line.close()
        self._process.join()

    @property
    def pid(self) -> int:
        """Number of the process."""
        assert self._process.pid is not None
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit status, or minus the signal that ended it; None while it runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        """Return the exit status; None while it runs."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; return the exit status.

        Raises
        ------
        subprocess.TimeoutExpired
            When it still runs after `timeout` seconds.
        """
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired("fork", timeout or 0.0)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Let no signal break a fork off before it can heed one; it unblocks them itself."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _wait_and_run(line: socket.socket, other_end: socket.socket, command: Command) -> None:
    """Run the side that is asked for; nothing, if the command that forked goes before it asks."""
    try:
        os.setsid()  # as a program's: Ctrl-C is for the command alone
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # until the side heeds it and reports its end
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        other_end.close()
        with line:
            data, (report_fd,), *_ = socket.recv_fds(line, _LONGEST, 1)
    except (ValueError, KeyboardInterrupt):  # no words and no descriptor, or SIGINT
        sys.exit(INTERRUPTED)
    words: list[str] = json.loads(data)
    command([*words, "--report-fd", str(report_fd)])


class Forks(Closing):
    """Forks for both sides, made at once; whoever asks for more gets programs.

    Parameters
    ----------
    command : callable or None
        Runs `rrins firmware` or `rrins hardware`. What these import, this process should have
        imported. None if the process is somebody else's, who forks it himself or not at all.
    """

    def __init__(self, command: Command | None) -> None:
        self._waiting: list[Fork] = []
        if command is not None and threading.active_count() == 1:
            _load_what_all_code_needs()
            self._waiting += [Fork(command) for _ in range(_SIDES)]

    def start(self, words: Sequence[str], report_fd: int) -> Fork | subprocess.Popen[bytes]:
        """Start a side, with a descriptor for its reports."""
        if not self._waiting:
            return start_program(words, report_fd)
        fork = self._waiting.pop(0)
        fork.begin(words, report_fd)
        return fork

    def close(self) -> None:
        """Dismiss what was not needed."""
        while self._waiting:
            self._waiting.pop().dismiss()


def _load_what_all_code_needs() -> None:
    """Load what compiled functions of either side need first: half of what a side would load."""
    with signals_deferred():
        if not IS_DISABLED:
            engine()
        load_contract()
