"""How fast time passes on an embedded bus."""

from __future__ import annotations

import time

import can

from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.errors import BusError

_NS_PER_S = 1_000_000_000
_BATCH = 4096
_WATCH_S = 0.06
_WATCHES = 20
_LONGEST_STALL_NS = 5 * _NS_PER_S
_FASTER = 1.2  # than real time


def runs_ahead(bus: RrinsBus, patience_s: float = _WATCH_S) -> bool | None:
    """Return whether a bus runs faster than real time; None if no frames arrive.

    Such a bus is in lockstep and waits for slow nodes; one in real time does not wait. After a
    stall of the machine one in real time is fast as well, until it has made up for it: a bus that
    is fast is watched until it has gained more than any stall explains, or goes on and on.

    Parameters
    ----------
    bus : RrinsBus
        Attached as an observer.
    patience_s : float
        How long to wait for the first frame.
    """
    frames = frame_array(_BATCH)
    first = bus.recv_batch(frames, patience_s)
    if first is None:
        return None
    before = (time.monotonic_ns(), first.time_ns)
    gained_ns = 0
    for _ in range(_WATCHES):
        seen = _last_seen(bus, frames, before)
        if seen == before:
            return None
        passed_ns, bus_ns = seen[0] - before[0], seen[1] - before[1]
        if bus_ns < _FASTER * passed_ns:
            return False
        gained_ns += bus_ns - passed_ns
        if gained_ns > _LONGEST_STALL_NS:
            return True
        before = seen
    return True


def _last_seen(bus: RrinsBus, frames: FrameArray, before: tuple[int, int]) -> tuple[int, int]:
    """Watch the bus for a while; return when the last batch came, and its time, both in ns."""
    end_ns = time.monotonic_ns() + round(_WATCH_S * _NS_PER_S)
    seen = before
    while (left_ns := end_ns - time.monotonic_ns()) > 0:
        batch = bus.recv_batch(frames, left_ns / _NS_PER_S)
        if batch is not None:
            seen = (time.monotonic_ns(), batch.time_ns)
    return seen


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
