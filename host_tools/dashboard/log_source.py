"""A recording as the source of the page: read whole, played back with a time line."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from rrins.compiled.record import Integers, Records
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.dashboard.errors import DashboardError
from rrins.host_tools.dashboard.page_orders import OF_RECORDING, Order
from rrins.host_tools.dashboard.source import described
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.files import JsonObject
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.monitor.dialogue import Measured
from rrins.host_tools.monitor.state import WINDOW_NS
from rrins.host_tools.monitor.tally import DIAGNOSTIC, Tally
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.scenario.scenario import Scenario

MOST_FRAMES: Final = 30_000_000
"""Frames of a recording that can be played back; 1 GB of memory."""

_STEPS: Final = 6000  # of the history
_LEAST_STEP_S: Final = 1 / 30
_MARK_EVERY: Final = 300  # steps between two copies of the tally, to seek from
_TROUBLES_EVERY: Final = 15  # steps between two looks for troubles
_YEARS_S: Final = 1e8  # times beyond this are dates
_FASTEST: Final = 200.0

_Mark = tuple[int, Records[Tally], tuple[int, Measured | None]]  # frames so far, and memories then


class LogSource:
    """A recording.

    Parameters
    ----------
    path : Path
    channel : str or None
        The only channel to read.
    scenario : Scenario or None
        What was recorded; that of the note by default.
    on_progress : callable
        Called with the bytes read so far.
    speed : float
        Of the playback, as a factor of real time; 0 for the largest.
    clock : callable
        The wall clock, s.

    Raises
    ------
    RecordError
        When it cannot be read.
    """

    kind = "recording"
    orders = OF_RECORDING

    def __init__(
        self,
        path: Path,
        channel: str | None = None,
        scenario: Scenario | None = None,
        on_progress: Callable[[int], None] = lambda position: None,
        speed: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._path = path
        self._clock = clock
        log = Log(path, channel)
        if scenario is None and log.note is not None:
            scenario = log.note.loaded_scenario(path)
        self._scenario = scenario
        self._frames, self._times_ns = _read(log, on_progress)
        self.damage = log.damage
        watch = Watch()
        self._view = View(watch, scenario)
        self._first_ns, self._last_ns = int(self._times_ns[0]), int(self._times_ns[-1])
        self._marks: list[_Mark] = []
        self._survey()
        self._lock = threading.Lock()  # orders come in threads of their own
        self._sent = 0
        self._speed = speed or _FASTEST
        self._is_paused = False
        self._at_ns = float(self._first_ns)
        self._looked_s = clock()
        self._seek(self._at_ns)

    @property
    def view(self) -> View:
        """The view."""
        return self._view

    def _survey(self) -> None:
        """Go through all frames once: history, events, and marks to seek from."""
        watch = self._view.watch
        span_s = (self._last_ns - self._first_ns) / 1e9
        step_s = max(_LEAST_STEP_S, span_s / _STEPS)
        edges = np.arange(self._first_ns, self._last_ns + 1, round(step_s * 1e9))
        ends = np.searchsorted(self._times_ns, edges, side="right").tolist()
        ends.append(len(self._frames))
        done = 0
        self._view.history.hold(step_s, len(ends))
        for step, end in enumerate(ends):
            if step % _MARK_EVERY == 0:
                self._marks.append((done, watch.memory(), self._view.dialogue.memory()))
            self._play(done, end)
            done = end
            self._view.look()
            if step % _TROUBLES_EVERY == 0:
                self._view.state(has_histories=False)
        self._view.keeps = False
        self._view.since.is_whole = True

    def _play(self, begin: int, end: int) -> None:
        """Add frames to the watch, and follow what is said in them."""
        for at in range(begin, end, DIAGNOSTIC):  # no more than a watch keeps
            piece = slice(at, min(at + DIAGNOSTIC, end))
            self._view.watch.add_timed_frames(self._frames[piece], self._times_ns[piece])
            self._view.hear()

    def turn(self) -> None:
        """Go on in the recording."""
        with self._lock:
            now_s = self._clock()
            passed_s, self._looked_s = now_s - self._looked_s, now_s
            if not self._is_paused and self._at_ns < self._last_ns:
                self._move_to(self._at_ns + passed_s * self._speed * 1e9)

    def _move_to(self, at_ns: float) -> None:
        """Show the recording at a later time."""
        self._at_ns = min(max(at_ns, float(self._first_ns)), float(self._last_ns))
        end = int(np.searchsorted(self._times_ns, round(self._at_ns), side="right"))
        self._play(self._sent, end)
        self._sent = max(end, self._sent)

    def _seek(self, at_ns: float) -> None:
        """Show the recording at any time, from the mark before; recent is what happened there."""
        at_ns = min(max(at_ns, float(self._first_ns)), float(self._last_ns))
        end = int(np.searchsorted(self._times_ns, round(at_ns), side="right"))
        mark = max((one for one in self._marks if one[0] <= end), key=lambda one: one[0])
        self._sent, tally, said = mark
        self._view.watch.restore(tally)
        self._view.dialogue.restore(said)
        self._view.forget()
        self._move_to(at_ns - WINDOW_NS)
        self._view.watch.state(has_histories=False)  # from here on, errors are recent
        self._move_to(at_ns)

    def describe(self) -> JsonObject:
        """Return what a browser needs to know once for each view."""
        return {
            "bus": self._path.name,
            "scenario": described(self._scenario),
            "first_s": self._first_ns / 1e9,
            "last_s": self._last_ns / 1e9,
        }

    def status(self) -> JsonObject:
        """Return how it is."""
        has_ended = self._at_ns >= self._last_ns
        phase = "ended" if has_ended else "paused" if self._is_paused else "running"
        return {"phase": phase, "words": "", "wanted_speed": self._speed, "at_s": self._at_ns / 1e9}

    def carry_out(self, order: Order) -> JsonObject:
        """Play, pause, change the speed, or go to a time."""
        with self._lock:
            return self._carried_out(order)

    def _carried_out(self, order: Order) -> JsonObject:
        if order.order == "seek":
            assert order.time_s is not None
            self._seek(order.time_s * 1e9)
        elif order.order == "speed":
            self._speed = min(order.speed or _FASTEST, _FASTEST)
        elif order.order == "play" and self._at_ns >= self._last_ns:
            self._seek(float(self._first_ns))
        if order.order in ("play", "pause", "speed"):
            self._is_paused = order.order == "pause"
        if order.order not in OF_RECORDING:
            raise DashboardError(f"{order.order}: not for a recording")
        return {"text": f"at {self._at_ns / 1e9:.2f} s"}

    def close(self) -> None:
        """Let go of nothing: there are no files open."""


def _read(log: Log, on_progress: Callable[[int], None]) -> tuple[FrameArray, Integers]:
    """Return all frames of a recording and their times, ns; of dates since the first one."""
    frames, times = [], []
    for piece in log.pieces():
        frames.append(piece.frames)
        times.append(np.round(piece.time_s * 1e9).astype(np.int64))
        if log.frames > MOST_FRAMES:
            raise RecordError(f"{log.path}: more than {MOST_FRAMES} frames; play a part of it")
        on_progress(log.position)
    times_ns = np.concatenate(times)
    if times_ns[0] > _YEARS_S * 1e9:
        times_ns -= times_ns[0]
    return Frame.joined(frames), np.maximum.accumulate(times_ns)
