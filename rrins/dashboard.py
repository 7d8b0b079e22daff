"""The dashboard from Python: served beside whatever else the script does."""

from __future__ import annotations

import html
import webbrowser
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rrins.host_tools.dashboard.opening import Subject, check_packages, opened


@dataclass(frozen=True)
class Dashboard:
    """A dashboard that is served."""

    url: str  #: of the page

    def _repr_html_(self) -> str:
        url = html.escape(self.url)
        return f'<iframe src="{url}" width="100%" height="720"></iframe>'


@contextmanager
def open_dashboard(
    what: str | Path | None = None,
    *,
    duration_s: float | None = None,
    seed: int | None = None,
    speed: float = 1.0,
    out: str | Path | None = None,
    record: str | Path | None = None,
    interface: str = "rrins",
    channel: str | None = None,
    bitrate: int | None = None,
    control: bool = False,
    host: str = "127.0.0.1",
    port: int = 0,
    open_browser: bool = False,
) -> Iterator[Dashboard]:
    """Serve a rehearsal, a bus or a recording as a page while the ``with`` statement lasts.

    Parameters
    ----------
    what : str or Path, optional
        Scenario to rehearse, or a log to play back; `rimu_rotating` without it. Of a bus that is
        watched: the scenario that runs there.
    duration_s, seed : optional
        In place of the scenario's.
    speed : float
        Factor of real time at first, or of a playback; 0 as fast as possible.
    out, record : str or Path, optional
        Folder for the results, and file for the bus.
    interface, channel, bitrate
        Bus to watch, as python-can names it; without a channel a rehearsal is started.
    control : bool
        Whether what is watched may be given orders.
    host : str
        Address to serve at.
    port : int
        0 for any that is free.
    open_browser : bool
        Whether to open the page.

    Raises
    ------
    RehearsalError
        One line: what is missing, or cannot be had.
    """
    check_packages()
    from rrins.host_tools.dashboard.feed import Feed
    from rrins.host_tools.dashboard.guarding import Guard
    from rrins.host_tools.dashboard.server import bound, serving, url_of

    folder, file = (None if path is None else Path(path) for path in (out, record))
    subject = Subject(
        None if what is None else str(what), duration_s, seed, speed, folder, file, interface,
        channel, bitrate, control,
    )  # fmt: skip
    guard = Guard.of(host)
    with (
        closing(bound(host, port)) as listening,
        opened(subject) as source,
        serving(Feed(source, bool(source.orders)), guard, listening),
    ):
        page = Dashboard(url_of(listening, guard))
        if open_browser:
            webbrowser.open(page.url)
        yield page
