"""How fast time passes on an embedded bus."""

from __future__ import annotations

import time

import can

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.port import Address, open_bus
from rrins.host_tools.errors import BusError

_NS_PER_S = 1_000_000_000
_BATCH = 4096
_WATCH_S = 0.06
_FASTER = 1.2  # than real time


def runs_ahead(bus: RrinsBus, patience_s: float = _WATCH_S) -> bool | None:
    """Return whether a bus runs faster than real time; None if no frame arrives.

    Such a bus is in lockstep and waits for slow nodes; one in real time does not wait.

    Parameters
    ----------
    bus : RrinsBus
        Attached as an observer.
    patience_s : float
        How long to wait for the first frame.
    """
    pace = pace_of(bus, patience_s, _WATCH_S)
    return None if pace is None else pace >= _FASTER


def pace_of(bus: RrinsBus, patience_s: float, watch_s: float) -> float | None:
    """Return how many seconds of bus time pass per second; None if no frame arrives.

    Parameters
    ----------
    bus : RrinsBus
        Attached as an observer.
    patience_s : float
        How long to wait for the first frame.
    watch_s : float
        How long to measure after that.
    """
    frames = frame_array(_BATCH)
    first = bus.recv_batch(frames, patience_s)
    if first is None:
        return None
    begun_ns, bus_ns = time.monotonic_ns(), first.time_ns
    end_ns = begun_ns + round(watch_s * _NS_PER_S)
    last_ns, seen_ns = bus_ns, begun_ns
    while (left_ns := end_ns - time.monotonic_ns()) > 0:
        batch = bus.recv_batch(frames, left_ns / _NS_PER_S)
        if batch is not None:
            last_ns, seen_ns = batch.time_ns, time.monotonic_ns()
    return (last_ns - bus_ns) / (seen_ns - begun_ns) if seen_ns > begun_ns else None


def attach_in_pace(address: Address, name: str, timeout_s: float) -> tuple[RrinsBus, bool]:
    """Attach a tool to the embedded bus: as an observer, or in step with a rehearsal in lockstep.

    If a rehearsal ran faster than real time, every request would time out before its answer is
    read. A rehearsal waits for clients attached in step, so it keeps the tool's pace.

    Returns
    -------
    RrinsBus
    bool
        Whether it is in step.

    Raises
    ------
    BusError
        If there is no such bus.
    """
    bus = _attach(address, name, role="observer")
    try:
        is_ahead = runs_ahead(bus, timeout_s)
    except can.CanError as error:
        bus.shutdown()
        raise BusError(f"bus {address}: {error}") from error
    if not is_ahead:
        return bus, False
    bus.shutdown()
    return _attach(address, name, in_step=True), True


def _attach(address: Address, name: str, **options: object) -> RrinsBus:
    bus = open_bus(address, host="never", name=name, **options)
    assert isinstance(bus, RrinsBus)
    return bus
