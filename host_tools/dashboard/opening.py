"""Subject of a dashboard: a rehearsal that it starts, one that runs, or a recording."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.dashboard.bus_source import BusSource, RehearsalSource
from rrins.host_tools.dashboard.child import Start
from rrins.host_tools.dashboard.log_source import LogSource
from rrins.host_tools.dashboard.source import Source
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.recording.formats import ending_of
from rrins.host_tools.runs.rehearsal import default_address, free_channel
from rrins.host_tools.runs.run import Overrides
from rrins.host_tools.runs.set_up.settings import check_files
from rrins.host_tools.runs.sides.steering import UNLIMITED
from rrins.host_tools.scenario.scenario import load

DEFAULT_SCENARIO: Final = "rimu_rotating"

_NEEDED = ("starlette", "uvicorn", "websockets")


@dataclass(frozen=True)
class Subject:
    """Subject to be shown.

    Attributes
    ----------
    duration_s, seed : optional
        In place of the scenario's.
    out, record : Path, optional
        Folder for the results, and file for the bus, of a rehearsal that is started.
    """

    what: str | None = None  #: scenario, or a log; of a bus that is watched: what runs there
    duration_s: float | None = None
    seed: int | None = None
    speed: float = 1.0  #: factor of real time at first; 0 as fast as possible
    out: Path | None = None
    record: Path | None = None
    interface: str = EMBEDDED
    channel: str | None = None
    bitrate: int | None = None  #: bus to watch; without a channel a rehearsal is started
    control: bool = False  #: whether what is watched may be given orders
    log_channel: str | None = None  #: the only channel whose frames of a log are used

    @property
    def is_watched(self) -> bool:
        """Whether it is a bus that is there."""
        return self.channel is not None or self.interface != EMBEDDED

    @property
    def log(self) -> Path | None:
        """The recording that is meant; None where a scenario is."""
        if self.is_watched or self.what is None or self.what.endswith(".toml"):
            return None
        path = Path(self.what)
        return path if path.is_file() or ending_of(path)[0] else None


def check_packages() -> None:
    """Raise RehearsalError if a package is missing that only the dashboard needs."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise RehearsalError(f"the dashboard needs more packages: pip install {' '.join(missing)}")


@contextlib.contextmanager
def opened(
    subject: Subject, on_read: Callable[[int], None] = lambda position: None
) -> Iterator[Source]:
    """Open what is to be shown until the block ends.

    Parameters
    ----------
    subject : Subject
    on_read : callable
        Called with how many bytes of a log have been read.

    Raises
    ------
    RehearsalError
        When it cannot be had.
    """
    path = subject.log
    if path is not None:
        source: Source = LogSource(
            path, subject.log_channel, on_progress=on_read, speed=subject.speed
        )
    elif subject.is_watched:
        source = _watched(subject)
    else:
        source = _started(subject)
    with contextlib.closing(source):
        yield source


def _watched(subject: Subject) -> BusSource:
    name = subject.what
    scenario = (
        None if name is None else load(name, duration_s=subject.duration_s, seed=subject.seed)
    )
    address = default_address(subject.interface, subject.channel, subject.bitrate)
    return BusSource(address, scenario, subject.control)


def _started(subject: Subject) -> RehearsalSource:
    name = subject.what or DEFAULT_SCENARIO
    scenario = load(name, duration_s=subject.duration_s, seed=subject.seed)
    check_files(scenario)
    named = (("--out", subject.out), ("--record", subject.record))
    options = [word for option, path in named if path is not None for word in (option, str(path))]
    start = Start(
        name,
        scenario,
        (*Overrides(subject.duration_s, subject.seed).options(), *options),
        Address(EMBEDDED, free_channel()),
    )
    return RehearsalSource(start, subject.speed or UNLIMITED)
