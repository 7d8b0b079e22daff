"""Runs chunks in processes of this machine; one that dies is replaced, its chunk run again."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from rrins.host_tools.campaigns.engines import AHEAD, Done
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import Work, rows_of
from rrins.host_tools.errors import RehearsalError

_SPAWN: SpawnContext = multiprocessing.get_context("spawn")
_MOST_DEATHS = 5
"""Workers in a row that may die without having given anything."""


def _serve(pipe: Connection, work: Work) -> None:
    """Run chunks until the client is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the client's to handle
    try:
        while True:
            runs = pipe.recv()
            try:
                answer: Any = rows_of(work, runs)
            except RehearsalError as error:
                answer = str(error)
            pipe.send(answer)
    except (EOFError, OSError):
        return


@dataclass
class _Worker:
    process: SpawnProcess
    pipe: Connection
    runs: tuple[int, ...] | None = None


class Processes:
    """Runs chunks in processes, which start as new interpreters.

    Parameters
    ----------
    work : Work
    workers : int
    """

    def __init__(self, work: Work, workers: int) -> None:
        self._work = work
        self._waiting: deque[tuple[int, ...]] = deque()
        self._deaths = 0
        self._workers = [self._start() for _ in range(workers)]

    def _start(self) -> _Worker:
        ours, theirs = _SPAWN.Pipe()
        process = _SPAWN.Process(target=_serve, args=(theirs, self._work), daemon=True)
        process.start()
        theirs.close()
        return _Worker(process, ours)

    def room(self) -> int:
        """Return how many more chunks it takes now."""
        busy = sum(worker.runs is not None for worker in self._workers)
        return AHEAD * len(self._workers) - busy - len(self._waiting)

    def submit(self, runs: Sequence[int]) -> None:
        """Take a chunk."""
        self._waiting.append(tuple(runs))
        self._hand_out()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if worker.runs is None and self._waiting:
                worker.runs = self._waiting.popleft()
                try:
                    worker.pipe.send(worker.runs)
                except OSError:
                    continue  # it has died: `wait` sees that

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the chunks that are done or lost, after waiting for one at most this long.

        Raises
        ------
        CampaignError
            When a worker refuses the work, or all die at once.
        """
        wait([worker.pipe for worker in self._workers], timeout_s)
        found = []
        for index, worker in enumerate(self._workers):
            if not worker.pipe.poll():
                continue
            runs, worker.runs = worker.runs, None
            try:
                answer = worker.pipe.recv()
            except (EOFError, OSError):
                found += self._replace(index, runs)
                continue
            if isinstance(answer, str):
                raise CampaignError(answer)
            assert runs is not None
            self._deaths = 0
            found.append(Done(runs, answer))
        self._hand_out()
        return found

    def _replace(self, index: int, runs: tuple[int, ...] | None) -> list[Done]:
        """Start another worker for one that has died; return the chunk that it had."""
        process = self._workers[index].process
        process.join()
        code = process.exitcode
        why = f"process {process.pid} ended with " + (
            f"signal {-code}" if code is not None and code < 0 else f"status {code}"
        )
        self._deaths += 1
        if self._deaths > _MOST_DEATHS:
            raise CampaignError(f"workers die one after another, the last one: {why}")
        self._workers[index].pipe.close()
        self._workers[index] = self._start()
        return [] if runs is None else [Done(runs, [], why)]

    def close(self) -> list[Done]:
        """Stop all workers; what they had is run again another time."""
        for worker in self._workers:
            worker.process.terminate()
        end = time.monotonic() + 5.0
        for worker in self._workers:
            worker.process.join(max(0.0, end - time.monotonic()))
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.pipe.close()
        return []
