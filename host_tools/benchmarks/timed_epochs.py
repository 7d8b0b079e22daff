"""Both steps in one process, each call timed by itself."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from rrins.firmware_py.core.step import firmware_step
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.step import hardware_step


class TimedEpoch(NamedTuple):
    """Durations of the steps of an epoch.

    Attributes
    ----------
    epoch : int
    firmware_ns, hardware_ns : int
    up : int
        Frames that the hardware sent: the first ones of its outbox.
    """

    epoch: int
    firmware_ns: int
    hardware_ns: int
    up: int


def timer_overhead_ns(clock: Callable[[], int] = time.perf_counter_ns) -> int:
    """Return the duration of an empty measurement."""
    readings = [(clock(), clock()) for _ in range(2000)]
    return round(statistics.median(end - start for start, end in readings))


def timed_epochs(
    firmware: Firmware, hardware: Hardware, epochs: int, clock: Callable[[], int]
) -> Iterator[TimedEpoch]:
    """Step both sides, which feed each other, as their shells do: each call from Python.

    Parameters
    ----------
    firmware, hardware
        Of one scenario.
    epochs : int
        At most so many.
    clock : callable
        Of which kind the times are, ns.
    """
    arrival_ns = firmware.ram["clock"]["sync_arrival_ns"]
    down = 0
    for epoch in range(epochs):
        arrival_ns[0] = epoch * firmware.period_ns
        begin = clock()
        up = hardware_step(
            hardware.plant,
            hardware.pieces,
            hardware.contract,
            firmware.outbox,
            down,
            hardware.outbox,
        )
        middle = clock()
        down = firmware_step(
            firmware.ram,
            firmware.contract,
            hardware.outbox,
            0,
            up,
            firmware.outbox,
            firmware.compares,
            firmware.estimates,
        )
        end = clock()
        yield TimedEpoch(epoch, end - middle, middle - begin, up)
