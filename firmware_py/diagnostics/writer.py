"""Writing to a store without stopping the loop.

`DirectWriter` writes at once, for virtual time, where the simulation waits. `ThreadWriter` has
its own thread, for real time: a disk write may take many periods.
"""

from __future__ import annotations

import queue
import threading
from typing import Protocol

from rrins.firmware_py.diagnostics.store import StoreError, TwoCopyStore


class WriteJob:
    """An image being written to a store.

    Attributes
    ----------
    done : bool
        Whether it is stored or has failed.
    failed : bool
        Once done: whether it could not be stored.
    """

    def __init__(self) -> None:
        self.done = False
        self.failed = False

    def run(self, store: TwoCopyStore, image: bytes) -> None:
        """Store the image."""
        try:
            store.write(image)
        except StoreError:
            self.failed = True
        self.done = True


class Writer(Protocol):
    """Writes images to stores, in order of submission."""

    def submit(self, store: TwoCopyStore, image: bytes) -> WriteJob:
        """Start storing an image."""

    def close(self) -> None:
        """Wait until everything is stored."""


class DirectWriter:
    """Stores an image before it returns."""

    def submit(self, store: TwoCopyStore, image: bytes) -> WriteJob:
        """Store an image."""
        job = WriteJob()
        job.run(store, image)
        return job

    def close(self) -> None:
        """Do nothing: nothing is pending."""


class ThreadWriter:
    """Stores images in a thread, which starts with the first."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[tuple[WriteJob, TwoCopyStore, bytes] | None] = (
            queue.SimpleQueue()
        )
        self._thread: threading.Thread | None = None

    def submit(self, store: TwoCopyStore, image: bytes) -> WriteJob:
        """Start storing an image."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="parameter memory", daemon=True)
            self._thread.start()
        job = WriteJob()
        self._jobs.put((job, store, image))
        return job

    def _work(self) -> None:
        while (task := self._jobs.get()) is not None:
            job, store, image = task
            job.run(store, image)

    def close(self) -> None:
        """Wait until everything is stored."""
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join()
            self._thread = None
