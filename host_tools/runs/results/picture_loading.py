"""Loads the plotting libraries while the sides of a rehearsal run, to save the wait afterwards."""

from __future__ import annotations

import contextlib
import threading

from rrins.host_tools.closing import Closing


class PictureLoading(Closing):
    """Imports in a thread; the first import on a machine also lists its fonts, for seconds.

    Begin it when no more forks are to be made.
    """

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Begin, once."""
        if self._thread is None:
            self._thread = threading.Thread(target=_load, name="picture loading", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Wait until all is loaded: a process must not end while it imports."""
        if self._thread is not None:
            self._thread.join()


def _load() -> None:
    with contextlib.suppress(ImportError):  # whoever draws raises it again
        import rrins.host_tools.runs.results.plots  # noqa: F401 - to have it loaded
