"""Tools and the computer on a bus: diagnosis message by message, measured data by name.

What the frames mean is known to who reads them: an `Interpreter`, and `Measured` data's reader.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from rrins.host_tools.monitor.tally import DIAGNOSTIC
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.monitor.wording import clipped

MOST = 500
"""Messages that are kept."""


class Utterance(Protocol):
    """A message in words."""

    @property
    def sender(self) -> str:
        """Who sent it."""

    @property
    def text(self) -> str:
        """The message in words."""

    @property
    def is_warning(self) -> bool:
        """Whether it is a refusal, or incomplete."""


class Interpreter(Protocol):
    """Puts messages together from frames, and puts them in words."""

    def add(self, can_id: int, data: bytes) -> Sequence[Utterance]:
        """Take the next frame; return the messages that it completes."""

    def forget(self) -> None:
        """Forget what has begun: frames are missing."""


class MeasuredRow(NamedTuple):
    """The latest value of a measured signal."""

    name: str
    value: float
    words: str  #: the value for people
    unit: str
    comment: str

    @property
    def text(self) -> str:
        """The value with its unit."""
        return f"{self.words} {self.unit}".rstrip()


class Measured(Protocol):
    """Follows measured data."""

    def add(self, can_id: int, data: bytes) -> None:
        """Take the next frame."""

    def forget(self) -> None:
        """Forget what has begun: frames are missing."""

    @property
    def rows(self) -> Sequence[MeasuredRow]:
        """The latest value of each signal."""


@dataclass(frozen=True)
class Spoken:
    """A message, in words."""

    time_s: float  #: bus time of its last frame
    sender: str
    text: str
    is_warning: bool

    @property
    def line(self) -> str:
        """The message on one line."""
        return f"{self.time_s:10.3f}  {self.sender:>11}  {self.text}"


class Dialogue:
    """Follows diagnosis and measured data on a watched bus.

    Parameters
    ----------
    watch : Watch
    interpreter : Interpreter
    measured : Measured, optional

    Attributes
    ----------
    spoken : deque of Spoken
        The last `MOST` messages.
    """

    def __init__(
        self, watch: Watch, interpreter: Interpreter, measured: Measured | None = None
    ) -> None:
        self.spoken: deque[Spoken] = deque(maxlen=MOST)
        self._watch = watch
        self._interpreter = interpreter
        self._measured = measured
        self._seen = 0

    @property
    def measured(self) -> Sequence[MeasuredRow]:
        """The latest value of each measured signal."""
        return () if self._measured is None else self._measured.rows

    def memory(self) -> tuple[int, Measured | None]:
        """Return what `restore` needs to go back to this moment."""
        return self._seen, copy.deepcopy(self._measured)

    def restore(self, memory: tuple[int, Measured | None]) -> None:
        """Go back, or ahead, to what `memory` returned, as the watch has."""
        self._seen, self._measured = copy.deepcopy(memory)
        self._interpreter.forget()

    def look(self) -> list[Spoken]:
        """Return the messages since the last look."""
        frames, count = self._watch.diagnostic_frames(self._seen)
        missed = count - self._seen - len(frames)
        self._seen = count
        found = []
        if missed > 0:
            self._forget()
            when_s = int(frames["time_ns"][0]) / 1e9
            words = f"{missed} frames were not seen: more than {DIAGNOSTIC} came at once"
            found.append(Spoken(when_s, "monitor", words, is_warning=True))
        for can_id, length, word, time_ns in frames.tolist():
            data = word.to_bytes(8, "little")[:length]
            if self._measured is not None:
                self._measured.add(can_id, data)
            found += [
                Spoken(time_ns / 1e9, one.sender, one.text, one.is_warning)
                for one in self._interpreter.add(can_id, data)
            ]
        self.spoken += found
        return found

    def _forget(self) -> None:
        self._interpreter.forget()
        if self._measured is not None:
            self._measured.forget()

    def page(self, width: int, height: int) -> str:
        """Return the last messages as lines of a screen."""
        if not self.spoken:
            return "No diagnosis so far."
        return "\n".join(clipped(one.line, width) for one in [*self.spoken][-height:])

    def measured_page(self, width: int) -> str:
        """Return the measured signals as lines of a screen."""
        return "\n".join(clipped(line, width) for line in self.measured_lines()) or (
            "No signal is measured by XCP, or its list was set up before the monitor began."
        )

    def measured_lines(self) -> list[str]:
        """Return the measured signals, one a line."""
        rows = self.measured
        widest = max((len(row.name) for row in rows), default=0)
        return [f"{row.name:{widest}}  {row.text}" for row in rows]
