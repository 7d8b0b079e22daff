"""Collects the frames of a bus and takes snapshots of its state."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rrins.compiled.record import Floats, Integers, Records, Words
from rrins.dbc.codec import Codec, load
from rrins.dbc.direct import Direct
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.bus.guard import NOTHING_REFUSED, Refused
from rrins.host_tools.monitor.state import WINDOW_NS, BusState, Mark, Times
from rrins.host_tools.monitor.tally import (
    DIAGNOSTIC,
    DiagnosticFrame,
    Tally,
    count_frames,
    count_timed_frames,
    count_waiting,
    head_of,
    reset_counts,
    tally_of,
)

_MARKS = 16
_MARK_STEP_NS = WINDOW_NS // 8
_SPEED_MARKS = 64
_SPEED_NS = 1_000_000_000  # shortest wall clock time over which the speed is taken


@dataclass(frozen=True)
class Latest:
    """The latest values of some signals."""

    now_ns: int  #: bus time
    heard_ns: int  #: wall clock time of the last frame
    busy_ns: int  #: for how long the wire was busy since the start
    #: shape (n,); in the units of the DBC; NaN for a signal that was not on the bus yet
    values: Floats
    changed_ns: Integers  #: shape (n,); bus time of the frame since which each has its value


class _Glance:
    """Reads a few values of a tally again and again: numpy finds a record's field but slowly."""

    def __init__(self, codec: Codec, tallies: Records[Tally]) -> None:
        self._now, self._busy = tallies["now_ns"], tallies["load"]["busy_ns"]
        signals = tallies["signals"][0]
        self._raw, self._low, self._high = (signals[name] for name in ("raw", "low", "high"))
        self._changed = signals["changed_ns"]
        self._valid = np.full(len(codec.signals), -1)  # the row that says so; -1: always
        for message in codec.database.messages:
            for signal in message.signals:
                flag = codec.valid_if(message.name, signal.name)
                if flag is not None:
                    row = codec.signal_index(message.name, signal.name)
                    self._valid[row] = codec.signal_index(message.name, flag)
        self._scale = codec.signals["scale"].copy()
        self._offset = codec.signals["offset"].copy()

    def at(self, rows: Integers, heard_ns: int) -> Latest:
        """Return the values of signals, by their rows in the codec's table."""
        values = self._raw[rows] * self._scale[rows] + self._offset[rows]
        values[self._low[rows] > self._high[rows]] = np.nan
        values[(self._valid[rows] >= 0) & (self._raw[self._valid[rows]] == 0)] = np.nan
        changed_ns = self._changed[rows]
        return Latest(int(self._now[0]), heard_ns, int(self._busy[0]), values, changed_ns)


class Watch:
    """Statistics of the frames of a bus.

    One thread may add frames while another takes snapshots.

    Parameters
    ----------
    bitrate : int, optional
        Bit rate of the wire, for its load; that of the DBC by default.
    is_wall_time : bool
        Whether bus time advances with the wall clock while nothing is sent, as on a real bus; else
        it stands still with the rehearsal.
    clock : callable
        The wall clock, ns.
    """

    def __init__(
        self,
        bitrate: int | None = None,
        is_wall_time: bool = False,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._codec = load()
        self._is_wall_time = is_wall_time
        self._clock = clock
        self._lock = threading.Lock()
        self._tallies = tally_of(self._codec, bitrate or self._codec.bits_per_s)
        self._glance = _Glance(self._codec, self._tallies)
        self._heard_ns = clock()
        self._ended: str | None = None
        self._refused = NOTHING_REFUSED
        self._gaps = 0
        self._clock_jumps = 0
        self._origin = self._mark_of(self._tallies[0])
        self._marks: deque[Mark] = deque(maxlen=_MARKS)
        self._speed_marks: deque[tuple[int, int]] = deque(maxlen=_SPEED_MARKS)
        count_frames(
            self._tallies.copy(), frame_array(1), 0, 0
        )  # compile now, not at the first frame

    def add_frames(self, frames: FrameArray, count: int, time_ns: int) -> None:
        """Add the first `count` frames of an array, sent at bus time `time_ns`."""
        with self._lock:
            count_frames(self._tallies, frames, count, time_ns)
            self._heard_ns = self._clock()

    def add_waiting(self, lent: Records[Direct], words: Words, frames: FrameArray) -> int:
        """Add the batches that wait at a socket, at most `MOST_AT_ONCE`; return how many.

        Parameters
        ----------
        lent : ndarray
            Array of one record: the socket.
        words : array, shape (rrins.dbc.direct.WORDS,)
            Holds what is left to Python.
        frames : FrameArray
            Scratch.
        """
        with self._lock:
            batches = count_waiting(self._tallies, lent, words, frames)
            if batches:
                self._heard_ns = self._clock()
        return batches

    def add_timed_frames(self, frames: FrameArray, times_ns: Integers) -> None:
        """Add the frames of a recording, in order of their times."""
        with self._lock:
            count_timed_frames(self._tallies, frames, times_ns)
            self._heard_ns = self._clock()

    def memory(self) -> Records[Tally]:
        """Return a copy of all that is known of the frames so far."""
        with self._lock:
            return self._tallies.copy()

    def restore(self, memory: Records[Tally]) -> None:
        """Go back, or ahead, to what `memory` returned."""
        with self._lock:
            self._tallies[:] = memory
            self._marks.clear()
            self._speed_marks.clear()
            self._origin = self._mark_of(self._tallies[0])

    def end(self, reason: str) -> None:
        """Record that the bus has ended, and why."""
        self._ended = reason

    @property
    def has_ended(self) -> bool:
        """Whether the bus has ended."""
        return self._ended is not None

    def note_refused(self, refused: Refused) -> None:
        """Record what the host of the bus has refused so far."""
        self._refused = refused

    def count_gap(self) -> None:
        """Record that frames were missed because the monitor fell behind."""
        self._gaps += 1

    def reset_counts(self) -> None:
        """Reset counts, smallest and largest values, and histories."""
        with self._lock:
            reset_counts(self._tallies)
            self._gaps = 0
            self._marks.clear()
            self._origin = self._mark_of(self._tallies[0])

    def latest(self, rows: Integers) -> Latest:
        """Return the latest values of some signals; quicker than a snapshot.

        Parameters
        ----------
        rows : array, shape (n,)
            Rows of the signals in the codec's table.

        """
        with self._lock:
            return self._glance.at(rows, self._heard_ns)

    def diagnostic_frames(self, since: int) -> tuple[Records[DiagnosticFrame], int]:
        """Return the diagnostic frames after the first `since`, and how many there were in all.

        Of more than `DIAGNOSTIC`, the last ones.
        """
        with self._lock:
            tally = self._tallies[0]
            count = int(tally["diagnostic_frames"])
            first = max(since, count - DIAGNOSTIC)
            return tally["diagnostic"][np.arange(first, count) % DIAGNOSTIC], count

    def state(self, has_histories: bool = True) -> BusState:
        """Return a snapshot; rates are taken since an earlier call, or the start.

        Parameters
        ----------
        has_histories : bool
            Whether `BusState.history` can be asked; a snapshot without takes half the time.
        """
        with self._lock:
            tally = (self._tallies.copy() if has_histories else head_of(self._tallies))[0]
            heard_ns = self._heard_ns
            wall_ns = self._clock()
        quiet_ns = max(0, wall_ns - heard_ns)
        bus_ns = int(tally["now_ns"])
        is_running_on = self._is_wall_time and tally["is_started"] and self._ended is None
        now_ns = bus_ns + quiet_ns if is_running_on else bus_ns
        speed = self._speed(bus_ns, wall_ns)
        times = Times(now_ns, quiet_ns / 1e9, speed, self._ended, self._gaps, self._refused)
        return BusState(self._codec, tally, self._mark_before(tally, now_ns), times)

    def _mark_of(self, tally: Tally) -> Mark:
        return Mark(
            int(tally["now_ns"]),
            int(tally["frames"]),
            int(tally["error_frames"]),
            int(tally["load"]["busy_ns"]),
            tally["entries"].copy(),
            tally["signals"]["raw"].copy(),
        )

    def _mark_before(self, tally: Tally, now_ns: int) -> Mark:
        """Return the newest mark at least a window old, or the oldest; mark this moment."""
        if int(tally["clock_jumps"]) != self._clock_jumps:
            self._clock_jumps = int(tally["clock_jumps"])
            self._marks.clear()
            self._speed_marks.clear()
            self._origin = self._mark_of(tally)
        origin = replace(self._origin, now_ns=int(tally["first_ns"]))
        chosen = self._marks[0] if len(self._marks) == _MARKS else origin
        for mark in self._marks:
            if now_ns - mark.now_ns >= WINDOW_NS:
                chosen = mark
        if not self._marks or now_ns - self._marks[-1].now_ns >= _MARK_STEP_NS:
            self._marks.append(replace(self._mark_of(tally), now_ns=now_ns))
        return chosen

    def _speed(self, bus_ns: int, wall_ns: int) -> float | None:
        """Return bus time over wall clock time; None on a bus that runs in wall clock time."""
        if self._is_wall_time or self._ended is not None:
            return None
        before = [mark for mark in self._speed_marks if wall_ns - mark[1] >= _SPEED_NS]
        if bus_ns:
            self._speed_marks.append((bus_ns, wall_ns))
        if not before:
            return None
        return (bus_ns - before[-1][0]) / (wall_ns - before[-1][1])
