"""Access to a running rehearsal: look into the firmware, inject faults, record."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rrins.host_tools.bus.address import Address
from rrins.host_tools.diag.target import DEFAULT_CHANNEL, DEFAULT_TIMEOUT_S, Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.recording.recorder import Recorder, waits_for_recorder


def open_diagnostics(
    interface: str = "rrins",
    channel: str = DEFAULT_CHANNEL,
    bitrate: int | None = None,
    *,
    timeout_s: float = DEFAULT_TIMEOUT_S,
    security: bool = False,
) -> Tester:
    """Return a diagnostic client of the navigation computer, by UDS on any bus.

    Use it in a ``with`` statement, or close it.

    Parameters
    ----------
    interface, channel, bitrate
        The bus, as python-can names it; by default the embedded one.
    timeout_s : float
        How long a response may take.
    security : bool
        Whether to pass SecurityAccess where a request needs it.

    Raises
    ------
    BusError
        When the bus cannot be had.
    """
    return Tester(Target(interface, channel, bitrate, timeout_s=timeout_s), security)


def open_faults(
    interface: str = "rrins", channel: str = DEFAULT_CHANNEL, bitrate: int | None = None
) -> FaultClient:
    """Return a client that puts faults into a rehearsal under way.

    Use it in a ``with`` statement, or close it.

    Raises
    ------
    BusError
        When the bus cannot be had.
    """
    return FaultClient(Address(interface, channel, bitrate))


@contextmanager
def record(
    path: str | Path,
    interface: str = "rrins",
    channel: str = DEFAULT_CHANNEL,
    bitrate: int | None = None,
) -> Iterator[Recorder]:
    """Record a bus to a file while the ``with`` statement lasts.

    A recording that the file has is moved into the folder `previous` beside it.

    Parameters
    ----------
    path : str or Path
        Its ending chooses the format.
    interface, channel, bitrate
        The bus, as python-can names it; by default the embedded one.

    Raises
    ------
    RecordError
        When the file cannot be written.
    BusError
        When the bus cannot be had.
    """
    address = Address(interface, channel, bitrate)
    recorder = Recorder(Path(path), address, waits_for_recorder(address))
    try:
        yield recorder
    finally:
        recorder.close()
