"""Engines that run chunks of a campaign: threads of this process, or a Dask cluster.

An engine takes chunks and gives them back when they are done, in any order. It holds few at a time:
who submits looks at `room` before.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import Row, Work, rows_of

ENGINES: Final = ("threads", "processes", "dask")
AHEAD: Final = 2
"""Chunks per worker that wait or run."""

Chunk = tuple[int, ...]
_Future = TypeVar("_Future")


@dataclass(frozen=True)
class Done:
    """A chunk that has come back: its rows, fewer where it was stopped, or why it has none."""

    runs: Chunk
    rows: list[Row]
    lost: str | None = None  #: why the worker is gone that had it; the chunk is to be run again


class Engine(Protocol):
    """Runs chunks."""

    def workers(self) -> int:
        """Return how many threads it has; a cluster may have none yet."""

    def room(self) -> int:
        """Return how many more chunks it takes now."""

    def submit(self, chunk: Chunk) -> None:
        """Take a chunk."""

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the chunks that are done, after waiting for one at most this long.

        Raises
        ------
        CampaignError
            When a worker is not fit for this campaign, or all are gone.
        """

    def close(self) -> list[Done]:
        """Stop; return what was done until then."""


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0))


class Threads:
    """Runs chunks in threads: the compiled loop holds no lock of the interpreter.

    Parameters
    ----------
    work : Work
    workers : int
    """

    def __init__(self, work: Work, workers: int) -> None:
        self._work = work
        self._workers = workers
        self._stop = threading.Event()
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="rrins-campaign")
        self._done: queue.SimpleQueue[tuple[Chunk, Future[list[Row]]]] = queue.SimpleQueue()
        self._under_way = 0

    def workers(self) -> int:
        """Return how many threads it has."""
        return self._workers

    def room(self) -> int:
        """Return how many more chunks it takes now."""
        return AHEAD * self._workers - self._under_way

    def submit(self, chunk: Chunk) -> None:
        """Take a chunk."""
        future = self._pool.submit(rows_of, self._work, chunk, self._stop.is_set)
        future.add_done_callback(lambda done: self._done.put((chunk, done)))
        self._under_way += 1

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the chunks that are done, after waiting for one at most this long."""
        return taken(self._done, timeout_s, self._take)

    def _take(self, runs: Chunk, future: Future[list[Row]]) -> Done:
        self._under_way -= 1
        return Done(runs, [] if future.cancelled() else future.result())

    def close(self) -> list[Done]:
        """Stop at the next part of each run; return the rows that were done."""
        self._stop.set()
        self._pool.shutdown(wait=True, cancel_futures=True)
        return [done for done in self.wait(0) if done.rows]


def taken(
    source: queue.SimpleQueue[tuple[Chunk, _Future]],
    timeout_s: float,
    take: Callable[[Chunk, _Future], Done],
) -> list[Done]:
    """Return all that a queue has, after waiting for the first at most this long."""
    found: list[Done] = []
    try:
        found.append(take(*source.get(timeout=timeout_s) if timeout_s else source.get_nowait()))
        while True:
            found.append(take(*source.get_nowait()))
    except queue.Empty:
        return found


def missing(package: str, extra: str) -> CampaignError:
    """Return the error that names a missing package and the extra that installs it."""
    return CampaignError(f"needs {package}: pip install 'rrins[{extra}]'")
