"""Records a bus to a file, or to several in turn; the suffix selects the log format."""

from __future__ import annotations

import fcntl
import logging
import os
import threading
import time
from os.path import samestat
from pathlib import Path
from typing import IO, Literal

import can
import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.codec import load
from rrins.dbc.frame import FrameArray
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.message import messages_of
from rrins.host_tools.bus.pace import runs_ahead
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.errors import BusError
from rrins.host_tools.recording.blf_writer import BlfWriter
from rrins.host_tools.recording.earlier import keep_earlier, put_back
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import Writer, check_path, ending_of, open_writer
from rrins.host_tools.recording.mf4 import is_simulated
from rrins.host_tools.recording.note import Note, Part, path_beside, write_note
from rrins.host_tools.recording.sources import AnySource, EmbeddedSource, ManyAtOnce

__all__ = ["NAME", "RecordError", "Recorder", "check_path"]

NAME = "recorder"
"""Name of a recorder on the embedded bus."""

_PATIENCE_S = 1.0
_OPENING = 5000  # most frames held back until the first SYNC
_SIZE_EVERY = 128  # frames between checks of the size
_SYNC_PATIENCE = 4096  # frames past the size limit that a part waits for a SYNC to end at
_CUT_OFF = "cut off"
_log = logging.getLogger(__name__)


class _Claim:
    """Locks a file against other recorders; the lock ends with the process.

    Parameters
    ----------
    path : Path
        Created empty if it does not exist; an existing file is left as it is.

    Raises
    ------
    RecordError
        If another recorder is writing it.
    OSError
        If it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._was_there = path.exists()
        self._file = self._locked()

    def _locked(self) -> IO[bytes]:
        file = self._path.open("ab")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.close()
            raise RecordError(
                f"recording {self._path}: another recorder is writing it; name another file"
            ) from error
        except OSError as error:  # file system without locks
            _log.debug("recording %s: cannot be locked: %s", self._path, error)
        return file

    def renew(self) -> None:
        """Lock the file again if the writer has replaced it.

        Raises
        ------
        RecordError
            If another recorder locked it first.
        """
        if not self._path.exists() or not samestat(
            self._path.stat(), os.fstat(self._file.fileno())
        ):
            self._file.close()
            self._file = self._locked()

    def release(self) -> None:
        """Let others write the file."""
        self._file.close()

    def give_up(self) -> None:
        """Release the file, and remove it if it did not exist before."""
        if not self._was_there:
            self._path.unlink(missing_ok=True)
        self.release()


class _Parts:
    """The files of a recording, one after another."""

    def __init__(self, path: Path, rotate_bytes: int | None) -> None:
        self._path = path
        self._claim = _Claim(path)
        self._limit = rotate_bytes
        self._sync_id = load().frame_id("SYNC")
        self.kept: Path | None = None
        try:
            self.kept = keep_earlier(path)
            self._writer: Writer = open_writer(path)
            self._claim.renew()
        except BaseException:
            if self.kept is not None:
                put_back(path, self.kept)
            self._claim.give_up()
            raise
        self._frames = 0  # in this part
        self._beyond = 0
        self.parts = [Part(file=path.name)]

    def write(self, message: can.Message) -> bool:
        """Write a frame, in a new part if this one is full; return whether a part begins."""
        if self._limit is not None and self._is_full(message):
            self._turn_over()
        is_first = not self._frames
        if is_first:
            self.parts[-1].first_s = message.timestamp
        self._writer.on_message_received(message)
        self._frames += 1
        return is_first

    @property
    def takes_arrays(self) -> bool:
        """Whether frames can be written many at once."""
        return self._limit is None and isinstance(self._writer, BlfWriter)

    def write_frames(self, frames: FrameArray, time_s: Floats, channel: str) -> None:
        """Write frames many at once; the part has begun."""
        writer = self._writer
        assert isinstance(writer, BlfWriter)
        if writer.takes(frames):
            writer.on_frames(frames, time_s, channel)
        else:
            for k in range(len(frames)):
                for message in messages_of(frames[k : k + 1], float(time_s[k]), channel):
                    writer.on_message_received(message)
        self._frames += len(frames)

    def _is_full(self, message: can.Message) -> bool:
        if not self._beyond and self._frames % _SIZE_EVERY:
            return False
        if not self._beyond and self._writer.file_size() < (self._limit or 0):
            return False
        self._beyond += 1
        return message.arbitration_id == self._sync_id or self._beyond > _SYNC_PATIENCE

    def _turn_over(self) -> None:
        self._writer.stop()
        path = part_path(self._path, len(self.parts))
        self._writer = open_writer(path)
        path.touch()  # SQLite creates its file with the first frames; the note names it earlier
        self.parts.append(Part(file=path.name))
        self._frames = 0
        self._beyond = 0

    def stop(self) -> None:
        """Close the last part."""
        self._writer.stop()

    def release(self) -> None:
        """Let others write the file."""
        self._claim.release()


def waits_for_recorder(address: Address) -> bool:
    """Return whether the bus should wait for a recorder: the embedded one, unless in real time.

    Raises
    ------
    BusError
        If the bus cannot be opened or closes.
    """
    if not address.is_embedded:
        return False
    bus = open_bus(address, name=NAME, role="observer", host="never")
    assert isinstance(bus, RrinsBus)
    try:
        return runs_ahead(bus) is not False
    except can.CanError as error:
        raise BusError(f"bus {address}: {error}") from error
    finally:
        bus.shutdown()


def part_path(path: Path, number: int) -> Path:
    """Return the path of a part: `bus.log`, `bus.001.log`, `bus.002.log` and so on."""
    if number == 0:
        return path
    ending, is_packed = ending_of(path)
    tail = len(ending) + (3 if is_packed else 0)
    stem, ending = path.name[:-tail], path.name[-tail:]
    return path.with_name(f"{stem}.{number:03d}{ending}")


class Recorder:
    """A thread that writes all frames of a bus to a file, with an accompanying note.

    A recording that the file has is moved into the folder `previous` beside it.

    Frames that the firmware sends before the hardware opens the first epoch carry the firmware's
    own time; they are stamped with the time of the first SYNC, so that time never goes backwards.

    Parameters
    ----------
    path : Path
        Its suffix selects the format: .log (candump), .asc, .blf, .mf4, .csv, .trc, .db, .txt.
    address : Address
    lossless : bool
        On the embedded bus: whether the bus waits for the recorder (a `node`) or disconnects it
        when it falls behind (an `observer`), as a real-time run requires. See `waits_for_recorder`.
    note : Note, optional
        What is known about the run.
    rotate_bytes : int, optional
        Size after which a part ends, at the next SYNC.
    limit_s : float, optional
        Time after the first frame at which recording stops.
    timestamps : {"bus", "unix"}
        Time of the frames of the embedded bus, as of `RrinsBus`.

    Raises
    ------
    RecordError
        If the file cannot be written, another recorder is writing it, or its suffix is unknown.
    BusError
        If the bus cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        address: Address,
        lossless: bool,
        note: Note | None = None,
        rotate_bytes: int | None = None,
        limit_s: float | None = None,
        timestamps: Literal["bus", "unix"] = "bus",
    ) -> None:
        self._path = path
        self._limit_s = limit_s
        self._stop = threading.Event()
        self._until = 0.0
        self._address = address
        check_path(path)
        role = "node" if lossless else "observer"
        options = (
            {"name": NAME, "role": role, "host": "never", "timestamps": timestamps}
            if address.is_embedded
            else {}
        )
        self._bus = open_bus(address, **options)
        in_lockstep = note is not None and note.is_lockstep
        self._source: EmbeddedSource | AnySource = AnySource(self._bus)
        if isinstance(self._bus, RrinsBus):
            self._source = EmbeddedSource(self._bus, address.channel, in_lockstep)
        self.note = note or Note(interface=address.interface, channel=address.channel)
        try:
            self._parts = _Parts(path, rotate_bytes)
            path_beside(path).unlink(missing_ok=True)  # left by an earlier recording
        except (RecordError, OSError) as error:
            self._bus.shutdown()
            if isinstance(error, RecordError):
                raise
            raise RecordError(f"recording {path}: {error}") from error
        self._opening: list[can.Message] | None = [] if address.is_embedded else None
        self._many: ManyAtOnce | None = None
        has_arrays = self._parts.takes_arrays and limit_s is None
        if has_arrays and isinstance(self._source, EmbeddedSource):
            self._many = ManyAtOnce(self._source, self._write_frames)
        self._sync_id = load().frame_id("SYNC")
        self.frames = 0
        self.first_s: float | None = None
        """Time of the first frame."""
        self.last_s = 0.0
        """Time of the last frame."""
        self.failure: str | None = None
        """Why the recording ended before the bus did; None if it did not."""
        self.has_ended = threading.Event()
        """Set once nothing more is written: the bus closed, the time is up, or writing failed."""
        self._thread = threading.Thread(target=self._run, name=NAME, daemon=True)
        self._thread.start()

    @property
    def kept_words(self) -> str | None:
        """Line about the recording that was there before; None if there was none."""
        kept = self._parts.kept
        return None if kept is None else f"the recording that was {self._path} is kept in {kept}"

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last."""
        return 0.0 if self.first_s is None else self.last_s - self.first_s

    def _run(self) -> None:
        """Write incoming frames; keep receiving if the file fails, so that the bus never waits."""
        try:
            while True:
                if self._opening is None and self._many is not None:
                    came = self._many.receive()
                else:
                    came = self._source.receive()
                if self._stop.is_set() and (came is None or time.monotonic() > self._until):
                    return
                for message in came or ():
                    self._record(message)
        except can.CanError as error:
            _log.debug("recording %s: the bus closed: %s", self._path, error)
            if _CUT_OFF in str(error) and self.failure is None:
                self.failure = f"stopped after {self.frames} frames: {error}"
        finally:
            if self._many is not None:
                self._many.flush()
            for message in self._source.rest():
                self._record(message)
            self._open()
            self.has_ended.set()

    def _record(self, message: can.Message) -> None:
        if self._opening is None:
            self._write(message)
            return
        self._opening.append(message)
        if message.arbitration_id == self._sync_id or len(self._opening) == _OPENING:
            self._open()

    def _open(self) -> None:
        """Write the frames held back until the first SYNC, which comes last."""
        waited, self._opening = self._opening or [], None
        for message in waited:
            message.timestamp = min(message.timestamp, waited[-1].timestamp)
            self._write(message)

    def _write(self, message: can.Message) -> None:
        if self.has_ended.is_set():
            return
        if self.first_s is None:
            self.first_s = self.last_s = message.timestamp
        if self._address.is_embedded:  # late firmware frames carry the time of their epoch
            message.timestamp = max(message.timestamp, self.last_s)
        if self._limit_s is not None and message.timestamp - self.first_s > self._limit_s:
            self.has_ended.set()
            return
        self.last_s = message.timestamp
        try:
            begins_part = self._parts.write(message)
            self.frames += 1
            if begins_part:  # so that a killed recorder leaves a note of all its parts
                self._write_note()
        except Exception as error:  # noqa: BLE001 - third-party writers; the bus must not wait
            self.failure = f"stopped after {self.frames} frames: {error}"
            self.has_ended.set()

    def _write_frames(self, frames: FrameArray, time_s: Floats) -> None:
        if self.has_ended.is_set():
            return
        time_s = np.maximum.accumulate(np.maximum(time_s, self.last_s))  # as in `_write`
        self.last_s = float(time_s[-1])
        try:
            self._parts.write_frames(frames, time_s, self._address.channel)
            self.frames += len(frames)
        except Exception as error:  # noqa: BLE001 - as above
            self.failure = f"stopped after {self.frames} frames: {error}"
            self.has_ended.set()

    def _write_note(self) -> None:
        clock = "simulated" if is_simulated(self.first_s or 0.0) else "unix"
        known = {"time": clock, "frames": self.frames, "parts": tuple(self._parts.parts)}
        self.note = self.note.model_copy(update=known)
        try:
            write_note(self._path, self.note)
        except RecordError as error:
            self.failure = self.failure or f"its note: {error}"

    def close(self, patience_s: float = _PATIENCE_S) -> None:
        """Write the remaining frames and close file and bus.

        `patience_s` limits the wait on a bus that never falls silent.
        """
        self._until = time.monotonic() + patience_s
        self._stop.set()
        self._thread.join()
        try:
            self._parts.stop()
        except Exception as error:  # noqa: BLE001 - as above
            self.failure = self.failure or f"stopped after {self.frames} frames: {error}"
        if self.frames:
            self._write_note()
        self._parts.release()
        self._bus.shutdown()


def add_result(path: Path, note: Note, navigation_sha256: str | None) -> None:
    """Add the result of the navigation to the note of a recording.

    Raises
    ------
    RecordError
        If it cannot be written.
    """
    if path_beside(path).is_file():
        write_note(path, note.model_copy(update={"navigation_sha256": navigation_sha256}))
