"""Signals of a log over time, decimated to a drawable size however long the log is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.codec import load
from rrins.dbc.frame import FrameArray
from rrins.host_tools.diag.trace import Message
from rrins.host_tools.logs.diagnosis import Diagnosis
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.signals import (
    Numbers,
    SignalOfMessage,
    has_its_length,
    name_of_identifier,
)

_MOST_CHANGES = 200_000


class Envelope:
    """A number over time: every value, or the minimum and maximum of equal-sized groups.

    Parameters
    ----------
    capacity : int
        At twice this many points, pairs are merged into their minimum and maximum.
    """

    def __init__(self, capacity: int = 8192) -> None:
        self._capacity = capacity
        self._time = np.zeros(0)
        self._low = np.zeros(0)
        self._high = np.zeros(0)
        self._each = 1
        self._rest_time = np.zeros(0)
        self._rest = np.zeros(0)

    def add(self, time_s: Floats, values: Numbers) -> None:
        """Take values in order of time."""
        time_s = np.concatenate([self._rest_time, time_s])
        numbers = np.concatenate([self._rest, values], dtype=np.float64)
        whole = len(numbers) // self._each * self._each
        self._rest_time, self._rest = time_s[whole:], numbers[whole:]
        groups = numbers[:whole].reshape(-1, self._each)
        self._time = np.concatenate([self._time, time_s[: whole : self._each]])
        self._low = np.concatenate([self._low, groups.min(axis=1)])
        self._high = np.concatenate([self._high, groups.max(axis=1)])
        while len(self._time) > 2 * self._capacity:
            self._halve()

    def _halve(self) -> None:
        whole = len(self._time) // 2 * 2
        if len(self._time) > whole:  # an odd point is merged with its neighbour
            self._low[whole - 1] = min(self._low[whole - 1], self._low[whole])
            self._high[whole - 1] = max(self._high[whole - 1], self._high[whole])
        self._time = self._time[:whole:2]
        self._low = self._low[:whole].reshape(-1, 2).min(axis=1)
        self._high = self._high[:whole].reshape(-1, 2).max(axis=1)
        self._each *= 2

    def line(self) -> tuple[Floats, Numbers]:
        """Return times and values of a line through all minima and maxima."""
        if len(self._rest):
            self._time = np.r_[self._time, self._rest_time[0]]
            self._low = np.r_[self._low, self._rest.min()]
            self._high = np.r_[self._high, self._rest.max()]
            self._rest_time = self._rest = np.zeros(0)
        if self._each == 1:
            return self._time, self._low
        return np.repeat(self._time, 2), np.stack([self._low, self._high], axis=1).ravel()


class Changes:
    """A piecewise constant value: the times of its changes, and the end."""

    def __init__(self) -> None:
        self._time: list[Floats] = []
        self._values: list[Numbers] = []
        self._last: float | None = None
        self._end_s = 0.0
        self._count = 0

    def add(self, time_s: Floats, values: Numbers) -> None:
        """Take values in order of time."""
        if not len(values):
            return
        differs = np.r_[self._last is None or values[0] != self._last, values[1:] != values[:-1]]
        if self._count < _MOST_CHANGES:
            self._time.append(time_s[differs])
            self._values.append(values[differs])
            self._count += int(np.count_nonzero(differs))
        self._last = values[-1]
        self._end_s = float(time_s[-1])

    def line(self) -> tuple[Floats, Numbers]:
        """Return the times of the changes and the values from then on, plus the last time."""
        if not self._time:
            return np.zeros(0), np.zeros(0)
        return (
            np.r_[np.concatenate(self._time), self._end_s],
            np.r_[np.concatenate(self._values), self._last],
        )


@dataclass
class Series:
    """A signal over time."""

    signal: SignalOfMessage
    kept: Envelope | Changes
    frames: int = 0

    @property
    def is_stepped(self) -> bool:
        """Whether the value is piecewise constant, as named values and integers are."""
        return isinstance(self.kept, Changes)


@dataclass
class Contents:
    """Contents of a log: its frames, by message or identifier, their times, and the diagnosis."""

    frames: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    messages: dict[str, int] = field(default_factory=dict)
    unknown: dict[int, int] = field(default_factory=dict)
    #: diagnostic messages, each with its time since the first frame
    diagnosis: list[tuple[float, Message]] = field(default_factory=list)

    def add(self, frames: FrameArray, time_s: Floats) -> None:
        """Count frames."""
        if not len(frames):
            return
        self.first_s = float(time_s[0]) if not self.frames else self.first_s
        self.last_s = float(time_s[-1])
        self.frames += len(frames)
        found, counts = np.unique(frames["can_id"], return_counts=True)
        for identifier, count in zip(found.tolist(), counts.tolist(), strict=True):
            name = name_of_identifier(identifier)
            if name is None:
                self.unknown[identifier] = self.unknown.get(identifier, 0) + count
            else:
                self.messages[name] = self.messages.get(name, 0) + count


def gather(
    log: Log,
    signals: Sequence[SignalOfMessage],
    from_s: float | None = None,
    to_s: float | None = None,
    on_progress: Callable[[int], None] = lambda position: None,
) -> tuple[list[Series], Contents]:
    """Read a log; return its signals over time since its first frame, and its contents.

    The contents include the diagnostic messages.

    `from_s` and `to_s` also count from the first frame. Frames of the wrong length are skipped.

    Raises
    ------
    RecordError
        If the log cannot be read.
    """
    series = [Series(s, Changes() if s.choices or s.is_whole else Envelope()) for s in signals]
    contents, diagnosis = Contents(), Diagnosis()
    codec = load()
    for piece in log.pieces():
        contents.add(piece.frames, piece.time_s)
        on_progress(log.position)
        time_s = piece.time_s - contents.first_s
        is_wanted = np.ones(len(piece), dtype=np.bool_)
        if from_s is not None:
            is_wanted &= time_s >= from_s
        if to_s is not None:
            is_wanted &= time_s <= to_s
        contents.diagnosis += [
            (float(time_s[k]), said) for k, said in diagnosis.messages(piece.frames) if is_wanted[k]
        ]
        frames, time_s = piece.frames[is_wanted], time_s[is_wanted]
        for one in series:
            message = codec.messages[codec.message_index(one.signal.message)]
            mine = frames["can_id"] == message["can_id"]
            mine[mine] = has_its_length(frames[mine], one.signal.message)
            mine &= one.signal.is_in(frames)
            if mine.any():
                one.kept.add(time_s[mine], one.signal.values(frames["data"][mine]))
                one.frames += int(np.count_nonzero(mine))
    return series, contents
