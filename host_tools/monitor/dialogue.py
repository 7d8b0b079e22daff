"""The diagnosis on a bus: what a tool asks and the computer answers, message by message.

What the messages mean is known to who reads them: an `Interpreter`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

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
    """Follows the diagnosis on a watched bus.

    Parameters
    ----------
    watch : Watch
    interpreter : Interpreter

    Attributes
    ----------
    spoken : deque of Spoken
        The last `MOST` messages.
    """

    def __init__(self, watch: Watch, interpreter: Interpreter) -> None:
        self.spoken: deque[Spoken] = deque(maxlen=MOST)
        self._watch = watch
        self._interpreter = interpreter
        self._seen = 0

    def look(self) -> list[Spoken]:
        """Return the messages since the last look."""
        frames, count = self._watch.diagnostic_frames(self._seen)
        missed = count - self._seen - len(frames)
        self._seen = count
        found = []
        if missed > 0:
            self._interpreter.forget()
            when_s = int(frames["time_ns"][0]) / 1e9
            words = f"{missed} frames were not seen: more than {DIAGNOSTIC} came at once"
            found.append(Spoken(when_s, "monitor", words, is_warning=True))
        for frame in frames:
            data = int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]
            time_s = int(frame["time_ns"]) / 1e9
            found += [
                Spoken(time_s, one.sender, one.text, one.is_warning)
                for one in self._interpreter.add(int(frame["can_id"]), data)
            ]
        self.spoken += found
        return found

    def page(self, width: int, height: int) -> str:
        """Return the last messages as lines of a screen."""
        if not self.spoken:
            return "No diagnosis so far."
        return "\n".join(clipped(one.line, width) for one in [*self.spoken][-height:])
