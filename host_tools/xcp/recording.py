"""Records signals by one DAQ list: packs their bytes into packets, and puts them together again."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrins.dbc.codec import load
from rrins.firmware_py.xcp.daq import TIMESTAMP_MODE, EventChannel
from rrins.firmware_py.xcp.protocol import (
    ODT_BYTES,
    ODTS_CAPACITY,
    TICK_NS,
    TIMESTAMP_BYTES,
    Event,
)
from rrins.host_tools.errors import XcpError
from rrins.host_tools.xcp.master import XcpMaster
from rrins.host_tools.xcp.samples import Samples
from rrins.host_tools.xcp.signals import Signal

_POLL_S = 0.2
_SILENCES = 50  # polls without a packet after which nothing more is expected
_NS_PER_S = 1_000_000_000
_START, _SELECT = 0x01, 0x02
_FRAME_BITS = 135  # of a frame with eight bytes and the most stuff bits, with the pause after it
_ANY_BIT = 0xFF

Place = tuple[int, int]
"""Address and size of an entry."""


def packed(signals: Sequence[Signal]) -> list[list[Place]]:
    """Return the entries of each ODT: the signals' bytes one after the other, cut to size.

    The first ODT has the timestamp, too.

    Raises
    ------
    XcpError
        If they do not fit into one list.
    """
    odts: list[list[Place]] = [[]]
    room = ODT_BYTES - TIMESTAMP_BYTES
    for signal in signals:
        address, left = signal.address, signal.size
        while left:
            if not room:
                odts.append([])
                room = ODT_BYTES
            part = min(left, room)
            odts[-1].append((address, part))
            address, left, room = address + part, left - part, room - part
    if len(odts) > ODTS_CAPACITY:
        raise XcpError(
            f"{len(signals)} signals: need {len(odts)} packets a sample, of {ODTS_CAPACITY} at most"
        )
    return odts


@dataclass(frozen=True)
class Recording:
    """Signals over time."""

    time_s: NDArray[np.float64]  #: since power-on
    values: dict[str, NDArray[np.generic]]  #: by signal
    units: dict[str, str]
    texts: dict[str, str]
    overloads: int  #: times that the computer told of samples that were left out
    torn: int  #: samples of which packets were missing
    bus_share: float  #: that the packets took, if the bus is the contract's

    @property
    def count(self) -> int:
        """Samples."""
        return len(self.time_s)


def record(
    master: XcpMaster,
    signals: Sequence[Signal],
    seconds: float | None = None,
    event: EventChannel = EventChannel.EPOCH,
    every: int = 1,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[float], None] = lambda seconds: None,
) -> Recording:
    """Record signals.

    Parameters
    ----------
    master : XcpMaster
    signals : sequence of Signal
    seconds : float, optional
        Length, by the computer's time; without it to the end of the bus, or until `should_stop`.
    event : EventChannel
    every : int
        Events from one sample to the next.
    should_stop : callable
    on_progress : callable
        Told how many seconds have been recorded.

    Raises
    ------
    XcpError
        If the signals do not fit into a list, or the computer refuses it.
    """
    odts = packed(signals)
    _set_up(master, odts, event, every)
    samples = Samples(len(odts))
    _collect(master, samples, seconds, should_stop, on_progress)
    if not master.has_ended:
        master.command("stop", lambda: master.raw.startStopSynch(0))
        while not master.packets.empty():
            samples.put(master.packets.get())
    overloads = _overloads(master)
    return _recording(samples, signals, len(odts), overloads, seconds)


def _set_up(master: XcpMaster, odts: list[list[Place]], event: EventChannel, every: int) -> None:
    raw: Any = master.raw
    filled = [(k, odt) for k, odt in enumerate(odts) if odt]
    commands: list[Callable[[], Any]] = [
        raw.freeDaq,
        partial(raw.allocDaq, 1),
        partial(raw.allocOdt, 0, len(odts)),
        *(partial(raw.allocOdtEntry, 0, k, len(odt)) for k, odt in filled),
    ]
    for k, odt in filled:
        commands.append(partial(raw.setDaqPtr, 0, k, 0))
        commands += [partial(raw.writeDaq, _ANY_BIT, size, 0, address) for address, size in odt]
    commands += [
        partial(raw.setDaqListMode, TIMESTAMP_MODE, 0, int(event), every, 0),
        partial(raw.startStopDaqList, _SELECT, 0),
        partial(raw.startStopSynch, _START),
    ]
    for command in commands:
        master.command("measure", command)


def _collect(
    master: XcpMaster,
    samples: Samples,
    seconds: float | None,
    should_stop: Callable[[], bool],
    on_progress: Callable[[float], None],
) -> None:
    silences, told = 0, 0
    while not should_stop() and silences < _SILENCES:
        try:
            samples.put(master.packets.get(timeout=_POLL_S))
        except queue.Empty:
            if master.has_ended:
                return
            silences += 1
            continue
        silences = 0
        if len(samples.rows) <= told:
            continue
        told = len(samples.rows)
        passed_s = _passed_s(samples.rows[0], samples.rows[-1])
        if told % 100 == 0:
            on_progress(passed_s)
        if seconds is not None and passed_s >= seconds:
            return


def _ticks(row: bytes) -> int:
    return int.from_bytes(row[:TIMESTAMP_BYTES], "little")


def _passed_s(first: bytes, last: bytes) -> float:
    # Of a recording longer than the timestamp's 71 minutes, the last part of that.
    return ((_ticks(last) - _ticks(first)) & 0xFFFF_FFFF) * TICK_NS / _NS_PER_S


def _overloads(master: XcpMaster) -> int:
    count = 0
    while not master.events.empty():
        count += master.events.get() == Event.DAQ_OVERLOAD
    return count


def _recording(
    samples: Samples, signals: Sequence[Signal], odts: int, overloads: int, seconds: float | None
) -> Recording:
    rows = samples.rows
    data = np.frombuffer(b"".join(rows), dtype=np.uint8).reshape(len(rows), odts * ODT_BYTES)
    ticks = np.ascontiguousarray(data[:, :TIMESTAMP_BYTES]).view("<u4")[:, 0].astype(np.int64)
    steps = np.diff(ticks, prepend=ticks[:1]) & 0xFFFF_FFFF
    time_s = np.asarray((ticks[:1] + np.cumsum(steps)) * (TICK_NS / _NS_PER_S), dtype=np.float64)
    values: dict[str, NDArray[np.generic]] = {}
    at = TIMESTAMP_BYTES
    for signal in signals:
        values[signal.name] = signal.values(data[:, at : at + signal.size])
        at += signal.size
    kept = np.ones(len(rows), dtype=bool)
    if seconds is not None and len(rows):
        kept = time_s < time_s[0] + seconds - 1e-9
    time_s, values = time_s[kept], {name: column[kept] for name, column in values.items()}
    period_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else np.inf
    return Recording(
        time_s,
        values,
        {signal.name: signal.field.unit for signal in signals},
        {signal.name: signal.field.text for signal in signals},
        overloads,
        samples.torn,
        odts * _FRAME_BITS / period_s / load().bits_per_s,
    )
