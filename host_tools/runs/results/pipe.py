"""Reports of a side to the rehearsal that started it: one JSON object a line, over a pipe."""

from __future__ import annotations

import json
import logging
import os
import select
import sys

from rrins.host_tools.bus.channel import HostedError
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject


class ReportPipe:
    """The sending end.

    Parameters
    ----------
    fd : int or None
        File descriptor of a pipe; with None nothing is sent.
    """

    def __init__(self, fd: int | None) -> None:
        self._fd = fd

    def send(self, kind: str, **values: object) -> None:
        """Send one report.

        Raises
        ------
        BrokenPipeError
            When the rehearsal is gone.
        """
        if self._fd is not None:
            line = json.dumps({"kind": kind, **values}) + "\n"
            os.write(self._fd, line.encode())

    @property
    def is_read(self) -> bool:
        """Whether a rehearsal reads what is sent."""
        return self._fd is not None

    def check_read(self) -> None:
        """Check that a rehearsal that is to read what is sent still runs.

        Raises
        ------
        BrokenPipeError
            When it is gone.
        """
        if self._fd is not None:
            poller = select.poll()
            poller.register(self._fd, 0)  # of a pipe that nobody can read, the error comes anyway
            if poller.poll(0):
                raise BrokenPipeError("the rehearsal has ended")

    def note(self, side: str, text: str) -> None:
        """Tell the user something: through the rehearsal, or else on standard error."""
        if self._fd is None:
            print(f"rrins: {text}", file=sys.stderr, flush=True)
        else:
            self.send("note", side=side, text=text)

    def compiling(self, side: str, functions: int) -> None:
        """Tell that a side compiles, and how many functions it has begun."""
        if self._fd is not None:
            self.send("compiling", side=side, functions=functions)
        elif functions == 1:
            self.note(side, f"compiling the {side}; later starts load what is compiled now")

    def fail(self, side: str, error: RehearsalError) -> None:
        """Tell the rehearsal why a side fails."""
        is_hosted = isinstance(error, HostedError)
        self.send(
            "error",
            side=side,
            message=str(error),
            exit_status=error.exit_status,
            channel_is_hosted=is_hosted,
        )


class NoteHandler(logging.Handler):
    """Hands what is logged to the rehearsal, as notes."""

    def __init__(self, report: ReportPipe, side: str) -> None:
        super().__init__()
        self._report, self._side = report, side

    def emit(self, record: logging.LogRecord) -> None:
        """Send one note."""
        self._report.note(self._side, record.getMessage())


class ReportReader:
    """The receiving end: turns what a pipe brings into reports."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[JsonObject]:
        """Take bytes as they come; return the reports that are complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [json.loads(line) for line in lines if line]
