"""Records a bus to a file in any log format that python-can knows by the file's ending."""

from __future__ import annotations

import logging
import sqlite3
import threading
from pathlib import Path
from typing import Any

import can
from can.io.logger import MESSAGE_WRITERS

from host_tools.errors import RehearsalError
from host_tools.port import Address, open_bus

NAME = "recorder"
"""What a recorder calls itself on the embedded bus."""

_POLL_S = 0.1
_log = logging.getLogger(__name__)


class RecordError(RehearsalError):
    """A recording that cannot be begun or went wrong."""

    exit_status = 6


class _SqliteWriter(can.SqliteWriter):
    """A writer whose thread does not fail unheard."""

    error: sqlite3.Error | None = None

    def _db_writer_thread(self) -> None:
        try:
            super()._db_writer_thread()
        except sqlite3.Error as error:
            self.error = error


def _open_writer(path: Path) -> Any:
    if path.suffix.lower() == ".db":
        return _SqliteWriter(path)
    return can.Logger(str(path))


class Recorder:
    """A thread that writes all frames of a bus to a file.

    Parameters
    ----------
    path : Path
        Its ending chooses the format: .log (candump), .asc, .blf, .csv, .trc, .txt, .db.
    address : Address
    lossless : bool
        On the embedded bus: whether the bus waits for the recorder (a `node`), or cuts it off when
        it falls behind (an `observer`), as a run in real time needs it.

    Raises
    ------
    RecordError
        When the file cannot be written or its ending is unknown.
    BusError
        When the bus cannot be opened.
    """

    def __init__(self, path: Path, address: Address, lossless: bool) -> None:
        self._path = path
        self._stop = threading.Event()
        wishes = (
            {"name": NAME, "role": "node" if lossless else "observer", "host": "never"}
            if address.is_embedded
            else {}
        )
        self._bus = open_bus(address, **wishes)
        try:
            self._writer = _open_writer(path)
        except (ValueError, OSError, ImportError, NotImplementedError) as error:
            self._bus.shutdown()
            raise RecordError(f"recording {path}: {error}") from error
        self.frames = 0
        self.failure: str | None = None
        """Why the recording ended before the bus did; None while all is well."""
        self._thread = threading.Thread(target=self._run, name=NAME, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        """Write what comes; go on receiving when the file fails, so that the bus never waits."""
        while True:
            try:
                message = self._bus.recv(_POLL_S)
            except can.CanError as error:
                _log.debug("recording %s: the bus ended: %s", self._path, error)
                return
            if message is None:
                if self._stop.is_set():
                    return
                continue
            if self.failure is None:
                self._write(message)

    def _write(self, message: can.Message) -> None:
        try:
            self._writer.on_message_received(message)
            self._check_thread()
            self.frames += 1
        except (OSError, ValueError) as error:
            self.failure = f"stopped after {self.frames} frames: {error}"

    def _check_thread(self) -> None:
        """Raise what has ended the thread of a writer that has one."""
        error = getattr(self._writer, "error", None)
        if error is not None:
            raise OSError(str(error))

    def close(self) -> None:
        """Write what is still to come, and close file and bus."""
        self._stop.set()
        self._thread.join()
        try:
            self._writer.stop()
            self._check_thread()
        except OSError as error:
            self.failure = self.failure or str(error)
        self._bus.shutdown()


def check_path(path: Path) -> None:
    """Raise `RecordError` unless a recording can be written to `path`."""
    suffix = path.suffix.lower()
    known = MESSAGE_WRITERS
    if suffix not in known:
        raise RecordError(f"recording {path}: the ending must be one of {' '.join(sorted(known))}")
    if not path.parent.is_dir():
        raise RecordError(f"recording {path}: there is no folder {path.parent}")
