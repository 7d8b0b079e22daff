"""Runs chunks on a Dask cluster: by address, by scheduler file, or processes of this machine.

A cluster of others hands a chunk on when its worker is gone, a few times; then it comes back as
lost. Here it comes back at once, and the worker is replaced.
"""

from __future__ import annotations

import logging
import math
import queue
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from rrins.host_tools.campaigns.engines import AHEAD, Chunk, Done, missing, taken
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import Row, Work, rows_of
from rrins.host_tools.errors import RehearsalError

_CONNECT_S = 30
_IGNORE_CTRL_C = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""Run by each worker of this machine: Ctrl-C is the client's to handle."""

_FEWEST_AHEAD = 4
_COUNT_EVERY_S = 1.0  # asking for each chunk would keep 1600 threads waiting
_log: Final = logging.getLogger(__name__)


def _run(work: Work, runs: Chunk) -> list[Row]:
    """Run a chunk on a worker, under a name that its dashboard shows."""
    return rows_of(work, runs)


class Cluster:
    """Runs chunks on a Dask cluster.

    Parameters
    ----------
    work : Work
    address : str, optional
        Of the scheduler, such as ``tcp://10.0.0.1:8786``.
    scheduler_file : Path, optional
        That the scheduler wrote.
    workers : int, optional
        Processes of this machine, where neither is given.

    Raises
    ------
    CampaignError
        When `distributed` is missing, or no scheduler answers.
    """

    def __init__(
        self,
        work: Work,
        address: str | None = None,
        scheduler_file: Path | None = None,
        workers: int | None = None,
    ) -> None:
        try:
            distributed: Any = import_module("distributed")
        except ImportError as error:
            raise missing("distributed", "dask") from error
        self._work = work
        self._local: Any = None
        self._lost_words = distributed.scheduler.KilledWorker
        self._cancelled = (
            distributed.client.FutureCancelledError,
            distributed.CancelledError,
            distributed.comm.CommClosedError,
        )
        logging.getLogger("distributed").setLevel(logging.ERROR)
        where = address or (f"of {scheduler_file}" if scheduler_file else "on this machine")
        try:
            if address is None and scheduler_file is None:
                self._local = distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    memory_limit=0,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                    preload=_IGNORE_CTRL_C,
                    scheduler_kwargs={"allowed_failures": 0},  # the client hands out again
                )
                address = self._local.scheduler_address
            file = None if scheduler_file is None else str(scheduler_file)
            self._client: Any = distributed.Client(
                address, scheduler_file=file, timeout=_CONNECT_S, set_as_default=False
            )
        except (OSError, ValueError, TimeoutError) as error:
            raise CampaignError(f"Dask scheduler {where}: does not answer: {error}") from error
        self._where = where
        self._done: queue.SimpleQueue[tuple[Chunk, Any]] = queue.SimpleQueue()
        self._under_way: dict[Chunk, Any] = {}
        self._workers, self._counted = 0, -math.inf

    def workers(self) -> int:
        """Return how many threads the workers have, as of this second; they may come and go."""
        now = time.monotonic()
        if now - self._counted >= _COUNT_EVERY_S:
            try:
                self._workers, self._counted = sum(self._client.nthreads().values()), now
            except (OSError, TimeoutError, *self._cancelled) as error:
                raise self._gone() from error
        return self._workers

    def room(self) -> int:
        """Return how many more chunks it takes now; those of the first workers may wait here."""
        return max(_FEWEST_AHEAD, AHEAD * self.workers()) - len(self._under_way)

    def submit(self, chunk: Chunk) -> None:
        """Take a chunk."""
        future = self._client.submit(_run, self._work, chunk, pure=False)
        self._under_way[chunk] = future
        future.add_done_callback(lambda done: self._done.put((chunk, done)))

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the chunks that are done or lost, after waiting for one at most this long.

        Raises
        ------
        CampaignError
            When a worker refuses the work, or the scheduler is gone.
        """
        if self._client.status not in ("running", "connecting"):
            raise self._gone()
        return taken(self._done, timeout_s, self._take)

    def _gone(self) -> CampaignError:
        return CampaignError(f"Dask scheduler {self._where}: is gone; the same command goes on")

    def _take(self, runs: Chunk, future: Any) -> Done:
        self._under_way.pop(runs, None)
        try:
            rows = future.result(timeout=_CONNECT_S)
        except self._lost_words as error:
            return Done(runs, [], " ".join(str(error).split())[:200])
        except (*self._cancelled, TimeoutError) as error:
            if self._local is not None:  # its scheduler is here: the rows went with a worker
                return Done(runs, [], f"{type(error).__name__}: {error}"[:200])
            raise self._gone() from error
        except RehearsalError:
            raise
        except Exception as error:  # whatever a worker of other libraries raises
            raise CampaignError(f"Dask worker: {type(error).__name__}: {error}") from error
        finally:
            future.release()
        return Done(runs, rows)

    def close(self) -> list[Done]:
        """Let go of what is under way and of the cluster; return nothing."""
        disabled = logging.root.manager.disable
        logging.disable(logging.CRITICAL)  # Dask tells of what it cancels, by any module's name
        try:
            self._end(lambda: self._client.cancel(list(self._under_way.values()), force=True))
            self._end(lambda: self._client.close(timeout=5))
            if self._local is not None:
                self._end(lambda: self._local.close(timeout=10))
        finally:
            logging.disable(disabled)
        return []

    def _end(self, call: Callable[[], object]) -> None:
        """Call what lets go of something; a scheduler that is gone has let go already."""
        try:
            call()
        except (OSError, TimeoutError, RuntimeError, ValueError, *self._cancelled) as error:
            _log.debug("Dask scheduler %s: %s", self._where, error)
