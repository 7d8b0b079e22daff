"""How busy the wire is: over the whole time, and over windows of equal length."""

from __future__ import annotations

from typing import Any

from numba import njit


@njit(cache=True)
def roll_window(medium: Any, time_ns: Any) -> None:
    """Let the window of the bus load reach up to a time."""
    while medium.window_end_ns <= time_ns:
        medium.last_window_busy_ns = medium.window_busy_ns
        medium.worst_window_busy_ns = max(medium.worst_window_busy_ns, medium.window_busy_ns)
        medium.window_busy_ns = 0
        behind = (time_ns - medium.window_end_ns) // medium.window_ns
        if behind > 0:  # empty ones
            medium.last_window_busy_ns = 0
        medium.window_end_ns += (behind + 1) * medium.window_ns


@njit(cache=True)
def occupy(medium: Any, start_ns: Any, end_ns: Any) -> None:
    """Count the bus as busy between two times."""
    medium.busy_ns += end_ns - start_ns
    roll_window(medium, start_ns)
    while end_ns >= medium.window_end_ns:
        medium.window_busy_ns += medium.window_end_ns - start_ns
        start_ns = medium.window_end_ns
        roll_window(medium, start_ns)
    medium.window_busy_ns += end_ns - start_ns
