"""Takes a routine's order to the modes: part of the compiled step."""

from __future__ import annotations

from typing import Any

from numba import njit

from firmware_py import modes
from firmware_py.diagnostics.records import Order
from firmware_py.modes import Mode

_STANDBY, _SELF_TEST, _ALIGN = int(Order.STANDBY), int(Order.SELF_TEST), int(Order.ALIGN)
_START, _STOP = int(Order.START_ROTATION), int(Order.STOP_ROTATION)


@njit(cache=True)
def take(state: Any) -> None:
    """Act on an order as far as the present mode allows; it may have changed since it was given."""
    order = state.diagnostics.order
    state.diagnostics.order = 0
    mode = state.modes.mode
    if order == _SELF_TEST and mode in (Mode.STANDBY, Mode.FAULT):
        state.modes.pending = Mode.STANDBY
        modes.enter(state, Mode.SELF_TEST)
    elif order == _ALIGN and mode == Mode.STANDBY:
        state.modes.pending = Mode.ALIGNMENT
        modes.enter(state, Mode.ALIGNMENT)
    elif order == _STANDBY and (mode == Mode.ALIGNMENT or modes.navigating(state)):
        state.modes.pending = Mode.STANDBY
        modes.enter(state, Mode.STANDBY)
    elif order == _START and mode == Mode.NAVIGATION_STRAPDOWN:
        state.modes.pending = Mode.NAVIGATION_ROTATING
        modes.enter(state, Mode.NAVIGATION_ROTATING)
    elif order == _STOP and mode == Mode.NAVIGATION_ROTATING:
        state.modes.pending = Mode.NAVIGATION_STRAPDOWN
        modes.enter(state, Mode.NAVIGATION_STRAPDOWN)
