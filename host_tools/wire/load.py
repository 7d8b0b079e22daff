"""Bus load: over the whole time, and over windows of equal length."""

from __future__ import annotations

from typing import Protocol

from rrins.compiled.compilation import compiled


class Load(Protocol):
    """A record with what is counted of the load; times in ns."""

    busy_ns: int
    window_ns: int
    window_end_ns: int
    window_busy_ns: int
    last_window_busy_ns: int
    worst_window_busy_ns: int


@compiled
def roll_window(load: Load, time_ns: int) -> None:
    """Advance the window of the bus load to a time."""
    while load.window_end_ns <= time_ns:
        load.last_window_busy_ns = load.window_busy_ns
        load.worst_window_busy_ns = max(load.worst_window_busy_ns, load.window_busy_ns)
        load.window_busy_ns = 0
        behind = (time_ns - load.window_end_ns) // load.window_ns
        if behind > 0:  # empty ones
            load.last_window_busy_ns = 0
        load.window_end_ns += (behind + 1) * load.window_ns


@compiled
def occupy(load: Load, start_ns: int, end_ns: int) -> None:
    """Count the bus as busy between two times."""
    load.busy_ns += end_ns - start_ns
    roll_window(load, start_ns)
    while end_ns >= load.window_end_ns:
        load.window_busy_ns += load.window_end_ns - start_ns
        start_ns = load.window_end_ns
        roll_window(load, start_ns)
    load.window_busy_ns += end_ns - start_ns
