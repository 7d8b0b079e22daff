"""Writing to a store without stopping the loop.

`DirectWriter` writes at once: right where time is virtual, and the world waits. `ThreadWriter` has
a thread of its own, for real time: a disk may take many periods to store what it is given.
"""

from __future__ import annotations

import queue
import threading
from typing import Protocol

from firmware_py.diagnostics.store import StoreError, TwoCopyStore


class Job:
    """An image on its way to a store.

    Attributes
    ----------
    done : bool
        Whether it is stored, or has failed.
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
    """Writes images to stores, in the order in which they are given."""

    def submit(self, store: TwoCopyStore, image: bytes) -> Job:
        """Begin to store an image."""

    def close(self) -> None:
        """Return when all is stored."""


class DirectWriter:
    """Stores an image before it returns."""

    def submit(self, store: TwoCopyStore, image: bytes) -> Job:
        """Store an image."""
        job = Job()
        job.run(store, image)
        return job

    def close(self) -> None:
        """Nothing is under way."""


class ThreadWriter:
    """Stores images in a thread, which is begun with the first."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[tuple[Job, TwoCopyStore, bytes] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def submit(self, store: TwoCopyStore, image: bytes) -> Job:
        """Begin to store an image."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="parameter memory", daemon=True)
            self._thread.start()
        job = Job()
        self._jobs.put((job, store, image))
        return job

    def _work(self) -> None:
        while (task := self._jobs.get()) is not None:
            job, store, image = task
            job.run(store, image)

    def close(self) -> None:
        """Return when all is stored."""
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join()
            self._thread = None
