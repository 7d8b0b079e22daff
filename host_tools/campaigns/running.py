"""Runs a stored campaign with the workers that were asked for."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rrins.compiled.compile_events import compiling_watched
from rrins.host_tools.campaigns.conduct import CHUNK_S, FAR_CHUNK_S, Conductor, Progress
from rrins.host_tools.campaigns.engines import ENGINES, Engine, Threads, processors
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import MAIN, Work, at_once, rows_of
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.until import Until
from rrins.host_tools.runs.set_up.settings import check_files
from rrins.host_tools.runs.sides.job import check_code_folder

_ADDRESS = re.compile(r"[a-z]+://.+|[\w.-]+:\d+\Z")


@dataclass(frozen=True)
class Workers:
    """The workers of a campaign."""

    engine: str
    count: int  #: threads or processes; not used with an address
    address: str | None = None  #: of a Dask scheduler
    scheduler_file: Path | None = None  #: that a Dask scheduler wrote

    @classmethod
    def of(
        cls,
        workers: str | int | None = None,
        engine: str | None = None,
        scheduler_file: Path | None = None,
    ) -> Workers:
        """Return what the options mean.

        Parameters
        ----------
        workers : str or int, optional
            A number, or the address of a Dask scheduler; by default one for each processor.
        engine : str, optional
            By default threads, or Dask where there is an address or a scheduler file.
        scheduler_file : Path, optional

        Raises
        ------
        CampaignError
        """
        text = "" if workers is None else str(workers).strip()
        address = text if _ADDRESS.match(text) else None
        count = processors() if not text or address else int(text) if text.isdecimal() else 0
        if not 1 <= count <= 4096:
            raise CampaignError(f"workers {text!r}: neither a number from 1 on nor an address")
        remote = address is not None or scheduler_file is not None
        if address is not None and scheduler_file is not None:
            raise CampaignError("workers: an address or a scheduler file, not both")
        engine = engine or ("dask" if remote else "threads")
        if engine not in ENGINES:
            raise CampaignError(f"engine {engine!r}: there are {', '.join(ENGINES)}")
        if remote and engine != "dask":
            raise CampaignError(f"engine {engine}: takes no address; Dask does")
        if scheduler_file is not None and not scheduler_file.is_file():
            raise CampaignError(f"scheduler file {scheduler_file}: is not there")
        return cls(engine, count, address, scheduler_file)

    @property
    def are_here(self) -> bool:
        """Whether they are this process's, or processes of this machine."""
        return self.address is None and self.scheduler_file is None

    def start(self, work: Work) -> Engine:
        """Return the engine, ready for chunks.

        Raises
        ------
        CampaignError
        """
        if self.engine == "threads":
            return Threads(work, self.count)
        from rrins.host_tools.campaigns.cluster import Cluster

        return Cluster(work, self.address, self.scheduler_file, self.count)


def run(
    store: Store,
    workers: Workers,
    until: Until | None = None,
    silence_s: float = 600.0,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    on_compiling: Callable[[int], None] = lambda functions: None,
    stop: threading.Event | None = None,
) -> Progress:
    """Run what is left of a campaign.

    Parameters
    ----------
    store : Store
    workers : Workers
    until : Until, optional
    silence_s : float
        The longest time without a chunk that comes back.
    on_progress, on_compiling : callable
        Called now and then; with the number of functions that are compiled.
    stop : threading.Event, optional

    Raises
    ------
    RehearsalError
        When it cannot begin or go on; what is stored stays.
    """
    check_files(store.definition.scenario)
    check_code_folder()
    work = Work.of(store.definition)
    with store.locked():
        chunk_s = CHUNK_S if workers.are_here else FAR_CHUNK_S
        if workers.are_here:
            with compiling_watched(on_compiling):
                rows_of(work, ())  # once, for all workers of this machine
        watched = MAIN if until is None else until.column
        engine = workers.start(work)
        many = at_once(store.definition)
        if many > 1:  # as long as every worker has some
            many = max(1, min(many, store.definition.runs // workers.count))
        return Conductor(
            store, engine, until, silence_s, on_progress, stop, watched, many, chunk_s
        ).run()
