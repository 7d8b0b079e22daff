"""Conducts a campaign: hands out what is planned less what is stored, and stores what comes."""

from __future__ import annotations

import math
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rrins.host_tools.campaigns.engines import Chunk, Done, Engine
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import FAILED, MAIN, OK, Row
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.until import Until
from rrins.host_tools.runs.rehearsal import Interrupted

CHUNK_S = 4.0
"""Duration of a chunk: the most that a crash costs, for each worker."""

FAR_CHUNK_S = 30.0
"""The same on a cluster, whose many workers share one client."""

MOST_OF_CHUNK = 256
_PART_S = 1.0
"""Time between two parts; rows that come sooner wait for those that follow."""

_POLL_S = 0.2
_MOST_LOSSES = 3
"""Times that a run may take its worker with it before it counts as failed."""


@dataclass
class Progress:
    """The progress of a campaign.

    Attributes
    ----------
    planned, stored : int
        Runs in all, and of these stored.
    """

    planned: int
    stored: int
    begun_with: int  #: runs that were stored before
    failed: int = 0  #: of those that were run now, the ones without an end
    lost: int = 0  #: chunks that were run again as their worker was gone
    workers: int | None = None  #: threads that there are
    #: the figure that is watched, of the runs of now that came to their end
    values: array[float] = field(default_factory=lambda: array("d"))
    begin: float = field(default_factory=time.monotonic)

    @property
    def wall_s(self) -> float:
        """Seconds since its beginning."""
        return time.monotonic() - self.begin

    @property
    def rate(self) -> float:
        """Runs per second."""
        return (self.stored - self.begun_with) / max(self.wall_s, 1e-9)

    def figures(self) -> tuple[float, float] | None:
        """Return the median and the 95th percentile so far."""
        if not self.values:
            return None
        middle, high = np.quantile(np.frombuffer(self.values), (0.5, 0.95))
        return float(middle), float(high)


class Conductor:
    """Runs what is left of a campaign.

    Parameters
    ----------
    store : Store
        Locked.
    engine : Engine
    until : Until, optional
        Ends the campaign once an interval is narrow enough.
    silence_s : float
        The longest time without a chunk that comes back.
    on_progress : callable
        Called now and then.
    stop : threading.Event, optional
        Ends the campaign as Ctrl-C does.
    watched : str
        The column whose figures the progress has.
    at_once : int
        Runs of a chunk at least.
    chunk_s : float
        Duration of a chunk.
    """

    def __init__(
        self,
        store: Store,
        engine: Engine,
        until: Until | None = None,
        silence_s: float = 600.0,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        stop: threading.Event | None = None,
        watched: str = MAIN,
        at_once: int = 1,
        chunk_s: float = CHUNK_S,
    ) -> None:
        self._store, self._engine, self._until = store, engine, until
        self._silence_s = silence_s
        self._on_progress = on_progress
        self._stop = stop or threading.Event()
        self._watched, self._at_once, self._chunk_s = watched, at_once, chunk_s
        self._run_s: float | None = None
        self._losses: dict[int, int] = {}
        stored = store.stored()
        runs = store.definition.runs
        is_left = np.ones(runs, bool)
        is_left[stored[stored < runs]] = False
        self._left = deque(_stretches(is_left))
        self._again: deque[Chunk] = deque()
        self._rows: list[Row] = []
        self._written = -math.inf
        self.progress = Progress(runs, len(stored), len(stored))
        self._prefix = _Prefix(store, until) if until is not None else None

    def run(self) -> Progress:
        """Run all that is left; return how it went.

        Raises
        ------
        CampaignError
            When it cannot go on; what is stored stays.
        Interrupted
            When it was stopped.
        """
        if self._store.stopped_at is not None:
            return self.progress
        under_way = 0
        last = time.monotonic()
        try:
            while not self._is_enough():
                while self._engine.room() > 0 and (chunk := self._next_chunk()):
                    self._engine.submit(chunk)
                    under_way += 1
                if not under_way:
                    break
                done = self._engine.wait(_POLL_S)
                under_way -= len(done)
                last = time.monotonic() if done else last
                for one in done:
                    self._take(one)
                if time.monotonic() - self._written >= _PART_S:
                    self._write()
                self.progress.workers = self._engine.workers()
                self._on_progress(self.progress)
                if self._stop.is_set():
                    self._write()
                    raise Interrupted(
                        f"stopped by the user: {self._stored_words()}; the same command goes on"
                    )
                if time.monotonic() - last > self._silence_s:
                    what = "has given anything" if self.progress.workers else "has come"
                    raise CampaignError(
                        f"no worker {what} for {self._silence_s:g} s: "
                        f"{self._stored_words()}; the same command goes on"
                    )
        finally:
            for one in self._engine.close():
                self._take(one)
            self._write()
        self._store.merge()
        self._on_progress(self.progress)
        return self.progress

    def _stored_words(self) -> str:
        return f"{self.progress.stored} of {self.progress.planned} runs are stored"

    def _is_enough(self) -> bool:
        return self._prefix is not None and self._prefix.end is not None

    def _next_chunk(self) -> Chunk:
        """Return the runs to hand out next; none if all are handed out."""
        if self._again:
            return self._again.popleft()
        if not self._left:
            return ()
        if self._run_s is None:
            size = 1
        else:
            size = min(max(int(self._chunk_s / max(self._run_s, 1e-4)), 1), MOST_OF_CHUNK)
        size = max(size, self._at_once)
        first, last = self._left.popleft()
        if last - first > size:
            self._left.appendleft((first + size, last))
            last = first + size
        return tuple(range(first, last))

    def _take(self, done: Done) -> None:
        """Keep what has come back; run again what was lost."""
        if done.lost is not None:
            self._lose(done)
            return
        if done.rows:
            fastest = min(row["wall_s"] for row in done.rows)
            self._run_s = fastest if self._run_s is None else min(2 * self._run_s, fastest)
        self._keep(done.rows)

    def _keep(self, rows: Sequence[Row]) -> None:
        """Keep rows for the next part, or until all before them are there."""
        if self._prefix is None:
            self._rows += rows
        else:
            self._prefix.add(rows)
            self._rows += self._prefix.ready()

    def _write(self) -> None:
        """Store what has come as a part; note the end where the criterion holds."""
        rows, self._rows = self._rows, []
        self._written = time.monotonic() if rows else self._written
        self._store.write(rows)
        self.progress.stored += len(rows)
        self.progress.failed += sum(row["status"] != OK for row in rows)
        for row in rows:
            value = row.get(self._watched)
            if row["status"] == OK and value is not None and math.isfinite(value):
                self.progress.values.append(value)
        if self._prefix is not None and self._prefix.end is not None:
            assert self._until is not None
            self._store.note_end(self._prefix.end, self._until.text)
            self.progress.planned = self._prefix.end

    def _lose(self, done: Done) -> None:
        """Hand out again, in halves, what a worker took with it; a single run a few times."""
        self.progress.lost += 1
        if len(done.runs) > 1:
            middle = len(done.runs) // 2
            self._again += (done.runs[:middle], done.runs[middle:])
            return
        (run,) = done.runs
        self._losses[run] = self._losses.get(run, 0) + 1
        if self._losses[run] < _MOST_LOSSES:
            self._again.append(done.runs)
            return
        plan = self._store.definition.plan
        row: Row = {"run": run, "seed": plan.seed(run)}
        row |= {one.column: value for one, value in plan.point(run).items()}
        row |= {"status": FAILED, "error": f"worker lost: {done.lost}", "wall_s": math.nan}
        self._keep([row])


def _stretches(is_left: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the stretches of numbers that are left: the first, and the one behind the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_left.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


class _Prefix:
    """Rows of a campaign with a criterion: given on in order of their runs, up to where it holds.

    So the runs that are stored do not depend on which worker was the quickest.
    """

    def __init__(self, store: Store, until: Until) -> None:
        self._until = until
        self._block = store.definition.plan.block
        self._stored = store.values(until.column)
        self._values = array("d")
        self._waiting: dict[int, Row] = {}
        self._ready: list[Row] = []
        self.end: int | None = None
        """Runs with which the criterion holds."""
        self._go_on()

    def add(self, rows: Sequence[Row]) -> None:
        """Take rows, in any order."""
        self._waiting |= {row["run"]: row for row in rows}
        self._go_on()

    def _go_on(self) -> None:
        while self.end is None:
            run = len(self._values)
            if run in self._stored:
                self._values.append(self._stored.pop(run))
            elif run in self._waiting:
                row = self._waiting.pop(run)
                value = row.get(self._until.column)
                is_ok = row["status"] == OK and value is not None
                self._values.append(float(value) if is_ok and value is not None else math.nan)
                self._ready.append(row)
            else:
                return
            self._look()

    def _look(self) -> None:
        runs = len(self._values)
        if not self._until.is_due(runs, self._block):
            return
        if self._until.holds(np.frombuffer(self._values), self._block):
            self.end = runs

    def ready(self) -> list[Row]:
        """Return the rows that are to be stored now."""
        ready, self._ready = self._ready, []
        return ready
